# SPDX-License-Identifier: Apache-2.0
"""Bag of the messages that the node would have published for a recording."""
from contextlib import contextmanager

from ..recordings.conversion import bag_writer
from ..recordings.message_fields import odometry_fields, segments_fields, transform_fields
from ..requirements import is_there
from ..robot.base_state import base_state

TOPICS = {'/odom': 'nav_msgs/msg/Odometry', '/tf': 'tf2_msgs/msg/TFMessage',
          '/segments': 'visualization_msgs/msg/MarkerArray'}
BAG_LIBRARIES = 'rosbags', 'rosbag2_py'
"""Python packages that write bags; one is enough, and without both a replay writes no bag."""


def writes_bags() -> bool:
    """Whether one of the `BAG_LIBRARIES` is installed."""
    return any(map(is_there, BAG_LIBRARIES))


@contextmanager
def odometry_bag(path, parameters, mounting):
    """Open a bag for writing; provide a function that adds the messages of an `OdometryUpdate` to the bag.

    The record times are the stamps of the messages, increased where a stamp is before the last one. When the writing is
    interrupted, the messages written until then form a valid bag. The `parameters` have the names of the frames; each
    update belongs to a sensor at `mounting.aligned_pose`.
    """
    place = mounting.aligned_pose
    frames = parameters.odom_frame, parameters.base_frame
    with bag_writer(path) as (writer, serialize):
        added = {topic: writer.add_topic(topic, kind) for topic, kind in TOPICS.items()}
        time = -1

        def add(update):
            nonlocal time
            time = max(update.stamp, time + 1)
            state = base_state(update, place, place)
            fields = {'/odom': odometry_fields(state, *frames),
                      '/tf': {'transforms': [transform_fields(state, *frames)]},
                      '/segments': segments_fields(update, place, parameters.odom_frame)}
            for topic, kind in TOPICS.items():
                writer.write(added[topic], time, serialize(kind, fields[topic]))

        yield add
