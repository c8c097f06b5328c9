# SPDX-License-Identifier: Apache-2.0
"""Recordings of a 3D lidar on a tilted mast: they are read as the node reads its messages."""
import importlib
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from bags import needs_rosbags, write_bag

from dbscan_reg_ros.commands.competitors import Competitor, follow_one
from dbscan_reg_ros.commands.register import main as register
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.errors import RecordingError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.bags.clouds import CloudParameters
from dbscan_reg_ros.recordings.conversion import Kept, convert
from dbscan_reg_ros.recordings.message_fields import header_fields, pose_only_fields, scan_fields
from dbscan_reg_ros.replays.lidars import Lidars
from dbscan_reg_ros.robot.parameters import NodeParameters
from dbscan_reg_ros.robot.point_cloud import scan_from_cloud
from dbscan_reg_ros.tuning.objective import cost_of

pytestmark = needs_rosbags

CLOUD, TRANSFORMS, ODOMETRY = 'sensor_msgs/msg/PointCloud2', 'tf2_msgs/msg/TFMessage', 'nav_msgs/msg/Odometry'
KINDS = {'/points': CLOUD, '/tf_static': TRANSFORMS, '/truth': ODOMETRY}
PITCH, MAST, COUNT = math.radians(30.0), (0.2, -0.1, 0.8), 45
FORM = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('t', '<u4')])
HEIGHTS = 0.0, 0.3, 0.9, 2.4
"""Heights of the returns above the floor [m]: at 40 % of the distance on floor and ceiling, else on the walls."""


def matrix():
    c, s = math.cos(PITCH), math.sin(PITCH)
    return np.array(((c, 0.0, s, MAST[0]), (0.0, 1.0, 0.0, MAST[1]), (-s, 0.0, c, MAST[2]), (0.0, 0.0, 0.0, 1.0)))


