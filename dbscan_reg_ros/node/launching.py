# SPDX-License-Identifier: Apache-2.0
"""What the launch files of the package have in common.

``launch`` and ``launch_ros`` are imported where they are used: only a ROS installation has them.
"""
import os
from pathlib import Path

from ..core.errors import DbscanRegError, ParameterError
from ..paths import NO_SENSORS
from ..robot.parameters import MOUNTINGS, SOURCES

PACKAGE = 'dbscan_reg_ros'
SHOWN = 'odom', 'segments', 'path', 'local_map'
"""Topics of ours in config/scan_matcher.rviz, beside the scans."""
PARAMETERS = {'base_frame': 'base_frame', 'mounting': 'mounting', 'odom_frame': 'odom_frame', 'prior': 'prior.source',
              'publish_tf': 'publish_tf', 'use_sim_time': 'use_sim_time'}
"""Launch argument -> the parameter that it sets when it is given."""
SWITCHES = 'publish_tf', 'use_sim_time'
"""Those of them that are true or false."""


def matcher_arguments() -> list:
    """The launch arguments that `scan_matcher_actions` goes by; an empty one of a parameter is not given."""
    from launch.actions import DeclareLaunchArgument

    def argument(name, description, default='', choices=()):
        return DeclareLaunchArgument(name, default_value=default, description=description,
                                     choices=['', *choices] if choices else None)

    sensors = sorted(path.stem for path in _config().glob('*.yaml') if path.stem not in NO_SENSORS)
    return [
        argument('namespace', 'namespace of the node and its topics'),
        argument('remap_tf', 'true: /tf and /tf_static are in the namespace, too', 'true'),
        argument('scan_topic', 'topic of the scans instead of scan'),
        argument('sensor', 'the parameters of a common sensor, a file in config', choices=sensors),
        argument('params_file', 'parameter file; what it says counts more than sensor, and less than the arguments below'),
        argument('odom_frame', 'frame in which the pose is given'),
        argument('base_frame', 'frame whose pose and twist are published'),
        argument('publish_tf', 'true: send the transform between odom_frame and base_frame'),
        argument('mounting', 'where the laser sits on the base', choices=MOUNTINGS),
        argument('prior', 'prior.source: what tells the motion since the last scan', choices=SOURCES),
        argument('use_sim_time', 'true: take the time from /clock'),
        argument('lifecycle', 'true: start the managed node, scan_matcher_lifecycle', 'false'),
        argument('autostart', 'true: configure and activate the managed node', 'true'),
        argument('rviz', 'true: start rviz2 with config/scan_matcher.rviz', 'false'),
        argument('log_level', 'least severity that is logged: debug, info, warn, error or fatal'),
    ]


def scan_matcher_actions(context, defaults=()) -> list:
    """The nodes that the arguments of `matcher_arguments` ask for.

    Parameters
    ----------
    context : launch.LaunchContext
    defaults : iterable of (str, str)
        Names and values of parameters where neither ``sensor`` nor ``params_file`` nor an argument says otherwise.

    Raises
    ------
    ParameterError
        When an argument is wrong, with what was expected; launch prints it and stops.
    """
    from launch_ros.actions import Node

    given = Given(context.launch_configurations)
    options = {
        'package': PACKAGE, 'name': 'scan_matcher', 'output': 'screen',
        'namespace': given.text('namespace'),
        'remappings': given.remappings(),
        'parameters': _parameters(given),
        'ros_arguments': [word for name, value in defaults for word in ('-p', f'{name}:={value}')] + given.log_level(),
    }
    actions = (_managed(options, given.switch('autostart')) if given.switch('lifecycle')
               else [Node(executable='scan_matcher', **options)])
    return [*actions, _rviz(given, dict(defaults))] if given.switch('rviz') else actions


