# SPDX-License-Identifier: Apache-2.0
"""What could write where it should not, tried."""
import json
import tempfile

import pytest

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.private_graph import ForeignFolder, private_graph

LINE = f'FLASER 40 {" ".join(["2.0"] * 40)} 0 0 0 0 0 0 {{}} host 0.1\n'


@pytest.mark.parametrize('name', ['...log'])
def test_the_results_of_a_recording_cannot_leave_their_folder(tmp_path, name):
    path, out = tmp_path / name, tmp_path / 'out' / 'results'
    path.write_text(LINE.format(1.5) + LINE.format(1.6))
    assert replay([str(path), '--out', str(out)]) == 0
    assert [child.name for child in out.parent.iterdir()] == ['results']
    assert [child.name for child in out.iterdir()] == [name.removesuffix('.log').strip('.') or 'recording']


def test_what_a_page_shows_cannot_end_its_script(tmp_path):
    path = tmp_path / '<!--<script>.log'
    path.write_text(LINE.format(1.5) + LINE.format(1.6))
    assert replay([str(path), '--out', str(tmp_path / 'out')]) == 0
    [page] = (tmp_path / 'out').glob('*/2*/report.html')
    data = page.read_text().partition('id="data">')[2].partition('</script>')[0]
    assert '<' not in data and '-->' not in data
    assert json.loads(data)['title'].startswith('<!--<script>')


def test_the_list_of_ros_domains_of_another_user_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    with private_graph():
        [folder] = tmp_path.iterdir()
    assert folder.stat().st_mode & 0o077 == 0
    folder.rename(tmp_path / 'elsewhere')
    folder.symlink_to(tmp_path / 'elsewhere')
    with pytest.raises(ForeignFolder, match='belongs to another user'), private_graph():
        pass
