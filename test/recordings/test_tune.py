# SPDX-License-Identifier: Apache-2.0
"""Tuning: reproducible, resumable, the same on one process, several, or a cluster; and honest about its gain."""
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from bags import needs_rosbags, scan_bag

from dbscan_reg_ros import ParameterError, Parameters
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.commands.tune import main
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.replays.lidars import Lidars, RecordedLidar
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters
from dbscan_reg_ros.simulation import Lidar, follow, hall
from dbscan_reg_ros.simulation import simulate as drive
from dbscan_reg_ros.tuning.objective import HOPELESS, BackwardLidar, cost_of
from dbscan_reg_ros.tuning.space import Axis, read_axis
from dbscan_reg_ros.tuning.study import Study

BAD = {'advanced.refinement.map_scale': 0.5, 'advanced.refinement.map_first_scale': 0.9}
SEARCH = ('--parameters', *BAD, '--scans', '40', '--search', 'random')


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    pytest.importorskip('rosbags', reason='needs the Python package rosbags')
    folder = tmp_path_factory.mktemp('recordings')
    for name, seed in (('a', 1), ('b', 2)):
        assert simulate([str(folder / name), '--world', 'hall', '--speed', '2', '--rate', '4', '--seconds', '31',
                         '--seed', str(seed)]) == 0
    (folder
     / 'bad.yaml').write_text('/**:\n  ros__parameters:\n    advanced: {refinement: {map_scale: 0.5, map_first_scale: '
                              '0.9}}\n')
    return folder


@pytest.fixture
def words(recordings, tmp_path):
    """``words(trials, folder)``: the arguments of a search on recording a from the bad parameters."""
    return lambda trials, folder='out', *more: [
        str(recordings / 'a'), '--params-file', str(recordings / 'bad.yaml'), *SEARCH, '--trials', str(trials),
        '--processes', '1', '--out', str(tmp_path / folder), *map(str, more)]


def trials_of(folder):
    trials = [json.loads(line) for line in (folder / 'trials.jsonl').read_text().splitlines()]
    return sorted(trials, key=lambda trial: trial['number'])


@pytest.mark.parametrize(('text', 'axis'), [
    ('advanced.refinement.map_scale', Axis('advanced.refinement.map_scale', float, 0.2, 5.0)),
    ('advanced.selection.top_candidates=2:9', Axis('advanced.selection.top_candidates', int, 2, 9)),
    ('odometry.deskew', Axis('odometry.deskew', bool, choices=(False, True))),
])
def test_an_axis_spans_a_fifth_to_five_times_the_default_or_what_is_given(text, axis):
    found = read_axis(text, Parameters())
    if '=' not in text and not axis.choices:
        default = Parameters().flatten()[axis.name]
        axis = Axis(axis.name, float, default * axis.low, default * axis.high)
    assert found == axis


@pytest.mark.parametrize(('text', 'says'), [
    ('refinement.mapscale', "did you mean 'advanced.refinement.map_scale'"),
    ('advanced.rotation.eps', 'advanced.rotation.eps=LOW:HIGH'),
    ('advanced.refinement.map_scale=1', 'expected NAME=LOW:HIGH'),
    ('advanced.refinement.map_scale=0.1:99', 'advanced.refinement.map_scale = 99'),
    ('odometry.deskew=0:1', 'has no range'), ('mounting', 'cannot be searched'),
    ('advanced.segments.min_points=2.2:2.8', 'lower bound below'),
])
def test_what_cannot_be_searched_is_refused(text, says):
    with pytest.raises(ParameterError, match=re.escape(says)):
        read_axis(text, NodeParameters())


def test_values_cover_their_range_and_keep_their_type():
    log, whole, choice = Axis('a', float, 0.01, 100.0), Axis('b', int, 2, 5), Axis('c', bool, choices=(False, True))
    assert [log.at(share) for share in (0.0, 0.5, 1.0)] == [0.01, 1.0, 100.0]
    assert {whole.at(share / 100) for share in range(101)} == {2, 3, 4, 5} and type(whole.at(0.5)) is int
    assert [choice.at(share) for share in (0.0, 0.49, 0.5, 1.0)] == [False, False, True, True]


