# SPDX-License-Identifier: Apache-2.0
"""What can be asked of the running node: reset, pause, set_pose, snapshot, dump."""
from functools import reduce

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros_helpers import Parameters, diagnosis, distances, played, pose_of
from std_srvs.srv import SetBool, Trigger

from dbscan_reg_ros import SE2
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters


def trigger(peer, name):
    return peer.call(Trigger, f'/scan_matcher/{name}', Trigger.Request())


def pause(peer, value):
    return peer.call(SetBool, '/scan_matcher/pause', SetBool.Request(data=value))


def test_a_paused_node_ignores_scans_and_after_a_reset_the_next_scan_is_the_origin(node, player, peer, scans, truth):
    assert played(player, scans[:10]).lost == 0
    received = peer.listen(DiagnosticArray, '/diagnostics')
    assert pause(peer, True).success
    assert diagnosis(peer, received, lambda status: status.message == 'paused').level == DiagnosticStatus.OK
    assert player.play(scans[10:13], patience=0.3).lost == 3
    assert pause(peer, False).success
    answers = player.play(scans[13:20])
    assert answers.lost == 0
    assert distances(answers.messages, truth[13:20]).max() < 0.05
    assert trigger(peer, 'reset').success
    answers = player.play(scans[20:40])
    assert answers.lost == 0
    assert pose_of(answers.messages[0]) == SE2()
    back = truth[20].inverse()
    assert distances(answers.messages, [back @ pose for pose in truth[20:40]]).max() < 0.05
    covariance = np.reshape(answers.messages[0].pose.covariance, (6, 6))
    assert covariance[0, 0] < 1e-5


def test_the_pose_is_kept_over_a_restart(start_node, player, peer, scans, tmp_path):
    """`initial_pose` holds at the first start only, and after a reset."""
    words = '-p', 'initial_pose:=[3.0, 4.0, 0.5]', '-p', f'state_file:={tmp_path / "pose.json"}'
    first = start_node(*words)
    answers = played(player, scans[:20])
    assert pose_of(answers.messages[0]).as_array() == pytest.approx([3.0, 4.0, 0.5])
    last, before = pose_of(answers.messages[-1]), answers.messages[-1].pose.covariance[0]
    assert first.stop() == 0
    start_node(*words)
    answers = played(player, scans[20:22])
    assert pose_of(answers.messages[0]).as_array() == pytest.approx(last.as_array())
    assert answers.messages[0].pose.covariance[0] > before + NodeParameters().prior.unknown_sigma ** 2
    assert trigger(peer, 'reset').success
    answers = player.play(scans[22:24])
    assert pose_of(answers.messages[0]).as_array() == pytest.approx([3.0, 4.0, 0.5])


def dumped(parameters, path):
    """Write the parameters of a running node as ``ros2 param dump`` does; return name -> value."""
    names = parameters.names()
    values = dict(zip(names, parameters.get(*names), strict=True))
    tree = {}
    for name, value in values.items():
        *groups, last = name.split('.')
        reduce(lambda inner, group: inner.setdefault(group, {}), groups, tree)[last] = \
            list(value) if hasattr(value, 'tolist') else value
    path.write_text(yaml.dump({'/scan_matcher': {'ros__parameters': tree}}))
    return values


def test_all_parameters_are_declared_and_what_ros2_param_dump_writes_is_taken_back_unchanged(start_node, start_command,
                                                                                          peer, tmp_path):
    expected = NodeParameters().replace({
        'scan.range_max': 7.0, 'input.mask': (0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 'odom_frame': 'laser_odom',
        'prior.rotation': 0.25, 'mounting': 'none'}).flatten()
    first = start_node('-p', 'scan.range_max:=7', '-p', 'input.mask:=[0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]', '-p',
                       'odom_frame:=laser_odom')
    assert Parameters(peer).set(prior__rotation=0.25)[0].successful
    before = dumped(Parameters(peer), tmp_path / 'dump.yaml')
    assert {name: tuple(before[name]) if isinstance(value, tuple) else before[name]
            for name, value in expected.items()} == expected
    first.stop()
    peer.until(lambda: not peer.node.count_publishers('/odom'))
    start_command('scan_matcher', '--ros-args', '--params-file', tmp_path / 'dump.yaml')
    assert dumped(Parameters(peer), tmp_path / 'again.yaml') == before
    assert read_parameters(tmp_path / 'dump.yaml').flatten() == expected
