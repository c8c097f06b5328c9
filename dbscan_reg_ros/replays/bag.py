# SPDX-License-Identifier: Apache-2.0
"""Bag of the messages that the node would have published for a recording."""
from contextlib import contextmanager

from ..recordings.conversion import bag_writer
from ..recordings.message_fields import odometry_fields, segments_fields, transform_fields
from ..robot.base_state import base_state

TOPICS = {'/odom': 'nav_msgs/msg/Odometry', '/tf': 'tf2_msgs/msg/TFMessage',
          '/segments': 'visualization_msgs/msg/MarkerArray'}

AT_A_TIME = 50
"""Scans that are written together."""


@contextmanager
def odometry_bag(path, parameters, mounting):
    """Write a bag; provide the function that adds the messages of an `OdometryUpdate`.

    The record times are the stamps, made to increase where they go back. When the writing is interrupted, what was
    written until then is a valid bag. Some scans are written at a time: the odometry in between leaves nothing of what
    writes them in the processor's caches, and of one by one most of the time would go by waiting for memory.

    Parameters
    ----------
    path : Path
        Of the bag's folder, which is made.
    parameters : NodeParameters
        Name the frames.
    mounting : Mounting
        The laser's; the updates are those of a sensor at `mounting.aligned_pose`.
    """
    place = mounting.aligned_pose
    frames = parameters.odom_frame, parameters.base_frame
    with bag_writer(path) as (writer, serialize):
        added = {topic: writer.add_topic(topic, kind) for topic, kind in TOPICS.items()}
        time, waiting = -1, []

        def write():
            nonlocal time
            while waiting:
                update = waiting.pop(0)
                time = max(update.stamp, time + 1)
                state = base_state(update, place, place)
                fields = {'/odom': odometry_fields(state, *frames),
                          '/tf': {'transforms': [transform_fields(state, *frames)]},
                          '/segments': segments_fields(update, place, parameters.odom_frame)}
                for topic, kind in TOPICS.items():
                    writer.write(added[topic], time, serialize(kind, fields[topic]))

        def add(update):
            waiting.append(update)
            if len(waiting) == AT_A_TIME:
                write()

        try:
            yield add
        finally:
            write()
