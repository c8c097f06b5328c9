# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node, including the parameters of the registration method."""
import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from ..core.errors import ParameterError
from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.parameters.schema import Description, Value, check, internal, parameter, suggest
from ..core.parameters.tree import Parameters
from .parameter_groups import (
    SECTORS,
    InputParameters,
    MapParameters,
    NodePriorParameters,
    PathParameters,
    SnapshotParameters,
)
from .sensors import (
    FRAME_MARK,
    INHERITED,
    NAMELESS,
    OWN,
    LidarParameters,
    check_names,
    sensor_descriptions,
    sensor_values,
)

MOUNTINGS = ('none', 'laser_pose', 'tf')
METHOD = frozenset(each.name for each in Parameters.describe()) - {'prior.source'}
"""Full names of the parameters of the method; a replay names its prior by options as well."""
CLOUDS = frozenset({'input.type', 'input.height_min', 'input.height_max', 'input.bearing_step'})
"""Full names of the parameters that only point clouds need."""
REPLAYED = METHOD | CLOUDS | {'odom_frame', 'base_frame', 'mounting', 'laser_pose', 'upside_down', 'input.mask',
                              'input.mask_range', 'input.time_offset', 'sensors'}
"""Full names of the parameters that a replay uses."""
NO_TOPICS = ('scan',)
"""Value of ``scan_topics`` if it is not given."""
OFFLINE = ('prior.source', 'none'), ('mounting', 'none')
"""Names and values of parameters that have no effect on a replay, and so need no warning."""


