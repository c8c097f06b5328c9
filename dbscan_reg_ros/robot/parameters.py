# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node, including the parameters of the registration method."""
import dataclasses
import math
from collections.abc import Collection
from dataclasses import dataclass

from ..core.errors import ParameterError
from ..core.geometry.se2 import SE2
from ..core.parameters.odometry import PriorParameters
from ..core.parameters.schema import ParameterGroup, parameter
from ..core.parameters.tree import Parameters

MOUNTINGS = ('none', 'laser_pose', 'tf')
SOURCES = ('none', 'constant_velocity', 'odometry', 'imu', 'tf')
SECTORS = 4
LASER_SCAN, POINT_CLOUD = 'sensor_msgs/LaserScan', 'sensor_msgs/PointCloud2'
METHOD = frozenset(each.name for each in Parameters.describe())
"""Full names of the parameters of the method."""
REPLAYED = METHOD | {'odom_frame', 'base_frame', 'mounting', 'laser_pose', 'upside_down', 'input.mask',
                     'input.mask_range', 'input.time_offset', 'input.type', 'input.height_min', 'input.height_max',
                     'input.bearing_step'}
"""Full names of the parameters that a replay uses."""
OFFLINE = ('prior.source', 'none'), ('mounting', 'none')
"""Names and values of parameters that have no effect on a replay, and so need no warning."""


@dataclass(frozen=True)
class InputParameters(ParameterGroup):
    """Selection of the scans that are processed, and of the beams that are used."""

    BASIC = ('every_nth', 'queue_size', 'max_wait', 'mask', 'mask_range', 'time_offset', 'type', 'height_min',
             'height_max', 'bearing_step')

    every_nth: int = parameter(
        1, unit='scans', bounds=(1, 1000),
        help='Only every n-th scan is used, where n is this value. Larger values save computing time and lengthen the '
             'motion between the scans used; 1 uses every scan.')
    queue_size: int = parameter(
        3, unit='scans', bounds=(1, 50),
        help='Number of scans that may wait to be processed; if more wait, the oldest are dropped. Larger values drop '
             'fewer scans when the computer is busy and delay the pose; smaller values keep the delay short.')
    max_wait: float = parameter(
        0.05, unit='s', bounds=(0.0, 10.0),
        help='Longest time that a scan waits until the transform of a moving sensor, or the external prior, is known '
             'at the stamp of the scan. It should exceed the period of the source of the prior. Larger values tolerate '
             'slower sources and delay the pose; 0 never waits.')
    mask: tuple[float, ...] = parameter(
        (0.0,) * 2 * SECTORS, unit='rad', bounds=(-6.3, 6.3),
        help='Up to four sectors in which the lidar sees the robot itself: first and last bearing of each sector, '
             'counter-clockwise in the frame of the scans. Two equal bearings define no sector. Eight numbers apply to '
             'every lidar; with several lidars there may be eight for each, in the order of scan_topics.')
    mask_range: float = parameter(
        0.0, unit='m', bounds=(0.0, 1000.0),
        help='Returns in the sectors of input.mask are ignored when their range is below this. Larger values ignore '
             'more returns; 0 ignores all returns in the sectors.')
    time_offset: tuple[float, ...] = parameter(
        (0.0,), unit='s', bounds=(-10.0, 10.0),
        help='Added to the stamps of the scans when they arrive, except to stamps of 0. A driver that stamps its scans '
             'too late needs a negative value. One number applies to every lidar; with several lidars there may be one '
             'for each, in the order of scan_topics.')
    type: str = parameter(
        'auto', choices=('auto', LASER_SCAN, POINT_CLOUD), read_only=True,
        help='Type of the messages of the lidar; with auto it is the type that is published on the topic. Of a '
             'sensor_msgs/PointCloud2 the points between input.height_min and input.height_max are used.')
    height_min: float = parameter(
        0.2, unit='m', bounds=(-1000.0, 1000.0),
        help='Points of a point cloud below this height in base_frame are ignored. Larger values also ignore low '
             'objects; values near the floor take the floor of a slope for a wall.')
    height_max: float = parameter(
        1.5, unit='m', bounds=(-1000.0, 1000.0),
        help='Points of a point cloud above this height in base_frame are ignored. Larger values see walls above '
             'furniture and people, and whatever hangs from the ceiling; smaller values use fewer points.')
    bearing_step: float = parameter(
        0.0087, unit='rad', bounds=(0.0005, 0.1),
        help='Angle between two beams of the scan that is made of a point cloud; each beam has the nearest point of '
             'this angle. Larger values save computing time; values below the step of the lidar give empty beams.')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.height_min >= self.height_max:
            raise ParameterError(f'input.height_min = {self.height_min}: expected less than input.height_max = '
                                 f'{self.height_max}')

    def of_lidar(self, number: int) -> 'InputParameters':
        """Return the parameters of the lidar `number`, from 0: its own mask and time offset only."""
        return dataclasses.replace(self, mask=_of_lidar(self.mask, number, 2 * SECTORS),
                                   time_offset=_of_lidar(self.time_offset, number, 1))


