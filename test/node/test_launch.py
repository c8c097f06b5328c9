# SPDX-License-Identifier: Apache-2.0
"""The launch files: what they start for which arguments, and that the real processes run accordingly.

``launch`` and ``launch_ros`` are part of a ROS installation only. Everywhere a stand-in with their keywords and command
lines takes their place; where the real ones are installed, the two are compared.
"""
import importlib.util
import inspect
import signal
import time
from pathlib import Path

import launch_stand_in
import pytest
import rclpy  # noqa: F401 - needs ROS
import yaml
from bags import laser_scan, write_bag
from launch_stand_in import rules, visit
from lifecycle_msgs.msg import State, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Odometry
from rooms import room_log
from ros_helpers import Parameters

from dbscan_reg_ros.command_lines import COMMANDS
from dbscan_reg_ros.core.errors import ParameterError
from dbscan_reg_ros.core.parameters.features import DIRECTIONS
from dbscan_reg_ros.robot.parameter_groups import MAP_MODES, SOURCES
from dbscan_reg_ros.robot.parameters import MOUNTINGS

FILES = 'scan_matcher', 'play', 'localization'
SENSORS = ['hokuyo_urg04lx', 'hokuyo_utm30lx', 'ldrobot_ld19', 'ldrobot_stl27l', 'lds', 'lds_01', 'lds_03',
           'omron_os32c', 'oradar_ms200', 'rplidar_a', 'rplidar_c1', 'rplidar_s', 'sick_lms5xx', 'sick_tim',
           'ydlidar_g', 'ydlidar_g6', 'ydlidar_tg', 'ydlidar_x2', 'ydlidar_x4']
TRANSFORMS = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
COMMON = {'namespace': '', 'remap_tf': 'true', 'scan_topic': '', 'sensor': '', 'params_file': '', 'odom_frame': '',
          'base_frame': '', 'direction': '', 'publish_tf': '', 'mounting': '', 'prior': '', 'map_mode': '', 'map': '',
          'use_sim_time': '', 'lifecycle': 'false', 'autostart': 'true', 'respawn': 'false', 'rviz': 'false',
          'log_level': ''}
ARGUMENTS = {'scan_matcher': COMMON, 'play': COMMON | {'recording': None, 'rate': '1.0', 'topics': ''},
             'localization': COMMON | {'map_mode': 'localize'}}


@pytest.fixture
def prefix(root, tmp_path, monkeypatch):
    """A folder that ament takes for the one that this package is installed to.

    ``prefix(package)`` installs one more.
    """
    folder = tmp_path / 'prefix'

    def install(package):
        marker = folder / 'share' / 'ament_index' / 'resource_index' / 'packages' / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()

    install('dbscan_reg_ros')
    share = folder / 'share' / 'dbscan_reg_ros'
    share.mkdir()
    for name in ('config', 'launch'):
        (share / name).symlink_to(root / name)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(folder))
    return install


@pytest.fixture
def description(root, prefix, monkeypatch):
    """``description(name)``: what the launch file of that name describes, made with the stand-in."""
    launch_stand_in.install(monkeypatch)
    return lambda name: load(root, name)


@pytest.fixture
def launched(description):
    """``launched(name, **arguments)``: the actions of a launch file that remain with those arguments."""
    def launched(name, **arguments):
        assert set(arguments) <= set(ARGUMENTS[name])
        return visit(description(name), arguments)
    return launched


@pytest.fixture
def matcher(launched):
    """``matcher(**arguments)``: what the command line of the node says that scan_matcher.launch.py starts."""
    def matcher(**arguments):
        [node] = launched('scan_matcher', **arguments)
        return rules(node)
    return matcher


@pytest.fixture
def play(launched, tmp_path):
    """``play(**arguments)``: the nodes scan_matcher and play that play.launch.py starts."""
    def play(**arguments):
        matcher, player = launched('play', **({'recording': str(tmp_path / 'missing.log')} | arguments))
        return matcher, player
    return play


@pytest.fixture
def start_launched(start_command):
    """``start_launched(node)``: the real process of a node that was launched."""
    return lambda node: start_command(node.executable, *node.command())


