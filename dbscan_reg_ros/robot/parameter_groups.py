# SPDX-License-Identifier: Apache-2.0
"""Groups of parameters of the node, besides those of the registration method."""
import dataclasses
import math
from dataclasses import dataclass

from ..core.errors import ParameterError
from ..core.geometry.se2 import SE2
from ..core.parameters.odometry import PriorParameters
from ..core.parameters.schema import ParameterGroup, parameter

SOURCES = ('none', 'constant_velocity', 'odometry', 'imu', 'odometry+imu', 'tf')
SECTORS = 4
MAP_MODES = ('none', 'localize', 'slam')
LASER_SCAN, POINT_CLOUD = 'sensor_msgs/LaserScan', 'sensor_msgs/PointCloud2'


@dataclass(frozen=True)
class InputParameters(ParameterGroup):
    """Selection of the scans that are processed, and of the beams that are used."""

    every_nth: int = parameter(
        1, unit='scans', bounds=(1, 1000),
        help='Only every n-th scan is used, where n is this value. Larger values save computing time and lengthen the '
             'motion between the scans used; 1 uses every scan.')
    queue_size: int = parameter(
        3, unit='scans', bounds=(1, 50), case='symptom: scans are dropped because processing is too slow',
        help='Number of scans that may wait when processing falls behind the lidar; if more wait, the oldest are '
             'dropped. Scans that arrive in a burst all wait, at most 100. Larger values drop fewer scans when the '
             'computer is busy and delay the pose; smaller values keep the delay short.')
    max_wait: float = parameter(
        0.05, unit='s', bounds=(0.0, 10.0), case='external prior with a long period',
        help='Longest time that a scan waits until the transform of a moving sensor, or the external prior, is known '
             'at the stamp of the scan. It should exceed the period of the source of these data. Larger values '
             'tolerate slower sources and delay the pose; 0 never waits.')
    reorder: float = parameter(
        0.02, unit='s', bounds=(0.0, 1.0), case='several lidars, one of which is slower',
        help='With several lidars, longest time that a scan waits for an older scan of another lidar that is due, so '
             'that scans are used in the order of their stamps. Larger values tolerate slower lidars and delay the '
             'pose; 0 never waits. A scan that arrives even later updates the map, but not the published pose.')
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
        help='Time that is added to the stamps of the scans when they arrive, except to stamps of 0. A driver that '
             'stamps its scans too late needs a negative value. One number applies to every lidar; with several '
             'lidars there may be one for each, in the order of scan_topics.')
    type: str = parameter(
        'auto', bounds=('auto', LASER_SCAN, POINT_CLOUD), read_only=True,
        help='Type of the messages of the lidar; with auto it is the type that is published on the topic. From a '
             'sensor_msgs/PointCloud2 message the points with heights between input.height_min and input.height_max '
             'are used.')
    height_min: float = parameter(
        0.2, unit='m', bounds=(-1000.0, 1000.0),
        help='Points of a point cloud below this height in base_frame are ignored. Larger values also ignore low '
             'objects; with values near the height of the floor, a ramp looks like a wall.')
    height_max: float = parameter(
        1.5, unit='m', bounds=(-1000.0, 1000.0),
        help='Points of a point cloud above this height in base_frame are ignored. Larger values also use walls above '
             'furniture and people, and objects that hang from the ceiling; smaller values use fewer points.')
    bearing_step: float = parameter(
        0.0087, unit='rad', bounds=(0.0005, 0.1),
        help='Angle between two beams of the scan that is made from a point cloud; each beam has the nearest point '
             'within this angle. Larger values save computing time; values below the angular step of the lidar give '
             'beams without a return.')

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

    source: str = parameter(
        'constant_velocity', bounds=SOURCES, read_only=True,
        help='Source of the predicted motion between scans. Without an external prior: none (every motion is equally '
             'likely), or constant_velocity (the motion model). External priors: odometry (topic wheel_odom), imu (yaw '
             'rate on the topic imu, translation from the motion model), odometry+imu (translation of the wheels, '
             'rotation of the IMU; each alone while the other has no data) or tf (pose of the base in the frame '
             'prior.frame). While an external prior has no data, the motion model predicts.')
    frame: str = parameter(
        'wheel_odom', read_only=True,
        help='Odometry frame that another node publishes on /tf. Used only if prior.source is tf.')
    translation: float = parameter(
        0.1, bounds=(0.0, 10.0),
        help='Standard deviation of the translation of wheel odometry, as a fraction of the distance. Larger values '
             'trust the wheels less; smaller values trust them more.')
    translation_by_rotation: float = parameter(
        0.1, unit='m/rad', bounds=(0.0, 10.0), case='wheels that slip in turns',
        help='Standard deviation of the translation of wheel odometry for each radian of rotation. The largest of the '
             'standard deviations from this parameter, prior.translation and advanced.prior.translation_min is used. '
             'Larger values trust the wheels less while the robot rotates; smaller values trust them more.')
    translation_min: float = parameter(
        0.02, unit='m', bounds=(0.0001, 10.0), case='wheels with coarse ticks',
        help='Lower limit of the standard deviation of the translation of wheel odometry. Larger values trust small '
             'wheel motions less; smaller values trust them more.')
    rotation: float = parameter(
        0.2, bounds=(0.0, 10.0),
        help='Standard deviation of the rotation of an external prior, as a fraction of the rotation. Larger values '
             'trust the source less; smaller values trust it more.')
    rotation_by_distance: float = parameter(
        0.1, unit='rad/m', bounds=(0.0, 10.0), case='wheels of different size',
        help='Standard deviation of the rotation of wheel odometry for each metre of distance. The largest of the '
             'standard deviations from this parameter, prior.rotation and advanced.prior.rotation_min is used. Larger '
             'values trust the wheels less while the robot drives; smaller values trust them more.')
    rotation_min: float = parameter(
        0.03, unit='rad', bounds=(0.0001, 3.2), case='wheels with coarse ticks',
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

    step: float = parameter(
        0.1, unit='m', bounds=(0.0, 100.0), case='symptom: the path of RViz is too coarse',
        help='A pose is added to the path when the base has moved this far since the last pose of the path. Larger '
             'values give a path with wider spacing that covers a longer distance; smaller values give a path with '
             'narrower spacing.')
    size: int = parameter(
        2000, bounds=(2, 100000), case='symptom: the path of RViz is too short',
        help='Largest number of poses in the path; if there are more, the oldest are dropped. Larger values keep a '
             'longer path and make its messages larger; smaller values save bandwidth.')


@dataclass(frozen=True)
class SnapshotParameters(ParameterGroup):
    """Contents and folder of the files that the service ~/snapshot writes."""

    scans: int = parameter(
        20, unit='scans', bounds=(1, 1000), case='snapshots of a longer time',
        help='Number of the latest scans that a snapshot contains. Larger values record a longer time and '
             'take more memory; smaller values give smaller files.')
    folder: str = parameter(
        '~/.ros', read_only=True, case='robot whose home directory is read-only',
        help='Folder that snapshots are written to. A leading ~ means the home directory.')


@dataclass(frozen=True)
class MapParameters(ParameterGroup):
    """Pose of the robot in a map."""

    mode: str = parameter(
        'none', bounds=MAP_MODES, read_only=True,
        help='What is done with a map: none (odometry only), localize (the pose in a known map is found without a '
             'guess, and followed) or slam (a map is built while the robot drives, and its loops are closed).')
    file: str = parameter(
        '',
        help='With map.mode localize, file of the map, which is read at once: of replay --map-out or of '
             '~/save_map (.npz), or the map.yaml of an occupancy grid; empty: the topic map. With slam, file that '
             '~/save_map writes. A leading ~ means the home directory.')
    frame: str = parameter(
        'map', read_only=True,
        help='Frame of the map. With map.mode localize or slam the transform from it to odom_frame is sent on /tf.')
    transform_tolerance: float = parameter(
        0.5, unit='s', bounds=(0.0, 10.0),
        help='Time by which the transform from map.frame to odom_frame is dated ahead, so that it is known at the time '
             'of the latest scan and until the next one. Larger values tolerate rarer scans; smaller values apply a '
             'correction of the pose sooner.')
