# SPDX-License-Identifier: Apache-2.0
"""The node's parameters: its own, and those of the method."""
import dataclasses
import math
from dataclasses import dataclass

from ..core.errors import ParameterError
from ..core.parameters.odometry import PriorParameters
from ..core.parameters.schema import ParameterGroup, parameter
from ..core.parameters.tree import Parameters

MOUNTINGS = ('none', 'laser_pose', 'tf')
SOURCES = ('none', 'constant_velocity', 'odometry', 'imu', 'tf')
SECTORS = 4
METHOD = frozenset(each.name for each in Parameters.describe())
"""Full names of the parameters of the method."""
REPLAYED = METHOD | {'odom_frame', 'base_frame', 'mounting', 'laser_pose', 'upside_down'}
"""Full names of what a replay goes by."""
OFFLINE = ('prior.source', 'none'), ('mounting', 'none')
"""What is so offline in any case."""


@dataclass(frozen=True)
class InputParameters(ParameterGroup):
    """Which scans are used, and which of their beams."""

    every_nth: int = parameter(1, 'only one scan in so many is used', 'scans', 1, 1000)
    queue_size: int = parameter(3, 'so many scans may wait; when there are more, the oldest are dropped', 'scans', 1, 50)
    max_wait: float = parameter(0.05, 'a scan waits at most this long for what is to be known at its stamp: a moving '
                            'mounting, or the motion that prior.source tells', 's', 0.0, 10.0)
    mask: tuple = parameter((0.0,) * 2 * SECTORS, 'up to four sectors that see the robot itself: first and last bearing of '
                            'each, counter-clockwise in the frame of the scans; equal ones are no sector', 'rad', -6.3, 6.3)
    mask_range: float = parameter(0.0, 'returns in the sectors of input.mask are ignored when nearer than this; 0: all '
                                  'of them', 'm', 0.0, 1000.0)


@dataclass(frozen=True)
class NodePriorParameters(PriorParameters):
    """And who tells of the motion before the scans are looked at."""

    source: str = parameter(
        'constant_velocity', 'what tells the motion since the last scan: none (nothing, whatever odometry.prior says), '
        'constant_velocity (it goes on as before, as odometry.prior says), odometry (the topic wheel_odom), imu (the yaw '
        'rate on the topic imu; otherwise as before), tf (the base in the frame prior.frame); when one of the last three is '
        'quiet, it goes on as before', choices=SOURCES, read_only=True)
    frame: str = parameter('wheel_odom', 'an odometry frame on /tf that somebody else publishes, for source tf',
                           read_only=True)
    translation: float = parameter(0.1, 'odometry, tf: standard deviation of the way told, as a share of it', '', 0.0, 10.0)
    translation_by_turn: float = parameter(0.1, 'at least so much for a turn of 1 rad', 'm/rad', 0.0, 10.0)
    translation_min: float = parameter(0.02, 'and at least this', 'm', 0.0001, 10.0)
    rotation: float = parameter(0.2, 'standard deviation of the turn told, as a share of it', '', 0.0, 10.0)
    rotation_by_distance: float = parameter(0.1, 'odometry, tf: at least so much for a way of 1 m', 'rad/m', 0.0, 10.0)
    rotation_min: float = parameter(0.03, 'and at least this', 'rad', 0.0001, 3.2)

    def wheel_sigma(self, motion):
        """Standard deviations [m, m, rad] of a `motion` (`SE2`) that is told, in the frame that it ends in."""
        way, turn = math.hypot(motion.x, motion.y), abs(motion.theta)
        translation = max(self.translation_min, self.translation * way, self.translation_by_turn * turn)
        rotation = max(self.rotation_min, self.rotation * turn, self.rotation_by_distance * way)
        return translation, translation, rotation


@dataclass(frozen=True)
class PathParameters(ParameterGroup):
    """The topic path."""

    step: float = parameter(0.1, 'a pose is added when the base has moved so far', 'm', 0.0, 100.0)
    size: int = parameter(2000, 'most poses; the oldest are forgotten', '', 2, 100000)


@dataclass(frozen=True)
class SnapshotParameters(ParameterGroup):
    """The service ~/snapshot."""

    scans: int = parameter(20, 'so many of the last scans are written', 'scans', 1, 1000)
    folder: str = parameter('~/.ros', 'folder that the files are written to', read_only=True)


@dataclass(frozen=True)
class NodeParameters(Parameters):
    """All parameters of `scan_matcher`; being `Parameters`, they are handed to the odometry as they are."""

    odom_frame: str = parameter('odom', 'frame in which the pose is given; it starts where the base is at the first scan',
                                read_only=True)
    base_frame: str = parameter('base_link', 'frame whose pose and twist are published', read_only=True)
    publish_tf: bool = parameter(True, 'send the transform between odom_frame and base_frame on /tf')
    invert_tf: bool = parameter(False, 'send it with odom_frame as the child of base_frame, for a base_frame that has '
                                'another parent already', read_only=True)
    mounting: str = parameter(
        'tf', 'where the laser sits on the base: tf (as the transform from base_frame to the frame of the scans says), '
        'laser_pose (as that parameter says) or none (the laser is the base)', choices=MOUNTINGS, read_only=True)
    laser_pose: tuple = parameter((0.0, 0.0, 0.0), 'x [m], y [m] and yaw [rad] of the laser on the base, '
                                  'for mounting laser_pose', '', -1000.0, 1000.0, read_only=True)
    upside_down: bool = parameter(False, 'the laser hangs upside down, for mounting laser_pose', read_only=True)
    input: InputParameters = dataclasses.field(default_factory=InputParameters)
    prior: NodePriorParameters = dataclasses.field(default_factory=NodePriorParameters)
    path: PathParameters = dataclasses.field(default_factory=PathParameters)
    snapshot: SnapshotParameters = dataclasses.field(default_factory=SnapshotParameters)

    def __post_init__(self):
        super().__post_init__()
        for name, frame in (('odom_frame', self.odom_frame), ('base_frame', self.base_frame),
                            ('prior.frame', self.prior.frame)):
            if not frame or frame.startswith('/'):
                raise ParameterError(f'{name} = {frame!r}: expected the name of a frame, without a leading slash')
        if self.odom_frame == self.base_frame:
            raise ParameterError(f'odom_frame = base_frame = {self.base_frame!r}: expected two different frames')
        if self.prior.source == 'tf' and self.prior.frame in (self.odom_frame, self.base_frame):
            raise ParameterError(f'prior.frame = {self.prior.frame!r}: expected an odometry frame of somebody else, '
                                 'neither odom_frame nor base_frame')

    def for_odometry(self) -> Parameters:
        """What the odometry is to go by: without any prior, `odometry.prior` does not count."""
        return self.replace({'odometry.prior': 'none'}) if self.prior.source == 'none' else self

    def unused(self, used) -> list:
        """Full names of those that differ from their defaults though what runs offline goes by those named in `used` only."""
        values = self.flatten()
        return [d.name for d in self.describe() if d.name not in used and values[d.name] != d.default
                and (d.name, values[d.name]) not in OFFLINE]


def is_ros_parameter(name) -> bool:
    """Whether every ROS node has the parameter `name`: a file may set it, the method does not know it."""
    return name in ('use_sim_time', 'start_type_description_service') or name.startswith('qos_overrides.')
