# SPDX-License-Identifier: Apache-2.0
"""Recordings of two lidars: simulated and replayed."""
import dataclasses
import json
import math
import re

import numpy as np
import pytest
from bags import messages, needs_rosbags, replayed, scan_bag
from two_lidars import bag_of_two_lidars

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.recordings import open_recording, read_tum
from dbscan_reg_ros.recordings.bags.static_transforms import static_mounting
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.trajectory import Trajectory
from dbscan_reg_ros.simulation import Lidar, follow, rooms
from dbscan_reg_ros.simulation import simulate as simulated

pytestmark = needs_rosbags

FRONT, REAR = (0.3, 0.2, 45.0), (-0.3, -0.2, -135.0)


@pytest.fixture(scope='module')
def pair(tmp_path_factory):
    return bag_of_two_lidars(tmp_path_factory.mktemp('pair') / 'pair', '--speed', '4')


def given(*topics):
    """Words that name the topics of both lidars, and their mountings."""
    return [word for topic, mounting in zip(topics, (FRONT, REAR), strict=True)
            for word in ('--topic', topic, '--mounting', topic, *map(str, mounting))]


def with_ranges(scan, chosen, value):
    """The scan with `value` [m] instead of the `chosen` ranges."""
    return Scan(scan.stamp, np.where(chosen, np.float32(value), scan.ranges), scan.geometry, scan.time_increment,
                scan.frame_id)


def trajectory(out, bag):
    return (out / bag.name / 'latest' / 'trajectory.tum').read_text()


@pytest.fixture(scope='module')
def scans(pair):
    """The first three seconds of both lidars, in which the second one is used after half a metre: topic -> scans."""
    return {topic: [scan for _, scan in zip(range(count), open_recording(pair, topic).scans(), strict=False)]
            for topic, count in (('/scan', 38), ('/scan_2', 46))}


def test_each_option_of_simulate_belongs_to_the_lidar_before_it(pair):
    first, second = (list(open_recording(pair, topic).scans()) for topic in ('/scan', '/scan_2'))
    assert (first[0].frame_id, second[0].frame_id) == ('laser', 'laser_2')
    assert second[0].stamp - first[0].stamp == 19_000_000
    assert np.diff([scan.stamp for scan in second]).mean() == pytest.approx(1e9 / 15)
    for topic, frame, (x, y, degrees) in (('/scan', 'laser', FRONT), ('/scan_2', 'laser_2', REAR)):
        found = static_mounting(pair, topic, 'base_link', frame)
        assert np.allclose(found.pose.as_array(), (x, y, math.radians(degrees))) and not found.upside_down
    assert static_mounting(pair, '/scan', 'map', 'laser') is None


def test_a_replay_uses_both_lidars_and_names_them(pair, tmp_path, capsys):
    words = '--topic', '/scan', '--topic', '/scan_2'
    found = replayed(pair, tmp_path / 'both', *words)
    printed = capsys.readouterr().out
    lines = [line for line in printed.splitlines() if line.startswith(('lidar ', 'poses '))]
    assert len(lines) == 3 and lines[2].endswith('those of the lidar on /scan, in its frame at its first scan')
    assert lines[0].startswith(f'lidar       /scan: scans {found["scans"]} skipped 0 ok {found["ok"]}')
    rear = found['lidars']['/scan_2']
    assert lines[1].startswith(f'lidar       /scan_2: scans {rear["scans"]} skipped 0 ignored {rear["ignored"]} ok ')
    assert 0 < rear['ignored'] < 30
    assert rear['scans'] >= open_recording(pair, '/scan_2').count - 2
    assert found['lidars']['/scan'] == {'ignored': 0} | {name: found[name] for name in rear if name != 'ignored'}
    assert found['scans'] == open_recording(pair, '/scan').count
    assert found['ok'] > 0.95 * found['scans'] and found['rpe_5m_mean_m'] < 0.01


@pytest.mark.parametrize('topics', [pytest.param(['/scan', '/scan_2'], marks=pytest.mark.long), ['/scan']])
def test_the_files_of_poses_may_contain_those_of_the_base(pair, topics, tmp_path, capsys):
    """By the recorded mounting: equal to /odom in the bag of the replay, which the node would publish."""
    words = [word for topic in topics for word in ('--topic', topic)]
    found = replayed(pair, tmp_path, *words, '--frame', 'base')
    assert 'in the files *.tum those of the base' in capsys.readouterr().out
    latest = tmp_path / pair.name / 'latest'
    (_, poses), (_, truth) = read_tum(latest / 'trajectory.tum'), read_tum(latest / 'truth.tum')
    odom = [message.pose.pose for _, _, message in messages(latest / 'bag', '/odom')]
    # Of several lidars, the scans of the others are messages on /odom as well.
    base = np.array([(pose.position.x, pose.position.y) for pose in odom])
    assert all(np.abs(base - pose[:2]).max(axis=1).min() < 1e-6 for pose in poses[::20])
    error = relative(truth[:1].repeat(len(truth), axis=0), truth) - poses
    assert np.hypot(*error[:, :2].T).max() < 0.2 and found['ate_m'] < 0.1


