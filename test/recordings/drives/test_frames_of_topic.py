# SPDX-License-Identifier: Apache-2.0
"""Recordings in which two lidars publish on one topic, each with a frame of its own."""
import json
import math

import pytest
from bags import needs_rosbags, scan_bag, write_bag

from dbscan_reg_ros.commands.calibrate import main as calibrate
from dbscan_reg_ros.commands.register import main as register
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
from dbscan_reg_ros.recordings.message_fields import scan_fields
from dbscan_reg_ros.replays.lidars import Lidars
from dbscan_reg_ros.robot.parameters import NodeParameters
from dbscan_reg_ros.simulation import Lidar, follow, rooms
from dbscan_reg_ros.simulation import simulate as simulated

pytestmark = needs_rosbags
MOUNTINGS = {'front': SE2(0.3, 0.2, math.radians(45.0)), 'rear': SE2(-0.3, -0.2, math.radians(-135.0))}
BOTH = '/scan:front', '/scan:rear'
FRAMES_CHANGE = "the scans change from the frame 'front' to 'rear'"


@pytest.fixture(scope='module')
def drives():
    """Frame -> scans of a lidar; the rear one comes 19 ms after the front one, and with another period."""
    world = rooms(seed=5)
    path = follow(world.tour[:3], speed=1.0)
    lidars = (Lidar(361, math.radians(-135.0), math.radians(0.75), mounting=MOUNTINGS[frame], rate=rate, phase=phase,
                    frame_id=frame) for frame, rate, phase in (('front', 10.0, 0.0), ('rear', 7.0, 0.019)))
    return {lidar.frame_id: simulated(world, path, lidar, seed=5).scans for lidar in lidars}


def static_transforms(frames):
    half = {frame: 0.5 * MOUNTINGS[frame].theta for frame in frames}
    return bytes(MessageMaker().serialize('tf2_msgs/msg/TFMessage', {'transforms': [
        {'header': {'stamp': {'sec': 1, 'nanosec': 0}, 'frame_id': 'base_link'}, 'child_frame_id': frame,
         'transform': {'translation': {'x': MOUNTINGS[frame].x, 'y': MOUNTINGS[frame].y, 'z': 0.1},
                       'rotation': {'x': 0.0, 'y': 0.0, 'z': math.sin(half[frame]), 'w': math.cos(half[frame])}}}
        for frame in frames]}))


def bag_of(path, drives, topics, frames=tuple(MOUNTINGS)):
    """A bag of the scans of each frame on its topic of `topics`, and with the transforms of `frames`."""
    maker = MessageMaker()
    scans = [(topics[frame], scan.stamp, bytes(maker.serialize('sensor_msgs/msg/LaserScan', scan_fields(scan))))
             for frame, each in drives.items() for scan in each]
    messages = [('/tf_static', scans[0][1] - 1, static_transforms(frames)), *sorted(scans, key=lambda each: each[1])]
    return write_bag(path, messages, kinds={'/tf_static': 'tf2_msgs/msg/TFMessage'})


@pytest.fixture(scope='module')
def merged(drives, tmp_path_factory):
    return bag_of(tmp_path_factory.mktemp('merged') / 'drive', drives, {'front': '/scan', 'rear': '/scan'})


@pytest.fixture(scope='module')
def split(drives, tmp_path_factory):
    return bag_of(tmp_path_factory.mktemp('split') / 'drive', drives, {'front': '/a', 'rear': '/b'})


SPLIT = '--topic', '/a', '--topic', '/b'


def results(out):
    latest = out / 'drive' / 'latest'
    return json.loads((latest / 'metrics.json').read_text()), (latest / 'trajectory.tum').read_text()


def test_a_replay_equals_that_of_two_topics(merged, split, drives, tmp_path, capsys):
    assert replay([str(merged), '--out', str(tmp_path / 'merged')]) == 0
    text = capsys.readouterr().out
    assert replay([str(split), '--out', str(tmp_path / 'split'), *SPLIT]) == 0
    (one, poses), (two, expected) = results(tmp_path / 'merged'), results(tmp_path / 'split')
    assert poses == expected and len(poses.splitlines()) == len(drives['front'])
    assert [one['lidars'][name] for name in BOTH] == [two['lidars'][name] for name in ('/a', '/b')]
    assert one['warnings'] == [] and one['lidars']['/scan:rear']['ok'] > 10
    for name, frame in zip(BOTH, MOUNTINGS, strict=True):
        assert text.count(f"note        {name}: of the scans on /scan, those with the frame '{frame}'\n") == 1
        assert f'lidar       {name}: scans ' in text
    # The first frame is the first lidar; another order is chosen by names.
    assert replay([str(merged), '--out', str(tmp_path / 'other'), '--topic', BOTH[1], '--topic', BOTH[0]]) == 0
    assert results(tmp_path / 'other')[0]['lidars'].keys() == set(BOTH)
    assert len(results(tmp_path / 'other')[1].splitlines()) == len(drives['rear'])


def test_register_and_calibrate_use_both_as_of_two_topics(merged, split, capsys):
    texts = []
    for bag, words, names in ((merged, (), BOTH), (split, SPLIT, ('/a', '/b'))):
        assert register([str(bag), '20', '24', *words, '--no-figures']) == 0
        text = capsys.readouterr().out
        texts.append(text.replace(names[0], 'FRONT').replace(names[1], 'REAR'))
    assert texts[0] == texts[1] and 'current     scan 24, of the lidar on' in texts[0]
    assert calibrate([str(merged), '--topic', '/scan']) == 0
    assert capsys.readouterr().out.startswith('lidar       /scan:rear: ')


@pytest.mark.parametrize(('frames', 'words'), [
    (['rear'], ()), (MOUNTINGS, ('--mounting', '/scan', '0', '0', '0')),
    *(pytest.param(*case, marks=pytest.mark.long) for case in (
        (['front'], ()), (MOUNTINGS, ('--params-file', 'none.yaml'))))])
def test_without_the_transforms_of_all_frames_they_stay_one_lidar(drives, frames, words, tmp_path, monkeypatch, capsys):
    """Or with another mounting: then the change of the frame is a warning."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'none.yaml').write_text('/**: {ros__parameters: {mounting: none}}')
    few = {frame: scans[:12] for frame, scans in drives.items()}
    bag = bag_of(tmp_path / 'drive', few, {'front': '/scan', 'rear': '/scan'}, frames)
    assert replay([str(bag), '--out', str(tmp_path), *words]) == 0
    assert f'warning     {FRAMES_CHANGE}' in capsys.readouterr().out
    assert 'lidars' not in results(tmp_path)[0]


def test_one_frame_is_chosen_by_the_name_of_its_lidar(merged, drives, tmp_path):
    recording = open_recording(merged, '/scan:rear')
    assert (recording.topic, recording.frame_id, recording.count) == ('/scan:rear', 'rear', len(drives['rear']))
    assert recording.stamps() == [scan.stamp for scan in drives['rear']]
    assert recording.mounting_on('base_link').pose.x == pytest.approx(-0.3)
    assert [channel.recorded for channel in recording.channels()] == ['/tf_static']
    with pytest.raises(Exception, match=r"no scans on /scan have the frame 'top'; their frames: front, rear$"):
        open_recording(merged, '/scan:top')
    alone = scan_bag(tmp_path / 'alone', drives['front'][:3])
    assert Lidars().of_recording(alone, NodeParameters()) == Lidars()
