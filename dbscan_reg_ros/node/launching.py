# SPDX-License-Identifier: Apache-2.0
"""Arguments and actions that the launch files share.

``launch`` and ``launch_ros`` are imported where they are used: only a ROS installation has them.
"""
from __future__ import annotations

import dataclasses
import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import DbscanRegError, ParameterError
from ..core.parameters.features import DIRECTIONS
from ..paths import NO_SENSORS
from ..robot.parameter_groups import MAP_MODES, SOURCES
from ..robot.parameters import MOUNTINGS, NodeParameters

if TYPE_CHECKING:
    from launch.actions import DeclareLaunchArgument, EmitEvent
    from launch.launch_context import LaunchContext

    from ..recordings.recording import Recording

PACKAGE = 'dbscan_reg_ros'
SHOWN = 'odom', 'segments', 'path', 'local_map'
"""Topics of the node that config/scan_matcher.rviz displays."""
PARAMETERS = {'base_frame': 'base_frame', 'direction': 'scan.direction', 'map': 'map.file', 'map_mode': 'map.mode',
              'mounting': 'mounting', 'odom_frame': 'odom_frame', 'prior': 'prior.source', 'publish_tf': 'publish_tf',
              'use_sim_time': 'use_sim_time'}
"""Launch argument -> parameter that it sets when it is not empty."""
SWITCHES = 'publish_tf', 'use_sim_time'
"""Launch arguments of boolean parameters."""


def scan_matcher_arguments(map_mode: str = '') -> list[Any]:
    """Declare the launch arguments of `scan_matcher_actions`; an empty argument sets no parameter.

    `map_mode` is the default of the argument of this name.
    """
    from launch.actions import DeclareLaunchArgument

    def argument(name: str, description: str, default: str = '', *,
                 choices: Sequence[str] = ()) -> DeclareLaunchArgument:
        return DeclareLaunchArgument(name, default_value=default, description=description,
                                     choices=['', *choices] if choices else None)

    sensors = sorted(path.stem for path in _config().glob('*.yaml') if path.stem not in NO_SENSORS)
    return [
        argument('namespace', 'namespace of the node and its topics'),
        argument('remap_tf', 'true: /tf and /tf_static are in the namespace of the node, too', 'true'),
        argument('scan_topic', 'topic of the scans; by default scan'),
        argument('sensor', 'name of the ready-made parameter file of a common sensor', choices=sensors),
        argument('params_file', 'parameter file; overrides the argument sensor, and is overridden by those below'),
        argument('odom_frame', 'frame in which the pose is published'),
        argument('base_frame', 'frame of the robot base, whose pose and twist are published'),
        argument('publish_tf', 'true: publish the transform between odom_frame and base_frame'),
        argument('direction', 'scan.direction: direction in which the lidar turns, seen from above',
                 choices=DIRECTIONS),
        argument('mounting', 'source of the pose of the laser on the base', choices=MOUNTINGS),
        argument('prior', 'prior.source: external source of the motion since the last scan', choices=SOURCES),
        argument('map_mode', 'map.mode: localize in a map, or slam, which builds one', map_mode, choices=MAP_MODES),
        argument('map', 'map.file: the map (.npz or .yaml) of localize, or the file that ~/save_map writes'),
        argument('use_sim_time', 'true: take the time from /clock'),
        argument('lifecycle', 'true: start the lifecycle node, scan_matcher_lifecycle', 'false'),
        argument('autostart', 'true: configure and activate the lifecycle node', 'true'),
        argument('respawn', 'true: start the node again 2 s after it has ended', 'false'),
        argument('rviz', 'true: start rviz2 with config/scan_matcher.rviz', 'false'),
        argument('log_level', 'lowest severity of logged messages: debug, info, warn, error or fatal'),
    ]


def scan_matcher_actions(context: LaunchContext, defaults: Sequence[tuple[str, str]] = ()) -> list[Any]:
    """Make the launch actions that start the node according to the arguments of `scan_matcher_arguments`.

    `defaults` are names and values of parameters that ``sensor``, ``params_file`` and the launch arguments override.
    Raises a ParameterError for an invalid argument; launch prints it and stops.
    """
    from launch_ros.actions import Node

    given = LaunchArguments(context.launch_configurations)
    options: dict[str, Any] = {
        'package': PACKAGE, 'name': 'scan_matcher', 'output': 'screen',
        'namespace': given.text('namespace'),
        'remappings': given.remappings(),
        'parameters': _parameters(given),
        'ros_arguments': [word for name, value in defaults for word in ('-p', f'{name}:={value}')] + given.log_level(),
    }
    if given.switch('respawn'):
        options.update(respawn=True, respawn_delay=2.0)
    actions = (_lifecycle(options, given.switch('autostart')) if given.switch('lifecycle')
               else [Node(executable='scan_matcher', **options)])
    return [*actions, _rviz(given, dict(defaults))] if given.switch('rviz') else actions


