# SPDX-License-Identifier: Apache-2.0
"""Replay: recordings in, a folder of results each."""
import gzip
import itertools
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from bags import messages, needs_rosbags, scan_bag

from dbscan_reg_ros import SE2
from dbscan_reg_ros.commands.replay import main
from dbscan_reg_ros.recordings import open_recording, read_tum, write_tum
from dbscan_reg_ros.recordings.carmen.log import CarmenLog
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters


def picture(path):
    """Darkness ``(rows, columns)`` of a picture: 0 is white, 1 is black."""
    from matplotlib.image import imread
    return 1.0 - imread(path)[..., :3].mean(axis=2)


pytestmark = needs_rosbags

FILES = {'bag', 'map.png', 'metrics.json', 'parameters.yaml', 'report.html', 'trajectory.tum'}


@pytest.fixture
def replay(data, tmp_path):
    """``replay(*words) -> exit code``: into the test's folder."""
    return lambda *words: main([*map(str, words), '--data', str(data), '--out', str(tmp_path)])


def names(folder):
    return {file.name for file in folder.iterdir()}


@pytest.mark.parametrize(('words', 'expected'), [
    (['lms511/static'], ('static', 173, 4101310801000, set())),
    pytest.param(['urg04lx/exp1'], ('exp1', 756, 212387282000, set()), marks=pytest.mark.long),
    pytest.param(['ccny_demo/demo.bag'], ('demo', 360, 1282836370970876375, set()), marks=pytest.mark.long),
    (['aces/aces.log.gz', '--close-loops'], ('aces', 440, 21019900000, {'truth.tum', 'closed.tum', 'map_closed.png'})),
])
def test_a_recording_becomes_a_folder_of_results(data, replay, tmp_path, capsys, words, expected):
    """Where the log has corrected poses, they are the truth."""
    name, count, first, more = expected
    assert replay(*words) == 0
    latest = tmp_path / name / 'latest'
    assert names(latest) == FILES | more
    assert names(latest.parent) == {'latest', latest.resolve().name} and names(tmp_path) == {name}
    stamps, poses = read_tum(latest / 'trajectory.tum')
    assert stamps.tolist() == open_recording(data / words[0]).stamps() and len(stamps) == count and stamps[0] == first
    assert poses[0].tolist() == [0.0, 0.0, 0.0] and np.isfinite(poses).all()
    assert 0.003 < picture(latest / 'map.png').mean() < 0.5
    assert {orange(latest / each) > 300 for each in names(latest) if each.endswith('.png')} == {bool(more)}
    printed = capsys.readouterr().out
    measured = re.search(r'(?ms)^over 1 m +mean \d+\.\d+ m .*^over 5 m +mean .*^position +\d+\.\d+ m', printed)
    assert bool(measured) == bool(more)
    if more:
        assert stamps.tolist() == read_tum(latest / 'truth.tum')[0].tolist()
    assert re.search(rf'^scans +{count} skipped 0 ', printed, re.MULTILINE)
    assert re.search(r'^time +median \d+\.\d\d ms, p95 \d+\.\d\d ms per scan; processor time \d+\.\d\d ms per scan$',
                     printed, re.MULTILINE)
    metrics = json.loads((latest / 'metrics.json').read_text())
    assert (metrics['recording'], metrics['scans'], metrics['skipped']) == (name, count, 0)
    assert metrics['processor_ms_mean'] > 0.0
    assert read_parameters(latest / 'parameters.yaml') == NodeParameters()


