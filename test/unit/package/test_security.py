# SPDX-License-Identifier: Apache-2.0
"""What could run code of a file, or write where it should not: in the source, and tried."""
import ast
import json
import re
import tempfile

import pytest

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.private_graph import ForeignFolder, private_graph

FORBIDDEN_MODULES = {'pickle', 'marshal', 'shelve', 'dill', 'cloudpickle', 'joblib'}
FORBIDDEN_CALLS = {'eval', 'exec', 'compile', '__import__', 'system', 'popen', 'unsafe_load', 'full_load', 'load_all'}
LINE = f'FLASER 40 {" ".join(["2.0"] * 40)} 0 0 0 0 0 0 {{}} host 0.1\n'


def calls(root):
    """(place, name, call) of every call in the source."""
    for path in sorted([*(root / 'dbscan_reg_ros').rglob('*.py'), *(root / 'scripts').rglob('*.py'),
                        *(root / 'launch').glob('*.py')]):
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = {alias.name.partition('.')[0] for alias in node.names} | {getattr(node, 'module', '') or ''}
                assert not names & FORBIDDEN_MODULES, f'{path}:{node.lineno} imports {names}'
            if isinstance(node, ast.Call):
                function = node.func
                yield f'{path}:{node.lineno}', getattr(function, 'attr', getattr(function, 'id', '')), node


def test_nothing_in_the_source_runs_what_it_reads(root):
    found = list(calls(root))
    assert len(found) > 1000
    for place, name, call in found:
        if name == 'compile' and isinstance(call.func, ast.Attribute) and call.func.value.id == 're':
            continue
        assert name not in FORBIDDEN_CALLS, place
        keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
        assert keywords.get('allow_pickle', 'False') == 'False', place
        assert keywords.get('shell', 'False') == 'False', place
        if name == 'load' and ast.unparse(call.func) == 'yaml.load':
            assert ast.unparse(call.args[1]) == '_Loader', place
        if name == 'load' and ast.unparse(call.func) == 'np.load':
            assert keywords.get('allow_pickle') == 'False', place


def test_every_package_of_the_set_up_is_pinned_with_its_hashes(root):
    for path in sorted((root / 'scripts' / 'requirements').glob('*.txt')):
        text = re.sub(r'\s*#.*', '', path.read_text()).replace('\\\n', ' ')
        requirements = [line for line in text.splitlines() if line.strip()]
        assert requirements, path
        for requirement in requirements:
            assert re.match(r'[\w.\[\],-]+==[\w.]+( ; [^#]*?)?(\s+--hash=sha256:[0-9a-f]{64})+\s*$',
                            requirement), requirement


@pytest.mark.parametrize('name', ['...log', '....log', '.hidden.log', '...'])
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
