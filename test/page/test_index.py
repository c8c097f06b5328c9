# SPDX-License-Identifier: Apache-2.0
"""Index of several drives, and the page of a comparison with all competitors on one map."""
import json
from urllib.parse import unquote

import numpy as np
import pytest
from bags import scan_bag

from dbscan_reg_ros import SE2, Odometry
from dbscan_reg_ros.commands.compare import write_pages
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.evaluation.comparison import Comparison, Difference
from dbscan_reg_ros.evaluation.competitor_results import results_of
from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.page.entries import replay_entry, write_replay_index
from dbscan_reg_ros.replays.trajectory import Trajectory
from dbscan_reg_ros.simulation.recording import SimulatedRecording

CELLS = '[...document.querySelectorAll("tbody tr")].map(row => [...row.children].map(x => x.textContent))'


@pytest.fixture(scope='module')
def measures(replayed, known):
    measures = replayed.trajectory.measures(2.0)
    return measures | known.measures(replayed.trajectory.stamps, replayed.trajectory.pose_array())


@pytest.fixture
def index(replayed, simulation, measures, tmp_path):
    """Path of the index of three replays, whose names try to leave their elements, and whose truth has holes."""
    poses = replayed.trajectory.pose_array()
    truth = poses[:, :2] + 0.1
    truth[[10, 11, *range(50, 53)]] = np.nan
    lines = [('trajectory', 'trajectory', poses[:, :2]), ('truth', 'truth', truth)]
    density = density_map(simulation.scans[20:120], poses)
    entries = [replay_entry(name, tmp_path / name / 'today', measures, density, lines)
               for name in ('a', 'b & <b>', 'c "x"')]
    write_replay_index(tmp_path, entries)
    return tmp_path / 'index.html'


@pytest.mark.parametrize('dark', [False, True])
@pytest.mark.parametrize('width', [390, 1400])
def test_the_index_lists_every_drive_with_its_map_and_links_its_page(browser, index, measures, width, dark):
    browser.screen(width, 900, dark)
    browser.open(index.as_uri())
    assert browser.complaints == [] and browser.value('document.documentElement.scrollWidth') == width
    rows = browser.value(CELLS)
    assert [row[0] for row in rows] == ['a', 'b & <b>', 'c "x"']
    assert rows[0][1:5] == [f'{measures["driven_m"]:.1f}', '9.9', '100', '4']
    assert rows[0][6] == f'{measures["rpe_1m_mean_m"]:.4f}'
    links = browser.value('[...document.querySelectorAll("tbody a")].map(a => a.getAttribute("href"))')
    assert [unquote(link) for link in links] == [f'{row[0]}/today/report.html' for row in rows]
    maps = browser.value('[...document.querySelectorAll("#drives > li > svg")].map('
                         'x => [x.getBoundingClientRect().width, '
                         '[...x.querySelectorAll("polyline")].map(line => line.points.length)])')
    assert len(maps) == 3 and all(shown > 300 for shown, _ in maps)
    assert all(lines == [100, 48, 47] for _, lines in maps), 'the truth is interrupted in the longer hole'


class Recorded(SimulatedRecording):
    """The part of the simulated drive that the fixtures replay."""

    def scans(self):
        """Return the scans."""
        return iter(list(super().scans())[20:120])


@pytest.fixture
def compared(simulation, known, replayed, tmp_path):
    """Folder of a comparison of the odometry with a rotated copy of it that lacks half of the scans, and another."""
    ours, other, still = replayed.trajectory, Trajectory(), Trajectory()
    for _ in still.follow(simulation.scans[20:120], Odometry()):
        pass
    for number, (stamp, pose) in enumerate(zip(ours.stamps, ours.poses, strict=True)):
        other.used.append(number % 2 == 0)
        if other.used[-1]:
            other.stamps.append(stamp)
            other.poses.append(tuple((SE2(1.0, 2.0, 0.5) @ SE2.from_array(np.array(pose))).as_array()))
            other.statuses.append(ours.statuses[number])
    row = [Difference(0.1, 0.2, 0.05, 0.15, 'm', 80, 8), Difference(1.0, 1.0, -0.1, 0.1, 'deg', 80, 8)]
    comparisons = [Comparison('B', 'ours', 'half', {'x': 0.5}, {'x': row, 'all': row}),
                   Comparison('C', 'ours', 'again', {'x': 1.0}, {'x': row, 'all': row})]
    (tmp_path / 'x').mkdir()
    trajectories = [ours, other, still]
    results = results_of('x', tmp_path / 'x', known, trajectories, comparisons)
    (tmp_path / 'rows.json').write_text('\n'.join(json.dumps(each.as_json()) for each in results))
    write_pages([tmp_path / 'x'], [Recorded('x', simulation)], [known], [trajectories], [results])
    return tmp_path