def test_the_bag_holds_what_the_node_would_have_published(beginning, tmp_path):
    """Poses as in the trajectory, with the scans' stamps, in their order; /tf says the same; segments near the scan."""
    assert main(['urg04lx/exp1', '--data', str(beginning), '--out', str(tmp_path)]) == 0
    stamps, poses = read_tum(tmp_path / 'exp1' / 'latest' / 'trajectory.tum')
    found = messages(tmp_path / 'exp1' / 'latest' / 'bag')
    odometry, transforms, segments = ([(time, message) for topic, time, message in found if topic == each]
                                      for each in ('/odom', '/tf', '/segments'))
    assert len(odometry) == len(transforms) == len(segments) == len(stamps)
    assert len(stamps) > 190
    for (time, odom), (_, tf), stamp, pose in zip(odometry, transforms, stamps, poses, strict=True):
        header, transform = odom.header, tf.transforms[0]
        assert time >= header.stamp.sec * 10**9 + header.stamp.nanosec == stamp
        assert (header.frame_id, odom.child_frame_id) == ('odom', 'base_link')
        place = odom.pose.pose.position
        np.testing.assert_allclose((place.x, place.y), pose[:2], atol=1e-8)
        assert (transform.transform.translation.x, transform.transform.translation.y) == (place.x, place.y)
        assert transform.header == header and odom.pose.covariance[0] > 0.0
    markers = segments[-1][1].markers
    assert [(marker.ns, marker.id) for marker in markers] == [
        ('reference', 1), ('reference', 0), ('current', 1), ('current', 0)]
    points = np.array([(point.x, point.y) for marker in markers for point in marker.points])
    assert len(points) > 4 and np.hypot(*(points - poses[-1, :2]).T).max() < 4.5


def test_a_replay_is_what_the_node_answers_however_the_laser_sits(start_node, scans, tmp_path):
    """Bit for bit, by the real node; the trajectory of the sensor is the same motion."""
    from ros_helpers import played

    from dbscan_reg_ros.node.playback.player import Player
    laser = SE2(0.3, -0.1, 2.0)
    bag = scan_bag(tmp_path / 'drive', scans[:40])
    file = tmp_path / 'a.yaml'
    file.write_text('/**: {ros__parameters: {mounting: laser_pose, laser_pose: [0.3, -0.1, 2.0], prior.source: none}}')
    start_node('--params-file', str(file), '-p', 'mounting:=laser_pose')
    with Player() as player:
        answers = played(player, scans[:40])
    assert main([str(bag), '--params-file', str(file), '--out', str(tmp_path / 'out')]) == 0
    results = tmp_path / 'out' / 'drive' / 'latest'
    odom = [message for _, _, message in messages(results / 'bag', '/odom')]
    for answer, message in zip(answers.messages, odom, strict=True):
        assert (message.header.frame_id, message.child_frame_id) == (answer.header.frame_id, answer.child_frame_id)
        for online, offline in ((answer.pose, message.pose), (answer.twist, message.twist)):
            np.testing.assert_array_equal(offline.covariance, online.covariance)
        assert values(message.pose.pose.position) == values(answer.pose.pose.position)
        assert values(message.pose.pose.orientation, 'xyzw') == values(answer.pose.pose.orientation, 'xyzw')
        assert values(message.twist.twist.linear) == values(answer.twist.twist.linear)
    _, poses = read_tum(results / 'trajectory.tum')
    of_base = [(laser @ SE2.from_array(pose) @ laser.inverse()).as_array() for pose in poses]
    np.testing.assert_allclose(of_base, answers.poses(), atol=1e-7)


def values(vector, names='xyz'):
    return [getattr(vector, name) for name in names]


def test_what_only_the_node_goes_by_is_named(data, tmp_path, capsys):
    file = tmp_path / 'a.yaml'
    for settings, names in (('input.every_nth: 2, prior.source: tf, scan.range_max: 5.0',
                             'prior.source, input.every_nth'),
                            ('prior.source: none, mounting: none, base_frame: base, advanced.prior.weight: 0.1', '')):
        file.write_text(f'/**: {{ros__parameters: {{{settings}}}}}')
        assert main([str(data / 'absent.log'), '--params-file', str(file), '--out', str(tmp_path)]) == 2
        said = f'replay: {file}: these parameters have no effect in replay: {names}\n' if names else ''
        assert capsys.readouterr().err.startswith(f'{said}replay: {data}/absent.log: ')