def player_actions(context: LaunchContext) -> list[Any]:
    """Make the actions of `scan_matcher_actions`, and a player of a recording that shuts the launch down when it ends.

    Played are the scans of the lidars in ``params_file``, if it has several, else those on ``scan_topic``, if the
    recording has this topic. The mounting of the laser is read from the transforms of the recording; if there is none,
    the laser frame is the base frame.
    """
    from launch.actions import Shutdown
    from launch_ros.actions import Node

    given = LaunchArguments(context.launch_configurations)
    recording = os.path.expanduser(given.text('recording'))
    words = [recording, '--clock', '--rate', given.text('rate')]
    if given.text('topics'):
        words += ['--topics', *given.text('topics').split()]
    parameters = _node_parameters(given)
    named = parameters.scan_topics if len(parameters.scan_topics) > 1 else given.text('scan_topic').split()
    topics = [f'/{topic.lstrip("/")}' for topic in named]
    opened = _opened(recording, topics)
    if opened and topics and opened.topic == topics[0]:
        words += [word for topic in topics for word in ('--topic', topic)]
    player = Node(
        package=PACKAGE, executable='play', name='play', output='screen', namespace=given.text('namespace'),
        arguments=words, remappings=given.remappings(), ros_arguments=given.log_level(),
        on_exit=Shutdown(reason='the recording has been played'))
    mounting = 'tf' if opened and _has_mounting(opened, parameters.base_frame) else 'none'
    return [*scan_matcher_actions(context, [('use_sim_time', 'true'), ('mounting', mounting)]), player]


class LaunchArguments:
    """Values of the launch arguments: ``launch_configurations`` of a launch context."""

    def __init__(self, values: Mapping[str, str]) -> None:
        self._values = values

    def text(self, name: str) -> str:
        """Return the text of a launch argument as the user gave it."""
        return self._values[name]

    def switch(self, name: str) -> bool:
        """Return a launch argument as a boolean; raise ParameterError if it is neither true nor false."""
        text = self._values[name].lower()
        if text not in ('true', '1', 'false', '0'):
            raise ParameterError(f'{name} = {self._values[name]!r}: expected true or false')
        return text in ('true', '1')

    def log_level(self) -> list[str]:
        """Return the ROS arguments that set the log level."""
        level = self.text('log_level')
        return ['--log-level', level] if level else []

    def transform_remappings(self) -> list[tuple[str, str]]:
        """Return the remappings of /tf and /tf_static into the node's namespace; empty if ``remap_tf`` is false."""
        return [('/tf', 'tf'), ('/tf_static', 'tf_static')] if self.switch('remap_tf') else []

    def remappings(self) -> list[tuple[str, str]]:
        """Return the remappings of scan_matcher and of the player."""
        topic = self.text('scan_topic')
        return self.transform_remappings() + ([('scan', topic)] if topic else [])


def _parameters(given: LaunchArguments) -> list[Any]:
    """Return parameter files and parameters of the node; later entries override earlier ones."""
    layers: list[Any] = []
    if sensor := given.text('sensor'):
        layers.append(str(_config() / f'{sensor}.yaml'))
    if name := given.text('params_file'):
        path = Path(name).expanduser().absolute()
        if not path.is_file():
            raise ParameterError(f'params_file = {str(path)!r}: there is no such file')
        layers.append(str(path))
    values = {parameter: given.switch(name) if name in SWITCHES else given.text(name)
              for name, parameter in PARAMETERS.items() if given.text(name)}
    return [*layers, values] if values else layers