def test_the_lidars_of_a_replay_may_have_names(scans, tmp_path):
    """The poses of both lidars are parameters; what the parameters exclude is not used."""
    poses = [f'{name}.laser_pose: [{x}, {y}, {math.radians(degrees)}]'
             for name, (x, y, degrees) in (('front', FRONT), ('rear', REAR))]
    bag, file = scan_bag(tmp_path / 'bag', scans), tmp_path / 'parameters.yaml'
    file.write_text('/**: {ros__parameters: {sensors: [front, rear], front.topic: scan, rear.topic: /scan_2, '
                    f'{", ".join(poses)}}}}}')
    both = replayed(bag, tmp_path / 'given', *given('/scan', '/scan_2'))
    found = replayed(bag, tmp_path / 'named', '--params-file', str(file))
    assert found['lidars'] == both['lidars'] and both['lidars']['/scan_2']['skipped'] == 0
    assert trajectory(tmp_path / 'named', bag) == trajectory(tmp_path / 'given', bag)
    # The parameters of the results contain those of the lidars.
    front, rear = (tmp_path / 'named' / bag.name / 'latest' / 'parameters.yaml').read_text().split('    rear:\n')
    file.write_text(f'{front}    rear:\n{rear.replace("range_max: 0.0", "range_max: 0.5", 1)}')
    few = replayed(bag, tmp_path / 'few', '--params-file', str(file))['lidars']
    assert few['/scan']['skipped'] == 0 and few['/scan_2']['skipped'] == few['/scan_2']['scans'] > 20


def test_a_replay_names_the_mask_of_a_lidar_that_sees_the_robot_itself(tmp_path, capsys):
    world, poses, scans = rooms(seed=1), {'front': FRONT, 'rear': REAR}, {}
    for name, (x, y, degrees) in poses.items():
        body = ((0.5, 0.9, 0.3),) if name == 'rear' else ()
        lidar = Lidar(beams=360, angle_min=-math.pi + 0.01, rate=5.0, body=body, frame_id=name,
                      mounting=SE2(x, y, math.radians(degrees)))
        scans[f'/{name}'] = simulated(world, follow(world.tour[:4], speed=2.0), lidar, seed=1).scans
    bag, file = scan_bag(tmp_path / 'bag', scans), tmp_path / 'parameters.yaml'
    lines = [f'{name}: {{topic: /{name}, laser_pose: [{x}, {y}, {math.radians(degrees)}]}}'
             for name, (x, y, degrees) in poses.items()]
    file.write_text(f'/**: {{ros__parameters: {{sensors: [front, rear], {", ".join(lines)}}}}}')
    warning, = replayed(bag, tmp_path / 'out', '--params-file', str(file))['warnings']
    assert (warning['topic'], warning['kind']) == ('/rear', 'own_body')
    assert f'warning     /rear: {warning["text"]}\n' in capsys.readouterr().out
    values = re.search(r'; set rear\.mask to (\[.*\]), which includes a margin', warning['text'])[1]
    first, last, *others = json.loads(values)
    # The margin of 2 deg, the 2 deg of a sector and the distance of beams.
    assert 0.5 - 0.09 < first < 0.5 and 0.9 < last < 0.9 + 0.09 and not any(others)


@pytest.mark.parametrize('words, expected', [
    (('--topic', '/scan', '--topic', '/scan_2', '--params-file', 'own.yaml'),
     "no transform from 'base_footprint' to 'laser' is on /tf_static"),
    (('--topic', '/scan', '--topic', '/scan'), 'expected each topic once'),
    (('--topic', '/scan', '--topic', '/scan_3'), "no scans on '/scan_3'"),
    (('--topic', '/scan', '--mounting', '/scan', '1', '2'), 'expected NAME X Y DEG'),
    (('--topic', '/scan', '--mounting', '/scan', '1', '2', 'nan'), 'expected NAME X Y DEG')])
def test_what_cannot_be_used_is_named(pair, tmp_path, capsys, monkeypatch, words, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'own.yaml').write_text('/**: {ros__parameters: {base_frame: base_footprint}}')
    assert replay([str(pair), '--out', str(tmp_path), *words]) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize('topics', [('/scan', '/scan_2'), pytest.param(('/scan_2', '/scan'), marks=pytest.mark.long)],
                         ids=['second', 'first'])