def test_a_bad_start_gets_better_and_the_result_is_a_parameter_file(words, recordings, tmp_path, capsys):
    assert main(words(12, 'out', '--held-out', recordings / 'b')) == 0
    printed = capsys.readouterr().out
    before, after = map(float, re.search(r'^Tuned on a: ([\d.]+) m before, ([\d.]+) m after', printed, re.M).groups())
    trials = trials_of(tmp_path / 'out')
    assert before == pytest.approx(trials[0]['cost'], abs=1e-5) and trials[0]['values'] == BAD
    assert after == pytest.approx(min(trial['cost'] for trial in trials), abs=1e-5) and after < 0.7 * before
    best = min(trials, key=lambda trial: trial['cost'])
    assert read_parameters(tmp_path / 'out' / 'best.yaml') == NodeParameters().replace(best['values'])
    held = re.search(r'(?m)^Held out \(1\): ([\d.]+) m before, ([\d.]+) m after.* 95 % between ([+-][\d.]+) and '
                     r'([+-][\d.]+) m', printed)
    assert float(held[1]) > float(held[2]) and 0.0 < float(held[3]) < float(held[4])
    assert re.search(r'by recording \+\d+\.\d %', printed)


def test_values_that_contradict_each_other_are_hopeless_and_end_no_search(recordings, tmp_path):
    assert main([str(recordings / 'a'), *SEARCH, '--trials', '4', '--processes', '1', '--out', str(tmp_path),
                 '--parameters', 'scan.noise_min=0.001:0.9']) == 0
    trials = trials_of(tmp_path)
    assert {trial['values']['scan.noise_min'] > 0.05 for trial in trials} == {True, False}
    assert all((trial['cost'] == HOPELESS) == (trial['values']['scan.noise_min'] > 0.05) for trial in trials)


@pytest.mark.long
def test_a_gain_within_the_noise_is_called_that(recordings, tmp_path, capsys):
    assert main([str(recordings / 'a'), *SEARCH, '--trials', '1', '--processes', '1', '--out', str(tmp_path),
                 '--held-out', str(recordings / 'b')]) == 0
    printed = capsys.readouterr().out
    assert 'The improvement is not statistically significant' in printed
    assert 'No other values had a lower cost: the best values are the initial ones.' in printed and '->' not in printed


@pytest.mark.long
def test_one_seed_gives_one_result_however_many_processes(words, tmp_path):
    assert main(words(6, 'one')) == 0
    assert main([*words(6, 'two'), '--processes', '2']) == 0
    one, two = (trials_of(tmp_path / name) for name in ('one', 'two'))
    assert one == two and len(one) == 6
    assert (tmp_path / 'one/best.yaml').read_bytes() == (tmp_path / 'two/best.yaml').read_bytes()


def test_a_killed_search_goes_on_where_it_was(words, tmp_path, root, capsys):
    assert main(words(8, 'whole')) == 0
    process = subprocess.Popen([sys.executable, '-m', 'dbscan_reg_ros', 'tune', *words(8, 'killed')],
                               env=os.environ | {'PYTHONPATH': str(root)}, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL)
    file, deadline = tmp_path / 'killed' / 'trials.jsonl', time.monotonic() + 60
    while not (file.exists() and file.read_bytes().count(b'\n') >= 3) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = file.read_bytes()
    assert 3 <= kept.count(b'\n') < 8
    file.write_bytes(kept + b'{"number": 7, "co')
    capsys.readouterr()
    assert main(words(8, 'killed')) == 0
    known = int(re.search(r'(\d+) of 8 trials known', capsys.readouterr().out)[1])
    assert known == kept.count(b'\n') and file.read_bytes().startswith(kept)
    assert trials_of(tmp_path / 'killed') == trials_of(tmp_path / 'whole')
    assert (tmp_path / 'killed/best.yaml').read_bytes() == (tmp_path / 'whole/best.yaml').read_bytes()


