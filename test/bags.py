# SPDX-License-Identifier: Apache-2.0
"""Small bags for tests, and what a bag and the results of a replay hold."""
import importlib.util
import json

import numpy as np
import pytest

SECOND = 1_000_000_000

needs_rosbags = pytest.mark.skipif(importlib.util.find_spec('rosbags') is None,
                                   reason='needs the Python package rosbags')


def write_bag(path, messages, storage='mcap', kinds=None, store=None):
    """A ROS 2 bag of (topic, record time [ns], message or raw bytes).

    A raw message passes for a LaserScan, unless `kinds` (topic -> type) says otherwise.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore
    store = store or get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        connections = {}
        for topic, time, message in messages:
            kind = getattr(message, '__msgtype__', (kinds or {}).get(topic, 'sensor_msgs/msg/LaserScan'))
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            raw = message if isinstance(message, bytes) else store.serialize_cdr(message, kind)
            writer.write(connections[topic], time, raw)
    return path


def scan_bag(path, scans):
    """A ROS 2 bag of `scans` on /scan, or of a dictionary topic -> scans, each recorded at its stamp."""
    from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
    from dbscan_reg_ros.recordings.message_fields import scan_fields
    maker = MessageMaker()
    of_topics = scans if isinstance(scans, dict) else {'/scan': scans}
    return write_bag(path,
                     [(topic, scan.stamp, bytes(maker.serialize('sensor_msgs/msg/LaserScan', scan_fields(scan))))
                      for topic, each in of_topics.items() for scan in each])


def open_bag(path):
    """A bag of either version, with the messages of Jazzy where it does not say what its own are."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore
    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))


def messages(path, *topics):
    """Topic, record time [ns] and message of everything in a bag, or on the topics."""
    with open_bag(path) as reader:
        return [(each.topic, time, reader.deserialize(raw, each.msgtype)) for each, time, raw in reader.messages()
                if each.topic in topics or not topics]


def replayed(recording, out, *words):
    """The measures of a replay into the folder `out`."""
    from dbscan_reg_ros.commands.replay import main
    assert main([str(recording), '--out', str(out), *map(str, words)]) == 0
    return json.loads((out / recording.name / 'latest' / 'metrics.json').read_text())


def every_format(folder, scans=8):
    """Write `log.log` and what it becomes in every other format, and `other.log` of another lidar."""
    from dbscan_reg_ros.recordings.conversion import convert, write_log
    from dbscan_reg_ros.recordings.recording import Record
    from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate
    world = rooms(seed=1)
    for name, beams in (('log', 90), ('other', 121)):
        drive = simulate(world, follow(world.tour[:3], speed=1.0), Lidar(beams=beams, angle_min=-2.0), seed=1)
        write_log(folder / f'{name}.log', [Record(scan, tuple(pose), (0.0, 0.0, 0.0))
                                           for scan, pose in zip(drive.scans[:scans], drive.truth, strict=False)])
    for name, storage in (('log.log.gz', 'mcap'), ('log.bag', 'mcap'), ('mcap', 'mcap'), ('db3', 'sqlite3')):
        convert(folder / 'log.log', folder / name, storage=storage)


def laser_scan(stamp=5 * SECOND + 7, n=5, angle_min=-0.5, increment=0.25):
    from rosbags.typesys import Stores, get_typestore
    types = get_typestore(Stores.ROS2_JAZZY).types
    header = types['std_msgs/msg/Header'](
        stamp=types['builtin_interfaces/msg/Time'](sec=stamp // SECOND, nanosec=stamp % SECOND), frame_id='front')
    return types['sensor_msgs/msg/LaserScan'](
        header=header, angle_min=angle_min, angle_max=99.0, angle_increment=increment, time_increment=0.0,
        scan_time=0.1, range_min=0.1, range_max=10.0, ranges=np.arange(1, n + 1, dtype=np.float32),
        intensities=np.zeros(0, dtype=np.float32))


def text(content):
    from rosbags.typesys import Stores, get_typestore
    return get_typestore(Stores.ROS2_JAZZY).types['std_msgs/msg/String'](data=content)