@dataclass(frozen=True, repr=False)
class NodeParameters(Parameters):
    """All parameters of `scan_matcher`; `NodeParameters` extends `Parameters`, so that `Odometry` accepts it."""

    odom_frame: str = parameter(
        'odom', read_only=True,
        help='Frame in which poses are published. The base is at initial_pose in it at the first scan.')
    base_frame: str = parameter(
        'base_link', read_only=True, help='Frame of the robot base, whose pose and twist are published.')
    publish_tf: bool = parameter(
        True, help='If true, the transform between odom_frame and base_frame is sent on /tf.')
    invert_tf: bool = parameter(
        False, read_only=True,
        help='If true, the transform on /tf has odom_frame as the child of base_frame. Use it for a base_frame that '
             'already has another parent.')
    publish_rate: float = parameter(
        0.0, unit='Hz', bounds=(0.0, 200.0),
        help='Rate at which the transform and odom are published between scans as well, as the last twist predicts '
             'them, with a covariance that grows, for advanced.odometry.coast_time at most. Larger values suit '
             'controllers that are faster than the lidar, and need more computing time; 0 publishes at each scan only. '
             'The scan itself then gives no odom if a later one was published, but always its transform.')
    initial_pose: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), bounds=(-1e6, 1e6), read_only=True,
        help='Pose of the base in odom_frame at the first scan: x [m], y [m] and yaw [rad]. The pose of state_file, if '
             'there is one, is used in its place; set_pose sets another one later.')
    state_file: str = parameter(
        '', read_only=True,
        help='File that keeps the pose of the base over a restart of the node: it is written every 5 s and at the end, '
             'and read at the start, if it is at most an hour old, with the covariance of an unknown motion in the '
             'meantime. Empty: no file.')
    publish_grid: bool = parameter(
        False, read_only=True,
        help='If true, the node publishes an occupancy grid of the key frames around the robot on the topic '
             'local_grid, once a second while the robot moves.')
    grid_resolution: float = parameter(
        0.05, unit='m', bounds=(0.02, 1.0), read_only=True,
        help='Side of a cell of local_grid. Larger values need less memory and computing time; smaller values show '
             'finer walls.')
    scan_topics: tuple[str, ...] = parameter(
        NO_TOPICS, read_only=True,
        help='Topics of the scans, one for each lidar. With odom_on first, odometry is published for each scan of the '
             'first lidar. If that lidar sends no scan for two of its periods, odometry is published for each scan of '
             'the next lidar. Several scan_topics require mounting tf; with sensors, each lidar may have its own '
             'laser_pose.')
    odom_on: str = parameter(
        'first', bounds=('first', 'all'), read_only=True,
        help='With several lidars, the scans for which odometry is published: those of the first lidar, or all, in the '
             'order of their stamps.')
    sensors: tuple[str, ...] = parameter(
        NAMELESS, read_only=True,
        help='Names of the lidars, in place of scan_topics. Each has its own parameters NAME.topic (default: '
             f'NAME/scan), {", ".join(f"NAME.{own}" for own in INHERITED)}. A parameter that is not given is inherited '
             'from the one without the name. A list with one empty text means that the lidars have no names.')
    mounting: str = parameter(
        'tf', bounds=MOUNTINGS, read_only=True,
        help='Source of the pose of the laser on the base: tf (the transform from base_frame to the frame of the '
             'scans), laser_pose (the parameter laser_pose) or none (the laser frame is the base frame).')
    laser_pose: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), bounds=(-1000.0, 1000.0), read_only=True,
        help='Pose of the laser on the base: x [m], y [m] and yaw [rad]. Used only if mounting is laser_pose.')
    upside_down: bool = parameter(
        False, read_only=True, help='If true, the laser is mounted upside down. Used only if mounting is laser_pose.')
    input: InputParameters = dataclasses.field(default_factory=InputParameters)
    prior: NodePriorParameters = dataclasses.field(default_factory=NodePriorParameters)
    map: MapParameters = dataclasses.field(default_factory=MapParameters)
    path: PathParameters = dataclasses.field(default_factory=PathParameters)
    snapshot: SnapshotParameters = dataclasses.field(default_factory=SnapshotParameters)
    own: tuple[tuple[str, Value], ...] = internal(())

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, frame in (('odom_frame', self.odom_frame), ('base_frame', self.base_frame),
                            ('prior.frame', self.prior.frame), ('map.frame', self.map.frame)):
            if not frame or frame.startswith('/'):
                raise ParameterError(f'{name} = {frame!r}: expected the name of a frame, without a leading slash')
        if self.odom_frame == self.base_frame:
            raise ParameterError(f'odom_frame = base_frame = {self.base_frame!r}: expected two different frames')
        if self.map.mode != 'none':
            self._check_map()
        count = len(self.scan_topics)
        if self.sensors != NAMELESS:
            self._use_sensors()
            count = 1
        if len(set(self.scan_topics)) < len(self.scan_topics):
            raise ParameterError(f'scan_topics = {list(self.scan_topics)}: expected each topic once')
        for name, values, size, lidars in (('laser_pose', self.laser_pose, 3, 1),
                                           ('initial_pose', self.initial_pose, 3, 1),
                                           ('input.mask', self.input.mask, 2 * SECTORS, count),
                                           ('input.time_offset', self.input.time_offset, 1, count)):
            _check_count(name, values, size, lidars)
        if count > 1 and self.mounting != 'tf':
            raise ParameterError(f'mounting = {self.mounting!r} with scan_topics = {list(self.scan_topics)}: expected '
                                 "mounting 'tf' for several lidars")
        if self.prior.source == 'tf' and self.prior.frame in (self.odom_frame, self.base_frame):
            raise ParameterError(f'prior.frame = {self.prior.frame!r}: expected an odometry frame of another node, '
                                 'neither odom_frame nor base_frame')

    def _check_map(self) -> None:
        """Raise a ParameterError if there can be no transform from the frame of the map to ``odom_frame``."""
        if self.map.frame in (self.odom_frame, self.base_frame):
            raise ParameterError(f'map.frame = {self.map.frame!r}: expected neither odom_frame nor base_frame')
        if self.invert_tf:
            raise ParameterError(f'map.mode = {self.map.mode!r} with invert_tf = True: expected invert_tf False, as '
                                 'odom_frame has map.frame as its parent')

    def _use_sensors(self) -> None:
        """Set ``scan_topics`` to the topics of the ``sensors``; raise a ParameterError if parameters contradict it."""
        check_names(self.sensors, self.describe())
        given, plain = dict(self.own), super().flatten()
        values = {name: sensor_values(name, given, plain) for name in self.sensors}
        topics = tuple(each['topic'] for each in values.values())
        if self.scan_topics != NO_TOPICS and _absolute(self.scan_topics) != _absolute(topics):
            raise ParameterError(f'scan_topics = {list(self.scan_topics)} with sensors = {list(self.sensors)}, whose '
                                 f'topics are {list(topics)}: expected only one of both parameters')
        object.__setattr__(self, 'scan_topics', topics)
        for name in self.sensors:
            for own, size in (('laser_pose', 3), ('mask', 2 * SECTORS), ('time_offset', 1)):
                if (full := f'{name}.{own}') in given:
                    _check_count(full, values[name][own], size, 1)
            mounting = values[name]['mounting']
            if len(topics) > 1 and mounting != 'tf' and f'{name}.laser_pose' not in given:
                raise ParameterError(f'{name}.mounting = {mounting!r} without {name}.laser_pose: expected the pose of '
                                     "each of several lidars, or mounting 'tf'")

    def _changed_fields(self, values: Mapping[str, object]) -> dict[str, Any]:
        names = values.get('sensors', self.sensors)
        known, plain = sensor_descriptions(names, self.describe()), {each.name: each for each in self.describe()}
        for name in values:
            first, _, last = name.partition('.')
            if name not in known and first in {each.partition('.')[0] for each in known}:
                raise ParameterError(f'unknown parameter {name!r}; {suggest(name, known)}')
            if name not in known | plain and last in OWN:
                raise ParameterError(f'unknown parameter {name!r}: {first!r} is no lidar in sensors = {_listed(names)}')
        own = {name: check(known[name], value) for name, value in values.items() if name in known}
        changed = super()._changed_fields({name: value for name, value in values.items() if name not in known})
        if known:
            changed = {'scan_topics': NO_TOPICS, 'own': tuple({**dict(self.own), **own}.items()), **changed}
        return changed

    def descriptions(self) -> tuple[Description, ...]:
        """Return a `Description` of every parameter, those of the ``sensors`` included."""
        return *self.describe(), *sensor_descriptions(self.sensors, self.describe()).values()

    def flatten(self) -> dict[str, Value]:
        """Map the full name of every parameter to its value; those of the ``sensors`` are inherited or their own."""
        plain, given = super().flatten(), dict(self.own)
        names = self.sensors if self.sensors != NAMELESS else ()
        return plain | {f'{name}.{own}': value
                        for name in names for own, value in sensor_values(name, given, plain).items()}

    def for_odometry(self) -> Parameters:
        """Return the parameters for `Odometry`: the limits of the ranges of the only lidar, if there is one."""
        if self.sensors != NAMELESS and len(self.sensors) == 1:
            return dataclasses.replace(self, scan=self.lidar(self.scan_topics[0]).scan)
        return self

    def lidar(self, topic: str) -> LidarParameters:
        """Return the parameters of the lidar on `topic`; of the first lidar if no lidar has this topic.

        All lidars on one topic, with names of `name_in_frame`, have the same parameters.
        """
        names, topic = _absolute(self.scan_topics), topic.partition(FRAME_MARK)[0].lstrip('/')
        number = names.index(topic) if topic in names else 0
        if self.sensors == NAMELESS:
            return LidarParameters(self.scan_topics[number], self.input.of_lidar(number), self.scan, self.mounting,
                                   self.laser_pose, self.upside_down)
        values = sensor_values(self.sensors[number], dict(self.own), super().flatten())
        fields = {group: {own: values[own] for own, full in INHERITED.items() if full.startswith(f'{group}.')}
                  for group in ('input', 'scan')}
        return LidarParameters(values['topic'], dataclasses.replace(self.input, **fields['input']),
                               dataclasses.replace(self.scan, **fields['scan']), values['mounting'],
                               values['laser_pose'], values['upside_down'], self.sensors[number])

    def input_of(self, topic: str) -> InputParameters:
        """Return the input parameters of the lidar on `topic`, as `lidar`."""
        return self.lidar(topic).input

    def unused(self, used: Collection[str]) -> list[str]:
        """Full names of parameters that differ from their defaults but have no effect, as they are not in `used`."""
        values = self.flatten()
        return [d.name for d in self.describe() if d.name not in used and values[d.name] != d.default
                and (d.name, values[d.name]) not in OFFLINE]


