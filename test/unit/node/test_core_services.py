# SPDX-License-Identifier: Apache-2.0
"""Poses that are set, snapshots, and priors in the node, without DDS."""
import errno
import itertools
import math
import os

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from ros_helpers import distances, of_base, pose_of, transform
from sensor_msgs.msg import Imu

from dbscan_reg_ros import SE2, Parameters, register
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.node.interfaces import services
from dbscan_reg_ros.node.interfaces.messages import planar_from_message, pose_to_message, stamp_to_message
from dbscan_reg_ros.recordings.snapshots import read_snapshot
from dbscan_reg_ros.robot.parameters import NodeParameters, NodePriorParameters

LASER = SE2(0.2, 0.1, 0.5)
"""On the base."""
PLACE = {'mounting': 'laser_pose', 'laser_pose': LASER.as_tuple()}


def given(pose, frame='odom', variance=0.04):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose = pose_to_message(pose)
    message.pose.covariance = (variance * np.eye(6)).ravel()
    return message


def test_a_pose_is_refused_by_name_or_becomes_that_of_the_next_scan(start_core, scans, truth):
    robot = start_core(**PLACE)
    robot.play(scans[:9])
    robot.receive('/set_pose', given(SE2(), frame='map'), given(SE2(), variance=math.nan))
    assert "set_pose is ignored: the pose is in 'map'; expected 'odom'" in robot.log
    assert 'set_pose is ignored: its covariance is invalid' in robot.log
    assert pose_of(robot.play(scans[9:10])[0]) != SE2() and 'odometry reset' not in robot.log
    place = SE2(12.0, -7.0, 2.0)
    robot.receive('/set_pose', given(place))
    assert 'odometry reset: set_pose to x 12.000 m, y -7.000 m' in robot.log
    answers = robot.play(scans[10:30])
    assert pose_of(answers[0]).as_array() == pytest.approx(place.as_array())
    expected = [place @ LASER @ truth[10].inverse() @ pose @ LASER.inverse() for pose in truth[10:30]]
    assert distances(answers, expected).max() < 0.05
    first, last = (np.reshape(answers[k].pose.covariance, (6, 6)) for k in (0, -1))
    assert np.diag(first)[[0, 1, 5]] == pytest.approx([0.04] * 3, abs=1e-4)
    moved = np.subtract(pose_of(answers[-1]).as_array()[:2], place.as_array()[:2])
    assert np.diag(last)[[0, 1]] == pytest.approx(0.04 + 0.04 * moved[::-1]**2, rel=0.1)


def snapshot(robot):
    return robot.call('/scan_matcher/snapshot')


def test_a_snapshot_holds_the_last_scans_and_registers_them_again(start_core, scans, tmp_path):
    robot = start_core(advanced__snapshot__folder=f'{tmp_path}/new', advanced__snapshot__scans=5, scan__range_max=25.0)
    assert snapshot(robot).message == 'no scan was processed yet'
    answers = robot.play(scans[:12])
    answer = snapshot(robot)
    assert answer.success and answer.message.startswith(f'{tmp_path}/new/scan_matcher_')
    found = read_snapshot(answer.message)
    assert [update.stamp for update in found.updates] == [scan.stamp for scan in scans[7:12]]
    assert NodeParameters().replace(found.parameters).scan.range_max == 25.0
    assert found.updates[-1].pose.as_array() == pytest.approx(pose_of(answers[-1]).as_array())
    for update, scan in zip(found.updates, scans[7:12], strict=True):
        assert update.scan.ranges.tobytes() == scan.ranges.tobytes()
        assert len(update.registration.hypotheses) >= 1
    update, parameters = found.updates[-1], Parameters()
    again = register(extract_features(update.reference, parameters), extract_features(update.scan, parameters),
                     parameters)
    error = update.registration.transform.inverse() @ again.transform
    assert error.as_array() == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
    robot.set(advanced__snapshot__scans=2)
    robot.play(scans[12:14])
    assert len(read_snapshot(snapshot(robot).message).updates) == 2