def _of_lidar(values: tuple[float, ...], number: int, size: int) -> tuple[float, ...]:
    """Return the `size` numbers of the lidar `number`: all `values`, if every lidar has the same."""
    return values if len(values) == size else values[size * number:size * (number + 1)]


@dataclass(frozen=True)
class NodePriorParameters(PriorParameters):
    """Source of the predicted motion between scans, and standard deviations of external priors."""

    BASIC = *PriorParameters.BASIC, 'source', 'frame', 'translation', 'rotation'

    source: str = parameter(
        'constant_velocity', choices=SOURCES, read_only=True,
        help='Source of the predicted motion between scans. Without an external prior: none, or constant_velocity (the '
             'motion model that advanced.odometry.prior selects). External priors: odometry (topic wheel_odom), imu '
             '(yaw rate on the topic imu, translation from the motion model) or tf (pose of the base in the frame '
             'prior.frame). While an external prior has no data, the motion model predicts.')
    frame: str = parameter(
        'wheel_odom', read_only=True,
        help='Odometry frame that another node publishes on /tf. Used only if prior.source is tf.')
    translation: float = parameter(
        0.1, bounds=(0.0, 10.0),
        help='Standard deviation of the translation of wheel odometry, as a fraction of the distance. Larger values '
             'trust the wheels less; smaller values trust them more.')
    translation_by_rotation: float = parameter(
        0.1, unit='m/rad', bounds=(0.0, 10.0),
        help='Standard deviation of the translation of wheel odometry for each radian of rotation. The largest '
             'of the standard deviations from this parameter, prior.translation and prior.translation_min applies. '
             'Larger values trust the wheels less while the robot rotates; smaller values trust them more.')
    translation_min: float = parameter(
        0.02, unit='m', bounds=(0.0001, 10.0),
        help='Lower limit of the standard deviation of the translation of wheel odometry. Larger values trust small '
             'wheel motions less; smaller values trust them more.')
    rotation: float = parameter(
        0.2, bounds=(0.0, 10.0),
        help='Standard deviation of the rotation of an external prior, as a fraction of the rotation. Larger values '
             'trust the source less; smaller values trust it more.')
    rotation_by_distance: float = parameter(
        0.1, unit='rad/m', bounds=(0.0, 10.0),
        help='Standard deviation of the rotation of wheel odometry for each metre of distance. The largest '
             'of the standard deviations from this parameter, prior.rotation and prior.rotation_min applies. '
             'Larger values trust the wheels less while the robot drives; smaller values trust them more.')
    rotation_min: float = parameter(
        0.03, unit='rad', bounds=(0.0001, 3.2),
        help='Lower limit of the standard deviation of the rotation of an external prior. Larger values trust small '
             'rotations less; smaller values trust them more.')

    def wheel_sigma(self, motion: SE2) -> tuple[float, float, float]:
        """Return the standard deviations of x, y, theta [m, m, rad] of a measured `motion`, in the frame at its end."""
        distance, angle = math.hypot(motion.x, motion.y), abs(motion.theta)
        translation = max(self.translation_min, self.translation * distance, self.translation_by_rotation * angle)
        rotation = max(self.rotation_min, self.rotation * angle, self.rotation_by_distance * distance)
        return translation, translation, rotation


@dataclass(frozen=True)
class PathParameters(ParameterGroup):
    """Spacing and number of the poses on the topic path."""

    BASIC = 'step', 'size'

    step: float = parameter(
        0.1, unit='m', bounds=(0.0, 100.0),
        help='A pose is added to the path when the base has moved this far since the last pose of the path. Larger '
             'values give a coarser path that covers a longer distance; smaller values give a finer path.')
    size: int = parameter(
        2000, bounds=(2, 100000),
        help='Largest number of poses in the path; if there are more, the oldest are dropped. Larger values keep a '
             'longer path and make its messages larger; smaller values save bandwidth.')


@dataclass(frozen=True)
class SnapshotParameters(ParameterGroup):
    """Contents and folder of the files that the service ~/snapshot writes."""

    BASIC = 'scans', 'folder'

    scans: int = parameter(
        20, unit='scans', bounds=(1, 1000),
        help='Number of the latest scans that a snapshot contains. Larger values record a longer time and '
             'take more memory; smaller values give smaller files.')
    folder: str = parameter(
        '~/.ros', read_only=True, help='Folder that snapshots are written to. A leading ~ means the home directory.')