def _absolute(topics: tuple[str, ...]) -> list[str]:
    """Return names of topics without leading slashes: equal names are then equal topics of a node in no namespace."""
    return [topic.lstrip('/') for topic in topics]


def _listed(names: Any) -> Any:
    """Return names as a user writes them."""
    return list(names) if isinstance(names, tuple) else names


def _check_count(name: str, values: tuple[float, ...], size: int, lidars: int) -> None:
    """Raise a ParameterError unless there are `size` numbers, or `size` for each of the `lidars`."""
    if len(values) not in (size, size * lidars):
        numbers = 'one number' if size == 1 else f'{size} numbers'
        several = f', or {size * lidars}: {size} for each topic of scan_topics' if lidars > 1 else ''
        raise ParameterError(f'{name} = {list(values)}: expected {numbers}{several}')


def is_ros_parameter(name: str) -> bool:
    """Whether every ROS node has the parameter `name`: a file may set it, but `NodeParameters` does not contain it."""
    return name in ('use_sim_time', 'start_type_description_service') or name.startswith('qos_overrides.')


def mounting_from_parameters(parameters: NodeParameters | LidarParameters) -> Mounting | None:
    """Return the mounting that the parameters define; None if they contain ``mounting: tf``."""
    if parameters.mounting == 'tf':
        return None
    if parameters.mounting == 'none':
        return Mounting()
    return Mounting(SE2.from_array(parameters.laser_pose), parameters.upside_down)