@pytest.mark.long
def test_the_intel_log_is_scored_by_its_relations_and_its_reference(replay, tmp_path, capsys):
    """With loop closures, the relations are closer than those of graph SLAM, 0.031 m (Kuemmerle et al. 2009)."""
    assert replay('intel/intel.log.gz', '--close-loops') == 0
    printed = capsys.readouterr().out
    assert re.search(r'^scans +5505 skipped 0 ', printed, re.MULTILINE)
    metres, degrees = re.search(r'^neighbours +mean (\d\.\d+) m (\d\.\d+) deg', printed, re.MULTILINE).groups()
    assert float(metres) < 0.03 and float(degrees) < 0.5
    metrics = json.loads((tmp_path / 'intel' / 'latest' / 'metrics.json').read_text())
    assert metrics['relations'] == 1030 and metrics['rpe_1m_median_m'] < 0.02
    assert metrics['relations_neighbour_mean_m'] == pytest.approx(float(metres), abs=6e-4)
    assert metrics['closed_relations_all_mean_m'] < 0.031 < metrics['relations_all_mean_m']
    latest = tmp_path / 'intel' / 'latest'
    assert names(latest) == FILES | {'closed.tum', 'map_closed.png', 'truth.tum'}
    assert read_tum(latest / 'closed.tum')[0].tolist() == read_tum(latest / 'trajectory.tum')[0].tolist()
    assert 0.003 < picture(latest / 'map_closed.png').mean() < 0.5


def orange(path):
    """How many points of a picture have the colour of the truth."""
    from matplotlib.image import imread
    red, green, blue = imread(path)[..., :3].transpose(2, 0, 1)
    return int(((red > 0.8) & (np.abs(green - 0.5) < 0.15) & (blue < 0.3)).sum())