def test_a_snapshot_that_cannot_be_written_costs_nothing_but_itself(start_core, scans, steady, moment, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    robot = start_core(advanced__snapshot__folder='/sys')
    before = robot.play(scans[:moment])
    answer = snapshot(robot)
    assert not answer.success
    assert answer.message.startswith('/sys/scan_matcher_') and 'cannot be written: ' in answer.message
    monkeypatch.setattr(services, 'write_snapshot', full)
    assert snapshot(robot).message.endswith('cannot be written: No space left on device')
    steady([*before, *robot.play(scans[moment:])])


# Priors


@pytest.mark.parametrize(('motion', 'translation', 'rotation'), [
    ((0.0, 0.0, 0.0), 0.02, 0.03), ((0.06, -0.08, -0.1), 0.02, 0.03), ((0.6, 0.8, 0.0), 0.1, 0.1),
    ((0.0, 0.0, -1.0), 0.1, 0.2), ((0.0, 2.0, 0.5), 0.2, 0.2)])
def test_the_covariance_of_a_prior_grows_with_distance_and_rotation(motion, translation, rotation):
    spread = NodePriorParameters().wheel_sigma(SE2(*motion))
    assert spread == pytest.approx((translation, translation, rotation), rel=1e-12)


def between(scans, truth):
    """(stamp, true pose of the base) halfway between the scans, and a little before the first and after the last."""
    bases = [SE2(9.0, -4.0, 2.0) @ pose @ LASER.inverse() for pose in truth]
    yield scans[0].stamp - 50_000_000, bases[0]
    for (a, b), (p, q) in zip(itertools.pairwise(scans), itertools.pairwise(bases), strict=True):
        step = p.inverse() @ q
        yield (a.stamp + b.stamp) // 2, p @ SE2(0.5 * step.x, 0.5 * step.y, 0.5 * step.theta)
    yield scans[-1].stamp + 50_000_000, bases[-1]


def play_with(robot, topic, messages, scans):
    """Each scan comes before the message that is stamped after it, for which it waits; return its odometry."""
    robot.receive(topic, messages[0])
    for scan, late in zip(scans, messages[1:], strict=True):
        robot.receive('/scan', scan)
        robot.receive(topic, late)
    return robot.sent('/odom')


def errors(robot, truth):
    """Errors of the priors in a snapshot; those of the laser, as it looks along the base."""
    along, updates = SE2(theta=LASER.theta), read_snapshot(snapshot(robot).message).updates
    assert updates[0].prior is None
    for update, before, now in zip(updates[1:], truth, truth[1:], strict=False):
        motion = along @ before.inverse() @ now @ along.inverse()
        yield (motion.inverse() @ update.prior.transform).as_array()


def wheels(scans, truth):
    """Messages of the wheels between the scans."""
    for stamp, pose in between(scans, truth):
        message = Odometry()
        message.header.stamp, message.pose.pose = stamp_to_message(stamp), pose_to_message(pose)
        yield message


def test_wheels_give_the_translation_and_the_gyroscope_the_rotation(start_core, scans, truth, tmp_path):
    """The heading of the wheels is off by 0.08 rad in two of four messages, its change by 0.04 rad at each scan."""
    robot = start_core(**PLACE, prior__source='odometry+imu', advanced__snapshot__folder=str(tmp_path))
    for k, message in enumerate(wheels(scans[:20], truth[:20])):
        off = planar_from_message(message.pose.pose) @ SE2(theta=0.08 * (k // 2 % 2))
        message.pose.pose = pose_to_message(off)
        robot.receive('/wheel_odom', message)
    rates = [10.0 * (a.inverse() @ b).theta for a, b in itertools.pairwise(truth[:21])]
    turning = [(scan.stamp + late, rate) for scan, rate in zip(scans, rates, strict=False) for late in (0, 50_000_000)]
    for stamp, rate in (scans[0].stamp - 1, 0.0), *turning:
        message = Imu()
        message.header.stamp, message.angular_velocity.z = stamp_to_message(stamp), rate
        robot.receive('/imu', message)
    assert distances(robot.play(scans[:20]), of_base(truth[:20], LASER)).max() < 0.05
    found = list(errors(robot, truth))
    assert len(found) == 19 and np.abs(found).max() < 0.02


def test_wheels_give_the_motion_until_they_go_quiet_which_delays_no_scan(start_core, scans, truth, tmp_path):
    robot = start_core(**PLACE, prior__source='odometry', advanced__snapshot__folder=str(tmp_path),
                       advanced__input__max_wait=5.0)
    assert len(play_with(robot, '/wheel_odom', list(wheels(scans[:10], truth[:10])), scans[:10])) == 10
    assert np.abs(list(errors(robot, truth))).max() < 0.02
    answers = robot.play(scans[10:60])
    assert answers[0] is None, 'the first scan waits for the wheels'
    robot.node.wait(5.0)
    answers = robot.sent('/odom')
    assert [m.header.stamp for m in answers] == [stamp_to_message(scan.stamp) for scan in scans[:60]]
    assert distances(answers, of_base(truth[:60], LASER)).max() < 0.05
    robot.node.others['/wheel_odom'] = [object()]
    robot.play(scans[60:62])
    assert "prior.source is 'odometry', but /wheel_odom has no data at the time of the scan" in robot.log
    assert {update.prior for update in read_snapshot(snapshot(robot).message).updates[-20:]} == {None}


def test_transforms_of_another_node_give_the_motion(start_core, scans, truth, tmp_path, tf_type):
    robot = start_core(**PLACE, prior__source='tf', advanced__snapshot__folder=str(tmp_path),
                       advanced__input__max_wait=5.0)
    messages = [tf_type(transforms=[transform('wheel_odom', 'laser', base @ LASER, stamp=stamp)])
                for stamp, base in between(scans[:20], truth[:20])]
    assert len(play_with(robot, '/tf', messages, scans[:20])) == 20
    found = list(errors(robot, truth))
    assert len(found) == 19 and np.abs(found).max() < 0.02
