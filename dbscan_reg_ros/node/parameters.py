"""The node's parameters: its own, which have no group, and those of the method."""
from dataclasses import dataclass

from ..core.errors import ParameterError
from ..core.parameters import Parameters, parameter

MOUNTINGS = ('none', 'laser_pose', 'tf')


@dataclass(frozen=True)
class NodeParameters(Parameters):
    """All parameters of `scan_matcher`; being `Parameters`, they are handed to the odometry as they are."""

    odom_frame: str = parameter('odom', 'frame in which the pose is given; it starts where the base is at the first scan',
                                read_only=True)
    base_frame: str = parameter('base_link', 'frame whose pose and twist are published', read_only=True)
    publish_tf: bool = parameter(True, 'send the transform from odom_frame to base_frame on /tf')
    mounting: str = parameter(
        'none', 'where the laser sits on the base: none (the laser is the base), laser_pose (as that parameter says) '
        'or tf (as the transform from base_frame to the frame of the scans says)', choices=MOUNTINGS, read_only=True)
    laser_pose: tuple = parameter((0.0, 0.0, 0.0), 'x [m], y [m] and yaw [rad] of the laser on the base, '
                                  'for mounting laser_pose', '', -1000.0, 1000.0, read_only=True)
    upside_down: bool = parameter(False, 'the laser hangs upside down, for mounting laser_pose', read_only=True)

    def __post_init__(self):
        super().__post_init__()
        for name in ('odom_frame', 'base_frame'):
            frame = getattr(self, name)
            if not frame or frame.startswith('/'):
                raise ParameterError(f'{name} = {frame!r}: expected the name of a frame, without a leading slash')
        if self.odom_frame == self.base_frame:
            raise ParameterError(f'odom_frame = base_frame = {self.base_frame!r}: expected two different frames')


def is_ros_parameter(name) -> bool:
    """Whether every ROS node has the parameter `name`: a file may set it, the method does not know it."""
    return name in ('use_sim_time', 'start_type_description_service') or name.startswith('qos_overrides.')