def cloud(scan, ceiling=True):
    """The fields of a message of the lidar on the mast, which sees the walls that `scan` sees."""
    flat = scan.points[scan.valid]
    times = (scan.time_increment * 1e9 * scan.valid.nonzero()[0]).astype(int)
    points = np.concatenate([np.column_stack((flat * (1.0 if 0.0 < z < 2.0 else 0.4), np.full(len(flat), z - MAST[2])))
                             for z in HEIGHTS if ceiling or z < 0.1])
    rows = np.zeros(len(points), dtype=FORM)
    for name, values in zip('xyz', (points @ matrix()[:3, :3]).T, strict=True):
        rows[name] = values
    rows['t'] = np.tile(times, len(points) // len(times))
    codes = {'<f4': 7, '<u4': 6}
    fields = [{'name': name, 'offset': offset, 'datatype': codes[kind.str], 'count': 1}
              for name, (kind, offset) in FORM.fields.items()]
    return {'header': header_fields(scan.stamp, 'mast'), 'height': 1, 'width': len(rows), 'fields': fields,
            'point_step': FORM.itemsize, 'row_step': FORM.itemsize * len(rows),
            'data': np.frombuffer(rows.tobytes(), dtype=np.uint8)}


def placed(child, position, pitch=0.0):
    return {'header': header_fields(1, 'base_link'), 'child_frame_id': child,
            'transform': {'translation': dict(zip('xyz', position, strict=True)),
                          'rotation': {'y': math.sin(pitch / 2.0), 'w': math.cos(pitch / 2.0)}}}


def write(path, messages):
    """A bag of (topic, stamp, fields), each of one of the `KINDS`, else a LaserScan."""
    from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
    maker = MessageMaker()
    kinds = {topic: KINDS.get(topic, 'sensor_msgs/msg/LaserScan') for topic, *_ in messages}
    return write_bag(path, [(topic, stamp, bytes(maker.serialize(kinds[topic], fields)))
                            for topic, stamp, fields in messages], kinds=kinds)


@pytest.fixture(scope='module')
def drive_scans(drive):
    return drive.scans[:COUNT]


@pytest.fixture(scope='module')
def bag(tmp_path_factory, drive, drive_scans):
    """Point clouds, a laser scanner at the same position, the transforms and the true poses of the base."""
    base = [SE2.from_array(pose) @ SE2(*MAST[:2]).inverse() for pose in drive.truth[:COUNT]]
    start = drive_scans[0].stamp
    return write(tmp_path_factory.mktemp('mast') / 'mast', [
        ('/tf_static', start, {'transforms': [placed('mast', MAST, PITCH), placed('laser', MAST)]}),
        *((topic, scan.stamp, fields) for scan, pose in zip(drive_scans, base, strict=True)
          for topic, fields in (('/points', cloud(scan)), ('/scan', scan_fields(scan)),
                                ('/truth', pose_only_fields(scan.stamp, 'base_link', pose.as_array(), 'map'))))])


def replayed(out, bag, *words):
    """Measures, stamps [ns] and poses of a replay."""
    assert replay([str(bag), '--out', str(out), *words]) == 0
    folder = out / bag.name / 'latest'
    rows = np.loadtxt(folder / 'trajectory.tum')
    return json.loads((folder / 'metrics.json').read_text()), rows


def test_point_clouds_become_the_scans_of_the_node(bag, drive_scans):
    recording = open_recording(bag, '/points', CloudParameters.of())
    assert recording.frame_id == 'mast' and recording.mounting.pose == SE2(*MAST[:2])
    found = list(recording.scans())
    for scan, flat in zip(found, drive_scans, strict=True):
        fields = cloud(flat)
        stamp = SimpleNamespace(**fields['header']['stamp'])
        message = SimpleNamespace(**(fields | {'is_bigendian': False, 'fields': [
            SimpleNamespace(**each) for each in fields['fields']], 'header': SimpleNamespace(
                frame_id='mast', stamp=stamp)}))
        expected = scan_from_cloud(message, matrix(), NodeParameters().input)
        assert scan.stamp == expected.stamp and scan.time_increment == expected.time_increment
        np.testing.assert_allclose(scan.ranges, expected.ranges, rtol=1e-6)


def test_a_replay_of_point_clouds_finds_the_motion_that_the_laser_scans_give(bag, tmp_path):
    clouds, of_clouds = replayed(tmp_path / 'clouds', bag, '--topic', '/points')
    flat, of_scans = replayed(tmp_path / 'flat', bag, '--topic', '/scan')
    assert clouds['scans'] == clouds['ok'] == flat['ok'] == COUNT
    assert np.hypot(*(of_clouds - of_scans)[:, 1:3].T).max() < 0.02
    assert np.hypot(*(of_clouds[-1] - of_clouds[0])[1:3]) > 1.0


def test_true_poses_of_the_base_become_those_of_the_scans(bag, drive):
    truth = open_recording(bag, '/points', CloudParameters.of()).truth()
    np.testing.assert_allclose(truth[1], drive.truth[:COUNT], atol=1e-9)


def test_a_point_cloud_and_a_scan_are_two_lidars(bag, tmp_path):
    measures, _ = replayed(tmp_path, bag, '--topic', '/scan', '--topic', '/points')
    found = measures['lidars']['/points']
    assert found['ok'] > 10 and found['ok'] + found['ignored'] > 0.9 * COUNT


def test_laser_scans_are_taken_where_no_topic_is_named(bag):
    assert open_recording(bag, None, CloudParameters.of()).topic == '/scan'


@pytest.mark.parametrize('parameters, position', [
    ({'mounting': 'none', 'input.height_min': -0.6, 'input.height_max': 0.7}, (0.0, 0.0)),
    ({'mounting': 'laser_pose', 'laser_pose': (0.3, 0.4, 0.5), 'input.height_min': -0.6}, (0.3, 0.4))])
def test_the_mounting_may_be_a_parameter(bag, parameters, position):
    recording = open_recording(bag, '/points', CloudParameters.of(NodeParameters().replace(parameters), '/points'))
    assert recording.mounting.pose == SE2(*position)


def test_commands_take_point_clouds(bag, tmp_path, capsys):
    assert register([str(bag), '0', '5', '--topic', '/points', '--no-figures']) == 0
    assert 'status      ok' in capsys.readouterr().out
    competitor, lidars = Competitor.named('defaults'), Lidars(('/points',))
    trajectory = follow_one(bag, lidars, competitor, competitor.parameters)
    assert trajectory.used == [True] * COUNT
    assert cost_of(bag, lidars, NodeParameters(), 'truth') < 0.01


@pytest.mark.parametrize('given, expected', [
    ('base_frame: base_footprint', "no transform from 'base_footprint' to 'mast' is on /tf_static"),
    ('input: {height_min: 3.0, height_max: 4.0}', 'no point between input.height_min = 3 m and input.height_max = '
     '4 m; the heights of its points in base_frame are from 0.00 m to 2.40 m')])
def test_what_is_missing_is_named(bag, tmp_path, capsys, given, expected):
    file = tmp_path / 'own.yaml'
    file.write_text(f'/**: {{ros__parameters: {{{given}}}}}')
    assert replay([str(bag), '--topic', '/points', '--out', str(tmp_path), '--params-file', str(file)]) == 2
    assert expected in capsys.readouterr().err


def test_a_ros_1_bag_gives_the_same_scans(bag, tmp_path):
    old = tmp_path / 'old.bag'
    convert(bag, old, Kept(end=0.45))
    found, expected = (open_recording(path, '/points', CloudParameters.of()) for path in (old, bag))
    assert found.mounting == expected.mounting
    for scan, same in zip(found.scans(), expected.scans(), strict=False):
        assert scan.stamp == same.stamp
        np.testing.assert_array_equal(scan.ranges, same.ranges)


@pytest.mark.parametrize('command, words', [
    ('play', ['--lockstep']), ('demo', ['--out', 'out']), ('convert', ['new.log'])])
def test_where_point_clouds_are_not_read_the_command_names_what_to_use(bag, tmp_path, monkeypatch, capsys, command,
                                                                       words):
    if command == 'play':
        pytest.importorskip('rclpy')
    monkeypatch.chdir(tmp_path)
    main = importlib.import_module(f'dbscan_reg_ros.commands.{command}').main
    assert main([str(bag), *words, '--topic', '/points']) == 2 and not list(tmp_path.iterdir())
    assert capsys.readouterr().err == (
        f'{command}: {bag}: /points has point clouds (sensor_msgs/msg/PointCloud2), but laser scans are expected here; '
        'replay, compare, tune, register and calibrate read point clouds, ros2 bag play sends them to a node, and the '
        'ROS package pointcloud_to_laserscan makes laser scans of them\n')


def test_point_clouds_are_copied_from_bag_to_bag_and_need_no_topic_to_be_refused(bag, tmp_path):
    counts, _ = convert(bag, tmp_path / 'points', Kept(topics=('/points', '/tf_static'), end=0.45))
    assert counts['/points'] >= 4
    with pytest.raises(RecordingError, match=': /points has point clouds'):
        open_recording(tmp_path / 'points')