def test_competitors_are_laid_on_the_map_from_their_first_common_pose_on(show, compared, replayed):
    browser = show(compared / 'x' / 'report.html')
    assert browser.complaints == []
    assert browser.value('document.querySelector("nav a").href') == (compared / 'index.html').as_uri()
    layers = browser.value('[...document.querySelectorAll("#layers label")].map(label => label.textContent)')
    assert layers[:4] == ['scan', 'trajectory, thick where not OK', 'B: half', 'C: again']
    others = json.loads(browser.value('JSON.stringify(drive.others.map(other => [other.name, [...other.at]]))'))
    half = np.array([np.nan if value is None else value for value in others[2][1]]).reshape(-1, 2)
    poses = replayed.trajectory.pose_array()
    np.testing.assert_allclose(half[::2], poses[::2, :2], atol=1e-5)
    assert np.isnan(half[1::2]).all() and others[2][0] == 'B: half'
    plots = browser.value('[...document.querySelectorAll(".plot > p:first-child")].map(p => p.textContent)')
    assert sum('of B: half' in text for text in plots) == sum('of C: again' in text for text in plots) == 2
    browser.value('page.go(50)')
    browser.frame()
    values = browser.value('[...document.querySelectorAll("#values dt")].map(dt => dt.textContent)')
    assert 'translation error of B: half' in values


def test_the_index_of_a_comparison_has_a_row_for_each_competitor_with_its_verdict(browser, compared):
    browser.open((compared / 'index.html').as_uri())
    rows = browser.value(CELLS)
    assert [row[0] for row in rows] == ['x', 'A: ours', 'B: half', 'C: again']
    rows = rows[1:]
    assert [row[1] for row in rows] == ['', 'not judged', 'worse in translation']
    assert [row[10] for row in rows] == ['100 of 100', '50 of 100', '100 of 100']
    assert [row[2] for row in rows[1:]] == ['0.2000', '0.2000']
    content = [json.loads(line) for line in (compared / 'rows.json').read_text().splitlines()]
    assert [row[6:9] for row in rows] == [[f'{each[name]:.6f}' for name in ('ape_m', 'rpe_m', 'rpe_deg')]
                                           for each in content]
    assert 0.0 < content[0]['ape_m'] < 0.05 and content[1]['ape_m'] < 0.05
    assert browser.value('document.querySelector("tbody a").getAttribute("href")') == 'x/report.html'
    ours, half = browser.value('[...document.querySelectorAll("#drives > li > svg polyline")].slice(0, 2).map('
                               'line => [...line.points].map(point => [point.x, point.y]))')
    np.testing.assert_allclose(half, ours[::2], atol=0.011, err_msg='in another frame, but drawn on the map of A')


def test_a_replay_of_several_recordings_writes_the_index_and_moving_pictures(simulation, tmp_path, capsys):
    pytest.importorskip('rosbags', reason='needs the Python package rosbags')
    bags = [scan_bag(tmp_path / name, simulation.scans[20:20 + count]) for name, count in (('a', 12), ('b', 15))]
    assert replay([*map(str, bags), '--animation', '--processes', '1', '--out', str(tmp_path / 'out')]) == 0
    assert f'index       {tmp_path}/out/index.html\n' in capsys.readouterr().out
    text = (tmp_path / 'out' / 'index.html').read_text()
    for name in 'ab':
        folder = (tmp_path / 'out' / name / 'latest').resolve()
        assert f'href="{name}/{folder.name}/report.html"' in text
        assert (folder / 'animation.gif').read_bytes().startswith(b'GIF89a')
        assert '<a href="../../index.html">All drives</a>' in (folder / 'report.html').read_text()