def test_a_search_with_other_settings_is_not_mixed_in(words, tmp_path, capsys):
    assert main(words(1)) == 0
    assert main(words(1, 'out', '--seed', 1)) == 2
    assert 'holds a search with other settings' in capsys.readouterr().err and len(trials_of(tmp_path / 'out')) == 1


@pytest.mark.long
def test_consistency_tells_bad_parameters_without_truth(recordings):
    good, bad = (cost_of(recordings / 'a', Lidars(), NodeParameters().replace(values), 'consistency', 120)
                 for values in ({}, BAD))
    assert 0.0 < 1.5 * good < bad


@pytest.fixture(scope='module')
def pair(tmp_path_factory):
    """A bag of two lidars that see 2 m far, front and rear of a base with wheels."""
    pytest.importorskip('rosbags', reason='needs the Python package rosbags')
    bag, lidar = tmp_path_factory.mktemp('pair') / 'pair', ('--lidar', 'hokuyo_urg04lx', '--range-max', '2')
    assert simulate([str(bag), '--world', 'corridor', '--seconds', '6', '--seed', '2', *lidar, '--mounting', '0.2',
                     '0.1', '30', *lidar, '--mounting', '-0.2', '-0.1', '210']) == 0
    return bag


BOTH = '--topic', '/scan', '--topic', '/scan_2'


def test_several_lidars_and_wheels_are_used_as_in_a_replay(pair, tmp_path, capsys):
    """The cost of the first trial is the error that `replay` measures; one lidar has another."""
    given = '--mounting', '/scan_2', '-0.21', '-0.1', '210'
    (tmp_path / 'wheels.yaml').write_text('/**: {ros__parameters: {prior.source: odometry}}')
    words = [str(pair), '--params-file', str(tmp_path / 'wheels.yaml')]
    search = ['--search', 'random', '--trials', '1', '--processes', '1', '--parameters', *BAD]
    assert main([*words, *BOTH, *given, *search, '--out', str(tmp_path / 'two')]) == 0
    assert main([*words, '--topic', '/scan', *search, '--out', str(tmp_path / 'one')]) == 0
    assert 'no effect' not in capsys.readouterr().err
    assert replay([*words, *BOTH, *given, '--out', str(tmp_path)]) == 0
    measured = json.loads((tmp_path / 'pair' / 'latest' / 'metrics.json').read_text())
    two, one = (trials_of(tmp_path / name)[0]['cost'] for name in ('two', 'one'))
    assert two == pytest.approx(measured['rpe_1m_mean_m'], rel=1e-6) != pytest.approx(one, rel=1e-3)


def test_on_the_way_back_a_further_lidar_is_read_back_to_front(pair):
    recording, ends = open_recording(pair, BOTH[3]), 10**10
    given = recording, Mounting(SE2(-0.2, -0.1, 3.7)), NodeParameters().scan
    there, back = (list(lidar.scans(NodeParameters().input))
                   for lidar in (RecordedLidar(*given), BackwardLidar(*given, ends)))
    assert len(there) > 20
    for scan, same in zip(there, reversed(back), strict=True):
        assert (same.stamp, same.time_increment) == (ends - scan.stamp, -scan.time_increment)
        assert np.array_equal(same.ranges, scan.ranges) and same.geometry == scan.geometry
    start = NodeParameters().replace({'prior.source': 'odometry'})
    assert 0.0 < cost_of(pair, Lidars(BOTH[1::2]), start, 'consistency') < 0.05


def test_a_lidar_without_a_mounting_ends_no_trial_but_the_command(pair, tmp_path, capsys):
    (tmp_path / 'own.yaml').write_text('/**: {ros__parameters: {base_frame: chassis}}')
    assert main([str(pair), *BOTH, '--params-file', str(tmp_path / 'own.yaml'), '--out', str(tmp_path / 'out')]) == 2
    assert "no transform from 'chassis' to 'laser'" in capsys.readouterr().err and not (tmp_path / 'out').exists()


def test_too_little_of_a_drive_is_hopeless_and_ends_no_search(recordings):
    assert cost_of(recordings / 'a', Lidars(), NodeParameters(), limit=5) == HOPELESS