@dataclass(frozen=True, repr=False)
class NodeParameters(Parameters):
    """All parameters of `scan_matcher`; `NodeParameters` extends `Parameters`, so that `Odometry` accepts it."""

    odom_frame: str = parameter(
        'odom', read_only=True,
        help='Frame in which poses are published. Its origin is the pose of the base at the first scan.')
    base_frame: str = parameter(
        'base_link', read_only=True, help='Frame of the robot base, whose pose and twist are published.')
    publish_tf: bool = parameter(
        True, help='If true, the transform between odom_frame and base_frame is sent on /tf.')
    invert_tf: bool = parameter(
        False, read_only=True,
        help='If true, the transform on /tf has odom_frame as the child of base_frame. Use it for a base_frame that '
             'already has another parent.')
    publish_grid: bool = parameter(
        False, read_only=True,
        help='If true, the node publishes an occupancy grid of the key frames around the robot on the topic '
             'local_grid, once a second while the robot moves.')
    grid_resolution: float = parameter(
        0.05, unit='m', bounds=(0.02, 1.0), read_only=True,
        help='Side of a cell of local_grid. Larger values need less memory and computing time; smaller values show '
             'finer walls.')
    scan_topics: tuple[str, ...] = parameter(
        ('scan',), read_only=True,
        help='Topics of the scans, one for each lidar. Odometry is published for each scan of the first lidar; '
             'while that lidar is silent for two scan periods, for each scan of the next lidar. Several lidars '
             'require mounting tf.')
    mounting: str = parameter(
        'tf', choices=MOUNTINGS, read_only=True,
        help='Source of the pose of the laser on the base: tf (the transform from base_frame to the frame of the '
             'scans), laser_pose (the parameter laser_pose) or none (the laser frame is the base frame).')
    laser_pose: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), bounds=(-1000.0, 1000.0), read_only=True,
        help='Pose of the laser on the base: x [m], y [m] and yaw [rad]. Used only if mounting is laser_pose.')
    upside_down: bool = parameter(
        False, read_only=True, help='If true, the laser is mounted upside down. Used only if mounting is laser_pose.')
    input: InputParameters = dataclasses.field(default_factory=InputParameters)
    prior: NodePriorParameters = dataclasses.field(default_factory=NodePriorParameters)
    path: PathParameters = dataclasses.field(default_factory=PathParameters)
    snapshot: SnapshotParameters = dataclasses.field(default_factory=SnapshotParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, frame in (('odom_frame', self.odom_frame), ('base_frame', self.base_frame),
                            ('prior.frame', self.prior.frame)):
            if not frame or frame.startswith('/'):
                raise ParameterError(f'{name} = {frame!r}: expected the name of a frame, without a leading slash')
        if self.odom_frame == self.base_frame:
            raise ParameterError(f'odom_frame = base_frame = {self.base_frame!r}: expected two different frames')
        if len(set(self.scan_topics)) < len(self.scan_topics):
            raise ParameterError(f'scan_topics = {list(self.scan_topics)}: expected each topic once')
        for name, values, size, lidars in (('laser_pose', self.laser_pose, 3, 1),
                                           ('input.mask', self.input.mask, 2 * SECTORS, len(self.scan_topics)),
                                           ('input.time_offset', self.input.time_offset, 1, len(self.scan_topics))):
            _check_count(name, values, size, lidars)
        if len(self.scan_topics) > 1 and self.mounting != 'tf':
            raise ParameterError(f'mounting = {self.mounting!r} with scan_topics = {list(self.scan_topics)}: expected '
                                 "mounting 'tf' for several lidars")
        if self.prior.source == 'tf' and self.prior.frame in (self.odom_frame, self.base_frame):
            raise ParameterError(f'prior.frame = {self.prior.frame!r}: expected an odometry frame of another node, '
                                 'neither odom_frame nor base_frame')

    def for_odometry(self) -> Parameters:
        """Return the parameters for `Odometry`: if `prior.source` is none, `advanced.odometry.prior` is none, too."""
        return self.replace({'advanced.odometry.prior': 'none'}) if self.prior.source == 'none' else self

    def input_of(self, topic: str) -> InputParameters:
        """Return the input parameters of the lidar on `topic`; of the first one if ``scan_topics`` lacks the topic."""
        names = [each.lstrip('/') for each in self.scan_topics]
        name = topic.lstrip('/')
        return self.input.of_lidar(names.index(name) if name in names else 0)

    def unused(self, used: Collection[str]) -> list[str]:
        """Full names of parameters that differ from their defaults but have no effect, as they are not in `used`."""
        values = self.flatten()
        return [d.name for d in self.describe() if d.name not in used and values[d.name] != d.default
                and (d.name, values[d.name]) not in OFFLINE]


def _check_count(name: str, values: tuple[float, ...], size: int, lidars: int) -> None:
    """Raise a ParameterError unless there are `size` numbers, or `size` for each of the `lidars`."""
    if len(values) not in (size, size * lidars):
        numbers = 'one number' if size == 1 else f'{size} numbers'
        several = f', or {size * lidars}: {size} for each topic of scan_topics' if lidars > 1 else ''
        raise ParameterError(f'{name} = {list(values)}: expected {numbers}{several}')


def is_ros_parameter(name: str) -> bool:
    """Whether every ROS node has the parameter `name`: a file may set it, but `NodeParameters` does not contain it."""
    return name in ('use_sim_time', 'start_type_description_service') or name.startswith('qos_overrides.')
