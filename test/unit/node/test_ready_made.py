# SPDX-License-Identifier: Apache-2.0
"""Ready-made files: what they name is what the node has."""
import json

import pytest
import yaml

from dbscan_reg_ros.paths import ready_made
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters

DEFAULTS = NodeParameters()
FRAMES = {DEFAULTS.odom_frame, DEFAULTS.base_frame}


@pytest.fixture
def node(start_core):
    return start_core().node


@pytest.fixture
def topics(node):
    """Absolute name -> type of every topic of the node."""
    return {each.topic_name: f'{each.msg_type.__module__.partition(".")[0]}/msg/{each.msg_type.__name__}'
            for each in (*node.publishers, *node.subscriptions)}


def test_parameter_files_of_sensors_are_taken():
    for sensor in ready_made():
        parameters = read_parameters(sensor)
        assert 0.0 < parameters.scan.range_min < parameters.scan.range_max, sensor
        assert parameters.scan.noise_min < parameters.scan.noise_max and parameters.mounting == 'tf', sensor


def rviz_shows_what_the_node_publishes(root, topics):
    shown = yaml.safe_load((root / 'config' / 'scan_matcher.rviz').read_text())['Visualization Manager']
    assert shown['Global Options']['Fixed Frame'] == DEFAULTS.odom_frame
    assert shown['Views']['Current']['Target Frame'] == DEFAULTS.base_frame
    displays = {d['Topic']['Value']: d for d in shown['Displays'] if 'Topic' in d}
    assert set(displays) == {'/scan', '/odom', '/segments', '/path', '/local_map'}
    for topic, display in displays.items():
        assert topics[topic].split('/')[-1] == display['Class'].split('/')[-1]
        assert display['Topic']['Reliability Policy'] == ('Best Effort' if topic == '/scan' else 'Reliable')


def foxglove_shows_what_the_node_publishes(root, topics):
    layout = json.loads((root / 'config' / 'foxglove_layout.json').read_text())
    panels = layout['configById']
    scene = panels['3D!scan_matcher']
    assert {scene['fixedFrame'], scene['followTf']} == FRAMES
    assert set(scene['topics']) <= set(topics)
    for path in panels['Plot!twist']['paths']:
        topic, *fields = path['value'].split('.')
        assert topics[topic] == 'nav_msgs/msg/Odometry'
        assert has_field('nav_msgs.msg', 'Odometry', fields)
    assert {p['topicToRender'] for p in panels.values() if 'topicToRender' in p} <= set(topics)
    assert panels['DiagnosticStatusPanel!details']['selectedName'] == '/scan_matcher: laser odometry'
    assert set(leaves(layout['layout'])) == set(panels)


def has_field(module, kind, fields):
    from importlib import import_module
    message = getattr(import_module(module), kind)()
    for field in fields:
        message = getattr(message, field)
    return isinstance(message, float)


def leaves(layout):
    if isinstance(layout, str):
        yield layout
    else:
        yield from leaves(layout['first'])
        yield from leaves(layout['second'])


def the_filter_takes_our_twist_in_our_frames(root, topics):
    filter_parameters = yaml.safe_load((root / 'config' / 'ekf.yaml').read_text())['ekf_filter_node']['ros__parameters']
    assert topics[f'/{filter_parameters["odom0"]}'] == 'nav_msgs/msg/Odometry'
    assert (filter_parameters['odom_frame'], filter_parameters['base_link_frame']) == ('odom', 'base_link')
    rows = ['x', 'y', 'z', 'roll', 'pitch', 'yaw', 'vx', 'vy', 'vz', 'vroll', 'vpitch', 'vyaw', 'ax', 'ay', 'az']
    taken = {key: {row for row, use in zip(rows, filter_parameters[key], strict=True) if use}
             for key in ('odom0_config', 'imu0_config')}
    assert taken == {'odom0_config': {'vx', 'vy', 'vyaw'}, 'imu0_config': {'vyaw'}}
    assert filter_parameters['smooth_lagged_data'] and filter_parameters['history_length'] > 0.0


def the_documented_topics_are_those_of_the_node(root, topics):
    text = (root / 'doc' / 'node.md').read_text()
    for topic in topics:
        relative = topic.removeprefix('/')
        assert f'`{topic}`' in text or f'`{relative}`' in text, topic


def test_ready_made_files_and_documents_name_what_the_node_has(root, topics):
    rviz_shows_what_the_node_publishes(root, topics)
    foxglove_shows_what_the_node_publishes(root, topics)
    the_filter_takes_our_twist_in_our_frames(root, topics)
    the_documented_topics_are_those_of_the_node(root, topics)


def test_the_documented_services_are_those_of_the_node(root, node):
    text = (root / 'doc' / 'node.md').read_text()
    names = {service.srv_name for service in node.services}
    assert names == {'/scan_matcher/pause', '/scan_matcher/reset', '/scan_matcher/snapshot'}
    for name in names:
        assert f'`~/{name.split("/")[-1]}`' in text