def test_mask_and_time_offset_correct_the_lidar_that_sees_a_mast_and_stamps_late(scans, tmp_path, topics):
    """A mast 0.2 m from the rear lidar: the result is that of a punctual lidar without returns there."""
    bearings = scans['/scan_2'][0].geometry.bearings
    mast = (bearings > 1.71) & (bearings < 1.99)
    bags = {name: scan_bag(tmp_path / name, {'/scan': scans['/scan'], '/scan_2': [dataclasses.replace(
                with_ranges(scan, mast, value), stamp=scan.stamp + late) for scan in scans['/scan_2']]})
            for name, value, late in (('mast', 0.2, 60_000_000), ('hole', np.nan, 0))}
    own, offsets = [1.71, 1.99, *[0.0] * 6], [0.0 if topic == '/scan' else -0.06 for topic in topics]
    words = given(*topics)
    for name, each in (('all', own), ('each', [0.0] * 8 + own if topics[1] == '/scan_2' else own + [0.0] * 8)):
        mask = tmp_path / f'{name}.yaml'
        mask.write_text(f'/**: {{ros__parameters: {{scan_topics: [{", ".join(topics)}], '
                        f'input: {{mask: {each}, mask_range: 0.3, time_offset: {offsets}}}}}}}')
        replayed(bags['mast'], tmp_path / name, *words, '--params-file', str(mask))
    replayed(bags['mast'], tmp_path / 'seen', *words)
    replayed(bags['hole'], tmp_path / 'hole', *words)
    masked, each, seen = (trajectory(tmp_path / name, bags['mast']) for name in ('all', 'each', 'seen'))
    assert masked == each == trajectory(tmp_path / 'hole', bags['hole']) != seen


def test_each_line_on_a_lidar_names_it(scans, tmp_path, capsys):
    """Both lidars are covered for a while, and the rear one sends half of a scan."""
    front, rear = ([with_ranges(scan, np.full(scan.geometry.size, k in covered), 0.02)
                    for k, scan in enumerate(scans[topic])]
                   for topic, covered in (('/scan', (7,)), ('/scan_2', range(9, 14))))
    half = rear[20]
    g = type(half.geometry)(half.geometry.angle_min, half.geometry.angle_increment, 180, 0.05, 30.0)
    rear[20] = Scan(half.stamp, half.ranges[:180], g, half.time_increment, half.frame_id)
    bag = scan_bag(tmp_path / 'covered', {'/scan': front, '/scan_2': rear})
    found = replayed(bag, tmp_path / 'out', *given('/scan', '/scan_2'))
    lines = capsys.readouterr().out.splitlines()
    reason = '0 of 361 beams have a return; '
    # The number is that among the scans of both lidars.
    number = 7 + sum(scan.stamp < front[7].stamp for scan in rear)
    assert any(line.startswith(f'/scan: scan {number} not used: {reason}') for line in lines)
    assert any(line.startswith(f'lidar       /scan: scans 38 skipped 1 ok 37; the last skipped: {reason}')
               for line in lines)
    # The last scan of the rear lidar is later than that of the front one.
    rear = found['lidars']['/scan_2']
    assert rear['ignored'] + rear['ok'] == 40
    assert any(line.startswith(f'lidar       /scan_2: scans 45 skipped 5 ignored {rear["ignored"]} ok {rear["ok"]}, 1 '
                               f'not used, as before or after all scans of the first lidar; the last skipped: {reason}')
               for line in lines)
    assert any(line.startswith('warning     /scan_2: the scans change from 361 to 180 beams') for line in lines)
    assert found['lidars']['/scan_2']['skipped'] == 5 and found['lidars']['/scan']['skipped'] == found['skipped'] == 1
    assert [(warning['topic'], warning['kind']) for warning in found['warnings']] == [('/scan_2', 'beams')]


def test_the_lidars_of_a_parameter_file_are_used(scans, tmp_path, capsys):
    """``scan_topics`` as the node reads them, relative or not; --topic overrides them."""
    bag, file = scan_bag(tmp_path / 'bag', scans), tmp_path / 'two.yaml'
    file.write_text('/**: {ros__parameters: {scan_topics: [scan, /scan_2]}}')
    words = ['--params-file', str(file), *(word for topic, mounting in (('/scan', FRONT), ('/scan_2', REAR))
                                           for word in ('--mounting', topic, *map(str, mounting)))]
    both = replayed(bag, tmp_path / 'both', *words)
    output = capsys.readouterr()
    assert list(both['lidars']) == ['/scan', '/scan_2'] and 'has no effect' not in output.err
    one = replayed(bag, tmp_path / 'one', *words, '--topic', '/scan_2')
    assert one['topic'] == '/scan_2' and 'lidars' not in one


def test_the_processor_time_is_that_of_a_scan_of_any_lidar():
    """Two scans of the first lidar, the second after two of another one."""
    trajectory = Trajectory(used=[True, True], numbers=[0, 3], milliseconds=[2.0, 6.0], processor_seconds=0.008)
    assert trajectory.measures(1.0)['processor_ms_mean'] == pytest.approx(2.0)
