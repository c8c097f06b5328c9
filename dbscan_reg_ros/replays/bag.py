"""What the node would have published on a recording, as a ROS 2 bag."""
from contextlib import contextmanager

from ..core.errors import ParameterError
from ..core.se2 import SE2
from ..message_fields import odometry_fields, segments_fields, transform_fields
from ..node.mounting import base_state
from ..recordings.conversion import bag_writer
from ..recordings.messages import MessageMaker

TOPICS = {'/odom': 'nav_msgs/msg/Odometry', '/tf': 'tf2_msgs/msg/TFMessage',
          '/segments': 'visualization_msgs/msg/MarkerArray'}


@contextmanager
def odometry_bag(path, parameters):
    """Write a bag; gives the function that adds the messages of an `OdometryUpdate`.

    The record times are the stamps, made to increase where they go back. When the writing is interrupted, what was
    written until then is a valid bag.

    Parameters
    ----------
    path : Path
        Of the bag's folder, which is made.
    parameters : NodeParameters
        Name the frames and the laser's place on the base (``mounting: laser_pose``; otherwise it is the base).

    Raises
    ------
    ParameterError
        When the laser hangs upside down: a replay takes the scans as they are.
    """
    if parameters.mounting == 'laser_pose' and parameters.upside_down:
        raise ParameterError('upside_down = True: a replay takes the laser as upright; set it to false')
    origin = SE2(*parameters.laser_pose) if parameters.mounting == 'laser_pose' else SE2()
    frames = parameters.odom_frame, parameters.base_frame
    maker = MessageMaker()
    with bag_writer(path) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=maker.store)
                       for topic, kind in TOPICS.items()}
        time = -1

        def add(update):
            nonlocal time
            time = max(update.stamp, time + 1)
            state = base_state(update, origin, origin)
            fields = {'/odom': odometry_fields(state, *frames),
                      '/tf': {'transforms': [transform_fields(state, *frames)]},
                      '/segments': segments_fields(update, origin, parameters.odom_frame)}
            for topic, kind in TOPICS.items():
                writer.write(connections[topic], time, maker.serialize(kind, fields[topic]))

        yield add
