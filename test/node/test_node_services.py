# SPDX-License-Identifier: Apache-2.0
"""What can be asked of the running node: reset, pause, set_pose, snapshot, dump."""
import math
from functools import reduce

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from ros_helpers import TIMEOUT, Loudspeaker, Parameters, diagnosis, distances, mounted, played, pose_of
from std_srvs.srv import SetBool, Trigger

from dbscan_reg_ros import SE2, register
from dbscan_reg_ros import Parameters as MethodParameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.node.interfaces.messages import pose_to_message
from dbscan_reg_ros.recordings.snapshots import read_snapshot
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


def given(pose, frame='odom', variance=0.04):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose = pose_to_message(pose)
    message.pose.covariance = (variance * np.eye(6)).ravel()
    return message


def test_a_pose_is_refused_by_name_or_becomes_that_of_the_next_scan(start_node, player, peer, scans, truth):
    laser = SE2(0.3, 0.1, 1.0)
    node = start_node(*mounted(laser))
    assert played(player, scans[:9]).lost == 0
    poses = Loudspeaker(peer, PoseWithCovarianceStamped, 'set_pose')
    for wrong, complaint in ((given(SE2(), frame='map'), "the pose is in 'map'; expected 'odom'"),
                             (given(SE2(), variance=math.nan), 'its covariance is invalid')):
        poses.until(lambda complaint=complaint: complaint in node.output(), wrong)
    assert pose_of(player.play(scans[9:10]).messages[0]) != SE2()
    place = SE2(12.0, -7.0, 2.0)
    poses.until(lambda: 'odometry reset: set_pose to x 12.000 m, y -7.000 m' in node.output(), given(place))
    answers = player.play(scans[10:30])
    assert answers.lost == 0
    assert pose_of(answers.messages[0]).as_array() == pytest.approx(place.as_array())
    expected = [place @ laser @ truth[10].inverse() @ pose @ laser.inverse() for pose in truth[10:30]]
    assert distances(answers.messages, expected).max() < 0.05
    first, last = (np.reshape(answers.messages[k].pose.covariance, (6, 6)) for k in (0, -1))
    assert np.diag(first)[[0, 1, 5]] == pytest.approx([0.04] * 3, abs=1e-4)
    moved = np.subtract(pose_of(answers.messages[-1]).as_array()[:2], place.as_array()[:2])
    assert np.diag(last)[[0, 1]] == pytest.approx(0.04 + 0.04 * moved[::-1]**2, rel=0.1)


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


def test_a_snapshot_holds_the_last_scans_and_registers_them_again(start_node, player, peer, scans, tmp_path):
    start_node('-p', f'advanced.snapshot.folder:={tmp_path}/new', '-p', 'advanced.snapshot.scans:=5', '-p',
               'scan.range_max:=25.0')
    player.wait_for_node(TIMEOUT)
    assert trigger(peer, 'snapshot').message == 'no scan was processed yet'
    answers = player.play(scans[:12])
    assert answers.lost == 0
    answer = trigger(peer, 'snapshot')
    assert answer.success
    snapshot = read_snapshot(answer.message)
    assert [update.stamp for update in snapshot.updates] == [scan.stamp for scan in scans[7:12]]
    assert NodeParameters().replace(snapshot.parameters).scan.range_max == 25.0
    assert snapshot.updates[-1].pose.as_array() == pytest.approx(pose_of(answers.messages[-1]).as_array())
    for update, scan in zip(snapshot.updates, scans[7:12], strict=True):
        assert update.scan.ranges.tobytes() == scan.ranges.tobytes()
        assert len(update.registration.hypotheses) >= 1
    update = snapshot.updates[-1]
    parameters = MethodParameters()
    again = register(extract_features(update.reference, parameters), extract_features(update.scan, parameters),
                     parameters)
    error = update.registration.transform.inverse() @ again.transform
    assert error.as_array() == pytest.approx([0.0, 0.0, 0.0], abs=0.02)


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


def test_what_ros2_param_dump_writes_is_taken_back_unchanged(start_node, start_command, peer, tmp_path):
    first = start_node('-p', 'scan.range_max:=7.5', '-p', 'input.mask:=[0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]', '-p',
                       'odom_frame:=laser_odom')
    assert Parameters(peer).set(prior__rotation=0.25)[0].successful
    before = dumped(Parameters(peer), tmp_path / 'dump.yaml')
    first.stop()
    peer.until(lambda: not peer.node.count_publishers('/odom'))
    start_command('scan_matcher', '--ros-args', '--params-file', tmp_path / 'dump.yaml')
    assert dumped(Parameters(peer), tmp_path / 'again.yaml') == before
    assert read_parameters(tmp_path / 'dump.yaml').flatten() == NodeParameters().replace({
        'scan.range_max': 7.5, 'input.mask': (0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 'odom_frame': 'laser_odom',
        'prior.rotation': 0.25, 'mounting': 'none'}).flatten()
