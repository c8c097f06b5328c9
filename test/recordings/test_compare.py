# SPDX-License-Identifier: Apache-2.0
"""Comparing two parameter sets or methods: no false alarms, and what is worse is found."""
import csv
import json
import re
from itertools import islice

import numpy as np
import pytest
from matplotlib.image import imread

from dbscan_reg_ros import open_recording
from dbscan_reg_ros.commands.compare import main, note_deskewing
from dbscan_reg_ros.commands.competitors import Competitor
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.evaluation.comparison import (
    Comparison,
    Difference,
    Paired,
    difference,
)
from dbscan_reg_ros.evaluation.metrics import path_lengths
from dbscan_reg_ros.recordings.conversion import write_log
from dbscan_reg_ros.recordings.recording import Record


def related_errors(rng, count=800, reach=20):
    """Errors (2, count) of mean 0.01 that resemble their neighbours up to `reach` apart."""
    noise = rng.normal(size=(2, count + reach - 1))
    smooth = np.array([np.convolve(row, np.full(reach, reach**-0.5), 'valid') for row in noise])
    return 0.01 + 0.003 * smooth


@pytest.mark.long
def test_equal_ones_are_called_different_in_at_most_8_of_100_cases():
    """Errors that resemble their neighbours, in three recordings, of two methods that are equally good."""
    alarms = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        pairs = [Paired(related_errors(rng), related_errors(rng), 100) for _ in range(3)]
        alarms += any(d.worse or d.better for d in (difference(pairs, row, seed) for row in (0, 1)))
    assert alarms <= 8


@pytest.mark.long
def test_a_change_of_10_percent_is_seen():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        errors = related_errors(rng)
        pairs = [Paired(errors, 1.1 * errors + 0.0003 * rng.normal(size=errors.shape), 100)]
        worse, better = difference(pairs, 0, seed), difference([Paired(p.b, p.a, p.block) for p in pairs], 0, seed)
        assert worse.worse and not worse.better and better.better and not better.worse
        assert worse.low < 0.1 * errors[0].mean() < worse.high


def test_a_set_does_not_differ_from_itself_nor_by_what_it_says_does_not_count(compare, tmp_path):
    (tmp_path / 'robot.yaml').write_text(
        '/**: {ros__parameters: {input.every_nth: 2, publish_tf: false}}')
    code, printed, content = compare('defaults', tmp_path / 'robot.yaml')
    assert code == 0 and 'B is neither better nor worse.' in printed.out
    assert printed.err == (f'compare: {tmp_path}/robot.yaml: these parameters have no effect in compare: '
                           'publish_tf, input.every_nth\ncompare: hall, defaults ...\n'
                           'compare: hall, robot.yaml ...\n')
    assert set(content['differences']) == {'hall', 'all'}
    assert all(d['low'] == d['high'] == 0.0 for row in content['differences'].values() for d in row.values())


def test_a_worse_set_is_found_and_sets_the_exit_status(compare, tmp_path):
    (tmp_path / 'bad.yaml').write_text(
        '/**: {ros__parameters: {odometry.reference: keyframe, advanced.density.cell_size: 0.1, '
        'advanced.refinement.polish_iterations: 0}}')
    code, printed, content = compare('defaults', tmp_path / 'bad.yaml')
    assert code == 1 and 'B is worse in translation' in printed.out
    assert content['differences']['all']['m']['low'] > 0.0
    folder = tmp_path / 'compare' / 'latest'
    assert {file.name for file in folder.iterdir()} == {
        'comparison.json', 'comparison.png', 'hall', 'index.html', 'table.csv', 'table.tex', 'table.txt'}
    assert (folder / 'table.txt').read_text() in printed.out
    assert 0.005 < 1.0 - imread(folder / 'hall' / 'trajectories.png')[..., :3].mean() < 0.3
    rows = list(csv.DictReader((folder / 'table.csv').read_text().splitlines()))
    assert [float(row['error_m']) for row in rows] == [row['error_m'] for row in content['table']]
    begin, *lines, end = (folder / 'table.tex').read_text().splitlines()
    assert (begin, end) == (r'\begin{tabular}{llrrrrrrrl}', r'\end{tabular}')
    assert [line.count(' & ') for line in lines] == [9, 9, 9]
    assert lines[1].startswith(f'hall & A defaults & {content["table"][0]["error_m"]:.4f} & ')
    assert 0.005 < 1.0 - imread(folder / 'comparison.png')[..., :3].mean() < 0.3
    assert compare(tmp_path / 'bad.yaml', 'defaults')[0] == 0