def _lifecycle(options: dict[str, Any], autostart: bool) -> list[Any]:
    """Make the lifecycle node and, with `autostart`, the actions that configure and activate it."""
    from launch.actions import EmitEvent, RegisterEventHandler
    from launch.events import matches_action
    from launch_ros.actions import LifecycleNode
    from launch_ros.event_handlers import OnStateTransition
    from launch_ros.events.lifecycle import ChangeState
    from lifecycle_msgs.msg import Transition

    node = LifecycleNode(executable='scan_matcher_lifecycle', **options)
    if not autostart:
        return [node]

    def change_state(transition: int) -> EmitEvent:
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

    configured = OnStateTransition(target_lifecycle_node=node, start_state='configuring', goal_state='inactive',
                                   entities=[change_state(Transition.TRANSITION_ACTIVATE)])
    return [RegisterEventHandler(configured), node, change_state(Transition.TRANSITION_CONFIGURE)]


def _rviz(given: LaunchArguments, defaults: Mapping[str, str]) -> Any:
    """Make the action that starts RViz in the namespace of the node, with its topics and frames."""
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix
    from launch_ros.actions import Node

    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        raise ParameterError("rviz = 'true': rviz2 is not installed; install it: "
                             f'sudo apt install ros-{os.environ.get("ROS_DISTRO", "jazzy")}-rviz2') from None
    parameters = _node_parameters(given)
    scans = [topic if topic != 'scan' else given.text('scan_topic') or topic for topic in parameters.scan_topics]
    topics = [(f'/{topic}', topic) for topic in SHOWN]
    topics += [(_shown_scan(number), topic) for number, topic in enumerate(scans)]
    sim_time = given.switch('use_sim_time') if given.text('use_sim_time') else defaults.get('use_sim_time') == 'true'
    return Node(package='rviz2', executable='rviz2', output='log', namespace=given.text('namespace'),
                arguments=['-d', _rviz_config(parameters, len(scans))], parameters=[{'use_sim_time': sim_time}],
                remappings=given.transform_remappings() + topics)


def _shown_scan(number: int) -> str:
    """Return the topic of the scans of a lidar in the configuration of RViz."""
    return '/scan' if number == 0 else f'/scan{number + 1}'


def _rviz_config(parameters: NodeParameters, lidars: int) -> str:
    """Write config/scan_matcher.rviz with the frames of the node and the scans of all lidars; return the path."""
    import yaml

    config = yaml.safe_load((_config() / 'scan_matcher.rviz').read_text(encoding='utf-8'))
    manager = config['Visualization Manager']
    manager['Global Options']['Fixed Frame'] = parameters.odom_frame
    manager['Views']['Current']['Target Frame'] = parameters.base_frame
    displays = manager['Displays']
    scan = next(display for display in displays if display['Class'].endswith('/LaserScan'))
    for number in range(1, lidars):
        topic = scan['Topic'] | {'Value': _shown_scan(number)}
        displays.append(scan | {'Name': f'{scan["Name"]} {number + 1}', 'Topic': topic})
    with tempfile.NamedTemporaryFile('w', prefix='scan_matcher_', suffix='.rviz', delete=False,
                                     encoding='utf-8') as file:
        yaml.safe_dump(config, file)
    return file.name


def _node_parameters(given: LaunchArguments) -> NodeParameters:
    """Return the parameters of the node by ``params_file``, or the defaults; with the frames that are given.

    A file that is wrong by itself may be right with the launch arguments; if it is not, the node names what is wrong.
    """
    from ..robot.parameter_files import read_parameters

    path = Path(given.text('params_file')).expanduser()
    parameters = NodeParameters()
    if path.is_file():
        with suppress(ParameterError):
            parameters = read_parameters(path)
    return dataclasses.replace(parameters, odom_frame=given.text('odom_frame') or parameters.odom_frame,
                               base_frame=given.text('base_frame') or parameters.base_frame)


def _opened(recording: str, topics: Sequence[str]) -> Recording | None:
    """Open a recording with the first of the `topics`, if it has that; None if the player cannot read it."""
    from ..recordings.opening import open_recording
    from ..recordings.truth import find_recording

    for topic in (*topics[:1], None):
        with suppress(DbscanRegError, ImportError):
            return open_recording(find_recording(recording), topic)
    return None


def _has_mounting(recording: Recording, base_frame: str) -> bool:
    """Whether the player publishes static transforms, or others that are the mounting of the laser."""
    from ..recordings.opening import is_bag

    if any(channel.input == '/tf_static' for channel in recording.channels()):
        return True
    with suppress(DbscanRegError):
        return is_bag(recording.path) and bool(recording.mounting_on(base_frame))
    return False


def _config() -> Path:
    from ament_index_python.packages import get_package_share_directory
    return Path(get_package_share_directory(PACKAGE)) / 'config'