def load(root, name):
    spec = importlib.util.spec_from_file_location('description', root / 'launch' / f'{name}.launch.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.generate_launch_description()


def values(rules):
    """The parameters that the last parameter file of a command line sets."""
    [contents] = read(rules.files[-1]).values()
    return contents['ros__parameters']


def read(path):
    return yaml.safe_load(Path(path).read_text())


def parameter_file(path, values, node='/**'):
    path.write_text(yaml.dump({node: {'ros__parameters': values}}))
    return str(path)


# Arguments


@pytest.mark.parametrize('name', FILES)
def test_the_arguments_are_declared_with_their_defaults_and_described(description, name):
    declared = [a for a in description(name).entities if isinstance(a, launch_stand_in.DeclareLaunchArgument)]
    assert {a.name: a.default_value for a in declared} == ARGUMENTS[name]
    assert all(len(a.description) > 10 for a in declared)
    choices = {a.name: a.choices for a in declared if a.choices}
    assert choices == {'sensor': ['', *SENSORS], 'mounting': ['', *MOUNTINGS], 'prior': ['', *SOURCES],
                       'direction': ['', *DIRECTIONS], 'map_mode': ['', *MAP_MODES]}


def test_the_documents_name_every_argument(root):
    text = (root / 'doc' / 'node.md').read_text()
    assert [name for name in {**ARGUMENTS['play'], **ARGUMENTS['localization']} if f'`{name}`' not in text] == []


def test_without_arguments_the_node_is_as_it_is_without_launch(launched):
    [node] = launched('scan_matcher')
    assert (node.package, node.executable, node.process) == ('dbscan_reg_ros', 'scan_matcher', {'output': 'screen'})
    found = rules(node)
    assert (found.own, found.files, found.set, found.log) == ([], [], [], None)
    assert found.remap == [('__node', 'scan_matcher'), ('__ns', '/'), *TRANSFORMS]


@pytest.mark.parametrize('argument, value, parameter, expected', [
    ('base_frame', 'on', 'base_frame', 'on'),
    ('publish_tf', 'false', 'publish_tf', False),
    ('use_sim_time', '1', 'use_sim_time', True),
    ('mounting', 'laser_pose', 'mounting', 'laser_pose'),
    ('prior', 'imu', 'prior.source', 'imu'),
    ('direction', 'clockwise', 'scan.direction', 'clockwise'),
    ('map_mode', 'slam', 'map.mode', 'slam'),
    ('map', '~/floor.npz', 'map.file', '~/floor.npz'),
])
def test_an_argument_sets_its_parameter_and_no_other(matcher, argument, value, parameter, expected):
    found = matcher(**{argument: value})
    assert len(found.files) == 1
    assert values(found) == {parameter: expected}


def test_the_robot_is_localised_in_the_map_that_is_named(launched):
    [node] = launched('localization', map='floor.yaml', base_frame='base')
    assert values(rules(node)) == {'map.mode': 'localize', 'map.file': 'floor.yaml', 'base_frame': 'base'}


@pytest.mark.parametrize('argument, value, complaint', [
    ('publish_tf', 'maybe', 'expected true or false'), ('lifecycle', '2', 'expected true or false'),
    ('params_file', '/missing.yaml', 'there is no such file')])
def test_a_value_that_cannot_be_stops_the_launch(matcher, argument, value, complaint):
    with pytest.raises(ParameterError, match=f'^{argument} = {value!r}: {complaint}'):
        matcher(**{argument: value})


def test_a_parameter_file_may_lie_in_the_home_or_in_the_working_directory(matcher, tmp_path, monkeypatch):
    path = parameter_file(tmp_path / 'robot.yaml', {'odom_frame': 'a'})
    monkeypatch.setenv('HOME', str(tmp_path))
    assert matcher(params_file='~/robot.yaml').files == [path]
    monkeypatch.chdir(tmp_path)
    assert matcher(params_file='robot.yaml').files == [path]


def test_the_least_severity_is_handed_on(launched, play, level='scan_matcher:=debug'):
    [node] = launched('scan_matcher', log_level=level)
    assert rules(node).log == level
    assert [rules(node).log for node in play(log_level=level)] == [level, level]


# Names of topics


@pytest.mark.parametrize('arguments, expected', [
    ({}, TRANSFORMS),
    ({'remap_tf': 'false'}, []),
    ({'scan_topic': '/front/scan'}, [*TRANSFORMS, ('scan', '/front/scan')]),
    ({'scan_topic': 'laser', 'remap_tf': 'false'}, [('scan', 'laser')]),
])
def test_topics_are_remapped_for_the_node_and_the_player(matcher, play, arguments, expected):
    assert matcher(namespace='robot1', **arguments).remap == [('__node', 'scan_matcher'), ('__ns', '/robot1'),
                                                              *expected]
    _, player = play(namespace='robot1', **arguments)
    assert rules(player).remap == [('__node', 'play'), ('__ns', '/robot1'), *expected]


# Order


def test_defaults_sensor_parameter_file_and_arguments_count_in_this_order(play, start_launched, peer, tmp_path):
    path = parameter_file(tmp_path / 'robot.yaml', {'scan': {'range_max': 7.5}, 'odom_frame': 'of_file',
                                                    'base_frame': 'of_file', 'publish_tf': False},
                          '/robot1/scan_matcher')
    launched, _ = play(namespace='robot1', sensor='rplidar_a', params_file=path, base_frame='given', prior='none')
    start_launched(launched)
    asked = ('scan.range_min', 'scan.range_max', 'odom_frame', 'base_frame', 'publish_tf', 'prior.source', 'mounting',
             'use_sim_time')
    sensor = read(rules(launched).files[0])['/**']['ros__parameters']
    assert Parameters(peer, '/robot1/scan_matcher').get(*asked) == [
        sensor['scan']['range_min'], 7.5, 'of_file', 'given', False, 'none', 'none', True]


def test_an_argument_overrides_the_defaults_of_playback(play):
    found = rules(play(mounting='tf', use_sim_time='false')[0])
    assert found.set == [('use_sim_time', 'true'), ('mounting', 'none')]
    assert values(found) == {'mounting': 'tf', 'use_sim_time': False}


# The lifecycle node


def test_the_lifecycle_node_stays_unconfigured_without_autostart(launched):
    [node] = launched('scan_matcher', lifecycle='true', autostart='false', namespace='robot1', base_frame='b')
    assert isinstance(node, launch_stand_in.LifecycleNode)
    assert node.executable == 'scan_matcher_lifecycle' and node.executable in COMMANDS
    assert rules(node).remap == [('__node', 'scan_matcher'), ('__ns', '/robot1'), *TRANSFORMS]
    assert values(rules(node)) == {'base_frame': 'b'}


def test_the_lifecycle_node_is_configured_and_activated(launched, start_launched, peer):
    """What launch does with the actions is done here: the events go to the real node, and its own come back."""
    registered, node, first = launched('scan_matcher', lifecycle='true', namespace='robot1', mounting='none')
    handler = registered.event_handler
    assert handler.node is node
    name = '/robot1/scan_matcher'
    start_launched(node)
    events = peer.listen(TransitionEvent, f'{name}/transition_event')

    def ask(action):
        assert action.event.lifecycle_node_matcher(node) and not action.event.lifecycle_node_matcher(handler)
        request = ChangeState.Request()
        request.transition.id = action.event.transition_id
        assert peer.call(ChangeState, f'{name}/change_state', request).success

    peer.greet(name)
    ask(first)
    peer.until(lambda: any(handled(handler, event) for event in events))
    [second] = handler.entities
    ask(second)
    current = peer.call(GetState, f'{name}/get_state', GetState.Request()).current_state
    assert current.id == State.PRIMARY_STATE_ACTIVE
    peer.until(lambda: len(events) >= 4)
    assert [handled(handler, event) for event in events].count(True) == 1


def handled(handler, event):
    return (event.start_state.label, event.goal_state.label) == (handler.start_state, handler.goal_state)


# RViz


@pytest.mark.parametrize('name', FILES)
def test_rviz_is_started_in_the_namespace_with_all_that_it_shows(launched, prefix, name):
    prefix('rviz2')
    recording = {'recording': 'missing.log'} if name == 'play' else {}
    matcher, rviz, *_ = launched(name, rviz='true', namespace='robot1', scan_topic='laser', odom_frame='map',
                                 **recording)
    assert matcher.executable == 'scan_matcher'
    assert (rviz.package, rviz.executable, rviz.name) == ('rviz2', 'rviz2', None)
    found = rules(rviz)
    shown, frame, followed = configured(found)
    assert (frame, followed) == ('map', 'base_link')
    expected = {(topic, 'laser' if topic == '/scan' else topic.removeprefix('/')) for topic in shown}
    assert set(found.remap) == {('__ns', '/robot1'), *TRANSFORMS, *expected}
    assert values(found) == {'use_sim_time': name == 'play'}


def configured(found):
    """Topics, fixed frame and followed frame of the configuration that RViz is started with."""
    flag, config = found.own
    assert flag == '-d'
    manager = read(config)['Visualization Manager']
    topics = [display['Topic']['Value'] for display in manager['Displays'] if 'Topic' in display]
    return topics, manager['Global Options']['Fixed Frame'], manager['Views']['Current']['Target Frame']


def test_rviz_shows_the_scans_of_all_lidars_and_follows_the_base(launched, prefix, tmp_path):
    prefix('rviz2')
    file = parameter_file(tmp_path / 'two.yaml', {'scan_topics': ['front/scan', '/rear'], 'base_frame': 'chassis'})
    found = rules(launched('scan_matcher', rviz='true', params_file=file)[1])
    shown, frame, followed = configured(found)
    assert (frame, followed) == ('odom', 'chassis')
    assert {'/scan', '/scan2'} < set(shown)
    assert {('/scan', 'front/scan'), ('/scan2', '/rear')} < set(found.remap)


def test_with_respawn_the_node_is_started_again(launched):
    [node] = launched('scan_matcher', respawn='true')
    assert node.process == {'output': 'screen', 'respawn': True, 'respawn_delay': 2.0}


def test_where_rviz_is_not_installed_the_launch_stops_and_says_what_to_install(launched, monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    with pytest.raises(ParameterError) as error:
        launched('scan_matcher', rviz='true')
    assert str(error.value) == "rviz = 'true': rviz2 is not installed; install it: sudo apt install ros-jazzy-rviz2"
    assert len(launched('scan_matcher')) == 1


# Playing


def test_the_player_gets_recording_clock_rate_and_topics(play, monkeypatch):
    monkeypatch.setenv('HOME', '/home/robot')
    _, player = play(recording='~/drive.bag', rate='0.5', topics='/cmd_vel  /camera/info')
    assert (player.package, player.executable) == ('dbscan_reg_ros', 'play') and player.executable in COMMANDS
    assert rules(player).own == ['/home/robot/drive.bag', '--clock', '--rate', '0.5', '--topics', '/cmd_vel',
                                 '/camera/info']
    matcher, player = play(recording='drive.bag')
    assert rules(player).own == ['drive.bag', '--clock', '--rate', '1.0']
    assert rules(matcher).set[1] == ('mounting', 'none'), 'a recording that cannot be read'
    assert isinstance(player.process['on_exit'], launch_stand_in.Shutdown) and 'on_exit' not in matcher.process


@pytest.mark.parametrize('topics, mounting', [(['/robot1/tf_static'], 'tf'), (['/tf'], 'none')])
def test_the_mounting_is_read_from_static_transforms_that_the_player_publishes(play, tmp_path, topics, mounting):
    pytest.importorskip('rosbags', reason='needs rosbags')
    from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
    empty = bytes(MessageMaker().serialize('tf2_msgs/msg/TFMessage', {}))
    bag = write_bag(tmp_path / 'bag', [('/scan', 10, laser_scan()), *((topic, 10, empty) for topic in topics)],
                    kinds=dict.fromkeys(topics, 'tf2_msgs/msg/TFMessage'))
    assert rules(play(recording=str(bag))[0]).set == [('use_sim_time', 'true'), ('mounting', mounting)]


@pytest.mark.parametrize('arguments, topics', [
    ({'scan_topic': 'front/scan'}, ['/front/scan']), ({'scan_topic': '/scan'}, []),
    ({'params_file': 'two.yaml'}, ['/front/scan', '/rear/scan'])])
def test_of_several_lidars_those_of_the_arguments_are_played(play, tmp_path, monkeypatch, arguments, topics):
    """With the mounting on /tf, as the recording has no static transforms."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'two.yaml').write_text('/**: {ros__parameters: {scan_topics: [front/scan, /rear/scan]}}')
    mounting = {'header': {'frame_id': 'base_link'}, 'child_frame_id': 'front'}
    transforms = bytes(MessageMaker().serialize('tf2_msgs/msg/TFMessage', {'transforms': [mounting]}))
    bag = write_bag(tmp_path / 'bag', [('/front/scan', 10, laser_scan()), ('/rear/scan', 10, laser_scan()),
                                       ('/tf', 10, transforms)], kinds={'/tf': 'tf2_msgs/msg/TFMessage'})
    matcher, player = play(recording=str(bag), **arguments)
    assert rules(player).own[4:] == [word for topic in topics for word in ('--topic', topic)]
    assert rules(matcher).set[1] == ('mounting', 'tf' if topics else 'none')


# Real processes


def test_a_recording_that_is_launched_is_answered_and_all_end_well(play, start_launched, tmp_path):
    log = room_log(tmp_path / 'room.log', 20)
    matcher, player = map(start_launched, play(recording=str(log), namespace='robot1', scan_topic='laser'))
    assert player.wait(60.0) == 0, player.output()
    assert 'scans 20 answered 20 skipped 0' in player.output()
    assert matcher.stop() == 0, matcher.output()


@pytest.mark.parametrize(('stage', 'often'), [('waiting', True), ('playing', False)])
def test_ctrl_c_ends_every_process_with_0(play, start_launched, peer, tmp_path, stage, often):
    """For any other status launch prints an error; the signal may come from the terminal and from launch."""
    log = room_log(tmp_path / 'room.log', 600)
    processes = [start_launched(node) for node in play(recording=str(log))[1 if stage == 'waiting' else 0:]]
    if stage == 'playing':
        received = peer.listen(Odometry, '/odom')
        peer.until(lambda: len(received) > 3)
    else:
        peer.until(lambda: peer.node.count_publishers('/clock'))
    interrupt(processes)
    deadline = time.monotonic() + 5.0
    while often and any(process.running() for process in processes) and time.monotonic() < deadline:
        interrupt(processes)
    assert [process.wait(5.0) for process in processes] == [0] * len(processes), [p.output() for p in processes]
    assert not any('Traceback' in process.output() for process in processes)


def interrupt(processes):
    for process in processes:
        process.signal(signal.SIGINT)


# The stand-in and the real launch


def test_the_stand_in_has_no_keyword_that_launch_does_not_have():
    pytest.importorskip('launch_ros', reason='needs launch_ros, part of a ROS installation')
    for module, names in launch_stand_in.MODULES.items():
        for name in names.keys() - {'LaunchContext'}:
            known, ours = (inspect.signature(each).parameters for each in (
                getattr(importlib.import_module(module), name), names[name]))
            open_ended = any(p.kind is p.VAR_KEYWORD for p in known.values())
            assert open_ended or set(ours) <= set(known), name


@pytest.mark.parametrize('name', FILES)
def test_the_real_launch_declares_the_same_arguments(root, prefix, name):
    pytest.importorskip('launch_ros', reason='needs launch_ros, part of a ROS installation')
    declared = {a.name: a for a in load(root, name).get_launch_arguments()}
    defaults = {name: a.default_value and ''.join(part.text for part in a.default_value) for name,
                a in declared.items()}
    assert {name: default or None for name, default in defaults.items()} == {
        name: default or None for name, default in ARGUMENTS[name].items()}


def test_the_real_launch_makes_the_same_command_line(root, prefix, tmp_path):
    pytest.importorskip('launch_ros', reason='needs launch_ros, part of a ROS installation')
    from launch.actions import DeclareLaunchArgument

    from launch import LaunchContext
    path = parameter_file(tmp_path / 'robot.yaml', {'odom_frame': 'a'})
    context = LaunchContext()
    context.launch_configurations.update({'namespace': 'robot1', 'params_file': path, 'base_frame': 'b'})
    *declared, function = load(root, 'scan_matcher').entities
    for argument in declared:
        assert isinstance(argument, DeclareLaunchArgument)
        argument.execute(context)
    [node] = function.execute(context)
    node._perform_substitutions(context)
    assert node.node_name == '/robot1/scan_matcher'
    assert node.expanded_remapping_rules == TRANSFORMS
    (first, _), (second, _) = node._Node__expanded_parameter_arguments
    assert first == path
    assert read(second) == {'/robot1/scan_matcher': {'ros__parameters': {'base_frame': 'b'}}}