@pytest.mark.long
def test_wheels_and_a_second_lidar_are_used_as_in_a_replay(tmp_path, capsys):
    """The errors of either set are those that `replay` measures with the same parameters and lidars."""
    lidar = ['--lidar', 'hokuyo_urg04lx', '--range-max', '2']
    assert simulate([str(tmp_path / 'drive'), '--world', 'corridor', '--seconds', '8', '--seed', '2', *lidar,
                     '--mounting', '0.2', '0.1', '30', *lidar, '--mounting', '-0.2', '-0.1', '210']) == 0
    # The given mounting of the second lidar is 1 cm farther back than the true one.
    robot = tmp_path / 'robot.yaml'
    robot.write_text("""/**: {ros__parameters: {prior.source: odometry, sensors: [front, rear],
      front: {topic: /scan, laser_pose: [0.2, 0.1, 0.5236]}, rear: {topic: /scan_2, laser_pose: [-0.21, -0.1, 3.6652]}}}
    """)
    given = [str(tmp_path / 'drive'), '--topic', '/scan', '--topic', '/scan_2', '--out', str(tmp_path / 'out')]
    assert main(['defaults', str(robot), *given]) in (0, 1), 'in 8 s a set may be judged worse or not'
    assert 'no effect' not in capsys.readouterr().err
    found = json.loads((tmp_path / 'out' / 'compare' / 'latest' / 'comparison.json').read_text())
    for side, words in (('a', []), ('b', ['--params-file', str(robot)])):
        assert replay([*given, *words]) == 0
        measured = json.loads((tmp_path / 'out' / 'drive' / 'latest' / 'metrics.json').read_text())
        assert found['differences']['drive']['m'][side] == pytest.approx(measured['rpe_1m_mean_m'], rel=1e-6)
    assert found['differences']['drive']['m']['b'] != found['differences']['drive']['m']['a']


def test_methods_that_get_the_scans_as_measured_are_named_where_another_corrects_the_motion(hall_recording, tmp_path):
    assert simulate([str(tmp_path / 'swept.log'), '--seconds', '1', '--lidar', 'hokuyo_urg04lx']) == 0
    (tmp_path / 'plain.yaml').write_text('/**: {ros__parameters: {odometry.deskew: false}}')
    at_once, swept = map(open_recording, (hall_recording, tmp_path / 'swept.log'))
    corrected, plain, icp, still = map(Competitor.named, ('defaults', str(tmp_path / 'plain.yaml'), 'icp', 'identity'))
    note, = note_deskewing([corrected, plain, icp], [at_once, swept])
    assert note.startswith('A: with correction of the motion during a scan; C: scans as measured.')
    assert note_deskewing([plain, icp], [swept]) == note_deskewing([corrected, still], [swept]) == []
    assert note_deskewing([corrected, icp], [at_once]) == []


def test_without_truth_there_are_paths_ends_maps_and_differences_but_no_verdict(hall_recording, tmp_path, capsys):
    source, blind = open_recording(hall_recording), tmp_path / 'blind.log'
    write_log(blind, (Record(scan, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)) for scan in islice(source.scans(), 250)))
    assert main(['defaults', 'identity', str(blind), '--processes', '1', '--out', str(tmp_path)]) == 3
    assert 'B is not judged: the true motion is unknown.' in capsys.readouterr().out
    folder = tmp_path / 'compare' / 'latest'
    ours, still = json.loads((folder / 'comparison.json').read_text())['without_truth']['blind.log']
    _, truth = source.truth()
    path = path_lengths(truth[:250])[-1]
    assert ours['driven'] == pytest.approx(path, rel=0.05) and still['driven'] == still['end_m'] == 0.0
    assert ours['difference_m'] == ours['end_difference_deg'] == 0.0 < 0.5 < still['difference_m'] < 1.3
    assert still['end_difference_m'] == pytest.approx(ours['end_m'])
    assert ours['returns_per_cell'] > 1.5 * still['returns_per_cell']
    assert 'returns a cell' in (folder / 'index.html').read_text()


@pytest.mark.parametrize(('a', 'b', 'verdict'), [
    ((0.109, 0.0175, -0.2, 0.02), (1.0, 1.0, -0.1, 0.1), 'not decided in translation'),
    ((0.109, 0.0175, -0.2, 0.02), (1.0, 1.0, -0.4, 0.1), 'not decided'),
    ((0.109, 0.109, -0.02, 0.02), (1.0, 1.0, -0.1, 0.1), 'neither better nor worse'),
    ((0.109, 0.0175, -0.2, -0.02), (1.0, 1.0, -0.1, 0.1), 'better in translation'),
    ((0.109, 0.0175, -0.2, -0.02), (1.0, 1.0, -0.5, 0.5), 'better in translation and not decided in rotation'),
])
def test_wide_intervals_about_0_decide_nothing(a, b, verdict):
    row = [Difference(*values, unit, 100, 20) for values, unit in ((a, 'm'), (b, 'deg'))]
    assert Comparison('B', 'a', 'b', {'x': 1.0}, {'x': row, 'all': row}).verdict('all') == verdict


def test_a_wrong_name_is_one_line_that_says_what_there_is(hall_recording, capsys):
    assert main(['defaults', 'absent', str(hall_recording)]) == 2
    assert re.fullmatch('compare: absent: no such file; expected a parameter file, a parameter set: defaults, '
                        'hokuyo_urg04lx, .*; or a method: dbscan, .*, MODULE:FUNCTION\n', capsys.readouterr().err)
