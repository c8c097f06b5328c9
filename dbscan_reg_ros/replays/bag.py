"""What the node would have published on a recording, as a ROS 2 bag."""
from contextlib import contextmanager

from ..message_fields import odometry_fields, segments_fields, transform_fields
from ..node.mounting import base_state
from ..recordings.conversion import bag_writer
from ..recordings.messages import MessageMaker

TOPICS = {'/odom': 'nav_msgs/msg/Odometry', '/tf': 'tf2_msgs/msg/TFMessage',
          '/segments': 'visualization_msgs/msg/MarkerArray'}


@contextmanager
def odometry_bag(path, parameters, mounting):
    """Write a bag; gives the function that adds the messages of an `OdometryUpdate`.

    The record times are the stamps, made to increase where they go back. When the writing is interrupted, what was
    written until then is a valid bag.

    Parameters
    ----------
    path : Path
        Of the bag's folder, which is made.
    parameters : NodeParameters
        Name the frames.
    mounting : Mounting
        The laser's; the updates are those of a sensor at `mounting.place`.
    """
    place = mounting.place
    frames = parameters.odom_frame, parameters.base_frame
    maker = MessageMaker()
    with bag_writer(path) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=maker.store)
                       for topic, kind in TOPICS.items()}
        time = -1

        def add(update):
            nonlocal time
            time = max(update.stamp, time + 1)
            state = base_state(update, place, place)
            fields = {'/odom': odometry_fields(state, *frames),
                      '/tf': {'transforms': [transform_fields(state, *frames)]},
                      '/segments': segments_fields(update, place, parameters.odom_frame)}
            for topic, kind in TOPICS.items():
                writer.write(connections[topic], time, maker.serialize(kind, fields[topic]))

        yield add