def player_actions(context) -> list:
    """scan_matcher and the player of a recording, which takes the launch down when it ends; see `scan_matcher_actions`.

    Where the recording holds static transforms, they tell where the laser sits; otherwise the laser is the base.
    """
    from launch.actions import Shutdown
    from launch_ros.actions import Node

    given = Given(context.launch_configurations)
    recording = os.path.expanduser(given.text('recording'))
    words = [recording, '--clock', '--rate', given.text('rate')]
    if given.text('topics'):
        words += ['--topics', *given.text('topics').split()]
    player = Node(
        package=PACKAGE, executable='play', name='play', output='screen', namespace=given.text('namespace'), arguments=words,
        remappings=given.remappings(), ros_arguments=given.log_level(), on_exit=Shutdown(reason='the recording has been played'))
    mounting = 'tf' if _tells_mounting(recording) else 'none'
    return [*scan_matcher_actions(context, [('use_sim_time', 'true'), ('mounting', mounting)]), player]


class Given:
    """Launch arguments, as their values are meant.

    Parameters
    ----------
    values : mapping of str to str
        ``launch_configurations`` of the context.
    """

    def __init__(self, values):
        self._values = values

    def text(self, name) -> str:
        return self._values[name]

    def switch(self, name) -> bool:
        """The argument as true or false; ParameterError when it is neither."""
        text = self._values[name].lower()
        if text not in ('true', '1', 'false', '0'):
            raise ParameterError(f'{name} = {self._values[name]!r}: expected true or false')
        return text in ('true', '1')

    def log_level(self) -> list:
        """ROS arguments."""
        level = self.text('log_level')
        return ['--log-level', level] if level else []

    def transform_remappings(self) -> list:
        return [('/tf', 'tf'), ('/tf_static', 'tf_static')] if self.switch('remap_tf') else []

    def remappings(self) -> list:
        """Of scan_matcher and of whoever plays to it."""
        topic = self.text('scan_topic')
        return self.transform_remappings() + ([('scan', topic)] if topic else [])


def _parameters(given):
    """Parameter files and parameters, each of which counts more than those before it."""
    layers = []
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


def _managed(options, autostart):
    """The managed node, and what brings it up."""
    from launch.actions import EmitEvent, RegisterEventHandler
    from launch.events import matches_action
    from launch_ros.actions import LifecycleNode
    from launch_ros.event_handlers import OnStateTransition
    from launch_ros.events.lifecycle import ChangeState
    from lifecycle_msgs.msg import Transition

    node = LifecycleNode(executable='scan_matcher_lifecycle', **options)
    if not autostart:
        return [node]

    def ask(transition):
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

    configured = OnStateTransition(target_lifecycle_node=node, start_state='configuring', goal_state='inactive',
                                   entities=[ask(Transition.TRANSITION_ACTIVATE)])
    return [RegisterEventHandler(configured), node, ask(Transition.TRANSITION_CONFIGURE)]


def _rviz(given, defaults):
    """RViz in the namespace of the node, with its topics and frames."""
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix
    from launch_ros.actions import Node

    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        raise ParameterError("rviz = 'true': rviz2 is not installed; install it: "
                             f'sudo apt install ros-{os.environ.get("ROS_DISTRO", "jazzy")}-rviz2') from None
    words = ['-d', str(_config() / 'scan_matcher.rviz')]
    if given.text('odom_frame'):
        words += ['-f', given.text('odom_frame')]
    topics = [(f'/{topic}', topic) for topic in SHOWN] + [('/scan', given.text('scan_topic') or 'scan')]
    sim_time = given.switch('use_sim_time') if given.text('use_sim_time') else defaults.get('use_sim_time') == 'true'
    return Node(package='rviz2', executable='rviz2', output='log', namespace=given.text('namespace'), arguments=words,
                remappings=given.transform_remappings() + topics, parameters=[{'use_sim_time': sim_time}])


def _tells_mounting(recording) -> bool:
    """Whether it holds static transforms; a file that cannot be read does not, and the player says what is wrong with it."""
    from ..recordings.bags.bag import open_reader
    from ..recordings.opening import is_bag
    from ..recordings.truth import find_recording

    try:
        path = find_recording(recording)
        if not is_bag(path):
            return False
        with open_reader(path) as reader:
            return any(c.topic == '/tf_static' and c.msgcount for c in reader.connections)
    except (DbscanRegError, ImportError):
        return False


def _config() -> Path:
    from ament_index_python.packages import get_package_share_directory
    return Path(get_package_share_directory(PACKAGE)) / 'config'