def test_damaged_lines_and_useless_scans_are_named_and_the_others_used(data, tmp_path, capsys):
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
        lines = whole.readlines()[:30]
    lines[9] = lines[9][:200] + '\n'
    words = lines[19].split()
    lines[19] = ' '.join([*words[:2], *(['81.83'] * 180), *words[182:]]) + '\n'
    (tmp_path / 'a.log').write_text(''.join(lines))
    assert main([str(tmp_path / 'a.log'), '--out', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'a.log:10: damaged FLASER skipped' in printed
    assert re.search(r'^scan 17 not used: ', printed, re.MULTILINE)
    assert re.search(r'^scans +28 skipped 1 ', printed, re.MULTILINE)
    assert len(read_tum(tmp_path / 'a' / 'latest' / 'trajectory.tum')[0]) == 27


@pytest.mark.parametrize('returns, code, says',
                         [(150, 0, 'and 10 more'), (181, 2, 'not one of 30 scans could be used')])
def test_many_useless_scans_do_not_flood_the_terminal_and_none_is_no_success(data, tmp_path, capsys, returns, code,
                                                                             says):
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
        lines = whole.readlines()[:40]
    scans = [k for k, line in enumerate(lines) if line.startswith('FLASER')][:30]
    for k in scans[::2]:
        words = lines[k].split()
        lines[k] = ' '.join([*words[:2], *(['81.83'] * 180), *words[182:]]) + '\n'
    (tmp_path / 'a.log').write_text(''.join(lines[:scans[-1] + 1]))
    (tmp_path / 'p.yaml').write_text(f'/**:\n  ros__parameters:\n    advanced: {{scan: {{min_returns: {returns}}}}}\n')
    assert main([str(tmp_path / 'a.log'), '--out', str(tmp_path), '--params-file', str(tmp_path / 'p.yaml')]) == code
    printed = ''.join(capsys.readouterr())
    assert says in printed and printed.count('not used') <= 5


@pytest.mark.long
def test_several_recordings_in_several_processes_give_what_one_gives(data, replay, tmp_path, capfd):
    for name, length in (('a', 80), ('b', 60)):
        with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
            (tmp_path / f'{name}.log').write_text(''.join(itertools.islice(whole, length)))
    absent = [tmp_path / 'absent.log', tmp_path / 'missing.log']
    files = [tmp_path / 'a.log', tmp_path / 'b.log', *absent, tmp_path / 'a.log']
    assert replay(*files, '--processes', 1) == 2
    once = {name: (tmp_path / name / 'latest' / 'trajectory.tum').read_bytes() for name in 'ab'}
    capfd.readouterr()
    assert replay(*files, '--processes', 2) == 2
    out, error = capfd.readouterr()
    assert error == ''.join(f'replay: {path}: cannot be read: No such file or directory\n' for path in absent)
    assert len(re.findall('^results', out, re.MULTILINE)) == 3
    assert len(names(tmp_path / 'a')) == 5 and len(names(tmp_path / 'b')) == 3
    for name, trajectory in once.items():
        for folder in (tmp_path / name).iterdir():
            assert (folder / 'trajectory.tum').read_bytes() == trajectory and names(folder) == FILES


def test_a_hole_in_the_truth_is_named_and_not_bridged_on_the_page(data, tmp_path, capsys):
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
        (tmp_path / 'a.log').write_text(''.join(itertools.islice(whole, 60)))
    stamps = np.unique(open_recording(tmp_path / 'a.log').stamps())
    known = np.ones(len(stamps), dtype=bool)
    known[20:40] = False
    write_tum(tmp_path / 'truth.tum', stamps[known], np.zeros((known.sum(), 3)))
    assert main([str(tmp_path / 'a.log'), '--out', str(tmp_path), '--processes', '1']) == 0
    line, = re.findall(r'^true poses .*', capsys.readouterr().out, re.MULTILINE)
    missing = int(re.search(r'; (\d+) have no pose: \1 where successive poses are more than [\d.]+ s apart$', line)[1])
    written, _ = read_tum(tmp_path / 'a' / 'latest' / 'truth.tum')
    assert missing >= 20 and len(written) + missing == open_recording(tmp_path / 'a.log').count
    assert line.partition('  ')[2].strip() in (tmp_path / 'a' / 'latest' / 'report.html').read_text()


def test_an_interrupted_replay_keeps_what_it_has(replay, tmp_path, capsys, monkeypatch):
    def interrupted(self):
        yield from itertools.islice(scans(self), 50)
        raise KeyboardInterrupt

    scans = CarmenLog.scans
    monkeypatch.setattr(CarmenLog, 'scans', interrupted)
    assert replay('intel/intel.log.gz') == 130
    folder, = (tmp_path / 'intel').iterdir()
    assert len(read_tum(folder / 'trajectory.tum')[0]) == 50 and len(messages(folder / 'bag')) == 150
    assert names(folder) == {'bag', 'parameters.yaml', 'trajectory.tum'}
    assert capsys.readouterr().err == 'replay: interrupted\n'


def test_nothing_is_written_outside_the_result_folder(data, root, tmp_path):
    """With a home of its own and caches off, every new file is below results/."""
    work, home = tmp_path / 'work', tmp_path / 'home'
    work.mkdir()
    home.mkdir()
    environment = os.environ | {'PYTHONPATH': str(root), 'HOME': str(home), 'PYTHONDONTWRITEBYTECODE': '1',
                                'TMPDIR': str(home)}
    environment.pop('MPLCONFIGDIR', None)
    words = ['replay', str(data / 'lms511' / 'static'), '--processes', '2']
    subprocess.run([sys.executable, '-m', 'dbscan_reg_ros', *words], cwd=work, env=environment,
                   check=True, capture_output=True, timeout=120)
    assert names(work) == {'results'}
    left = {path.relative_to(home).parts[:2] for path in home.rglob('*') if path.is_file()}
    assert left <= {('.cache', 'matplotlib'), ('.config', 'matplotlib')}