@pytest.mark.long
def test_the_way_back_agrees_also_where_a_scan_takes_its_time(tmp_path):
    """At 1 m/s one that takes 0.1 s is off by 10 cm at its end."""
    path = follow([(2.0, 2.2), (5.0, 2.2)], speed=1.0)
    bag = scan_bag(tmp_path / 'slow', drive(hall(seed=1), path, Lidar(duration=0.099), seed=1).scans)
    assert cost_of(bag, Lidars(), NodeParameters(), 'consistency') < 0.02


def test_what_does_not_count_in_a_search_is_named(recordings, tmp_path, capsys):
    file = tmp_path / 'robot.yaml'
    file.write_text('/**: {ros__parameters: {mounting: laser_pose, publish_tf: false, advanced.path.step: 0.2, '
                    'advanced.odometry.zero_velocity_gate: 4.0}}')
    assert main([str(recordings / 'a'), '--params-file', str(file), '--parameters', 'mounting']) == 2
    assert capsys.readouterr().err.startswith(
        f'tune: {file}: these parameters have no effect in tune: publish_tf, advanced.path.step\ntune: ')


def test_a_recording_is_not_held_out_and_searched_on(words, recordings, capsys):
    assert main(words(1, 'out', '--held-out', recordings / 'a')) == 2
    assert 'cannot be held out' in capsys.readouterr().err


@needs_rosbags
def test_a_drive_too_short_to_be_judged_is_refused(data, tmp_path, capsys):
    assert main([str(data / 'ccny_demo' / 'demo.bag'), '--scans', '5', '--search', 'random', '--trials', '2',
                 '--processes', '1',
                 '--out', str(tmp_path)]) == 2
    assert 'expected a longer drive' in capsys.readouterr().err and not (tmp_path / 'best.yaml').exists()


@pytest.mark.long
def test_optuna_finds_a_minimum_sooner_than_chance_and_can_be_resumed(tmp_path):
    pytest.importorskip('optuna')
    axes = [Axis('x', float, -1.0, 1.0), Axis('y', float, -1.0, 1.0)]

    def search(kind, folder, trials):
        study = Study(tmp_path / folder, {'search': kind, 'seed': 3, 'start': {'x': 1.0, 'y': 1.0}}, axes)
        return study.run(trials, lambda asked: ((number, (values['x'] - 0.3)**2 + (values['y'] + 0.2)**2)
                                                for number, values in asked.items()), lambda done, best: None)

    search('optuna', 'a', 30)
    resumed = search('optuna', 'a', 100)
    assert resumed == search('optuna', 'b', 100)
    assert resumed[0] < search('random', 'c', 100)[0] and resumed[0] < 1e-3


@pytest.mark.long
def test_a_cluster_gives_the_same_even_when_a_worker_is_killed(words, tmp_path, cluster):
    assert main([*words(6, 'here'), '--processes', '2']) == 0
    process = subprocess.Popen([sys.executable, '-m', 'dbscan_reg_ros', 'tune', *words(6, 'there'), '--scheduler',
                                cluster.scheduler_address], stdout=subprocess.DEVNULL)
    file, deadline = tmp_path / 'there' / 'trials.jsonl', time.monotonic() + 60
    while not (file.exists() and file.read_bytes()) and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
    assert process.wait(120) == 0
    assert trials_of(tmp_path / 'here') == trials_of(tmp_path / 'there')
    assert (tmp_path / 'here/best.yaml').read_bytes() == (tmp_path / 'there/best.yaml').read_bytes()


def test_the_result_is_set_on_a_running_node(words, tmp_path, start_command, capsys):
    pytest.importorskip('rclpy')
    start_command('scan_matcher', '--ros-args', '-p', 'mounting:=none')
    assert main(words(3, 'out', '--live', '/scan_matcher')) == 0
    assert 'live        set on /scan_matcher' in capsys.readouterr().out
    from ros_helpers import Parameters, Peer
    best = read_parameters(tmp_path / 'out' / 'best.yaml').flatten()
    with Peer() as peer:
        assert Parameters(peer).get(*BAD) == [best[name] for name in BAD]
