# SPDX-License-Identifier: Apache-2.0
"""Messages of the node: what goes in comes out, and covariances follow the mounting."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy.serialization
from geometry_msgs.msg import PoseWithCovarianceStamped, Transform, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from dbscan_reg_ros import SE2, OdometryUpdate, Scan, ScanError, ScanGeometry, Status
from dbscan_reg_ros.core.geometry.mounting import Mounting, MountingError
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.frames import transform_sender
from dbscan_reg_ros.node.interfaces.messages import PreparedMessage, filled, initial_pose, scan_to_message
from dbscan_reg_ros.node.interfaces.outputs import ODOM_NUMBERS
from dbscan_reg_ros.recordings.message_fields import (
    odometry_fields,
    odometry_numbers,
    transform_fields,
    transform_numbers,
)
from dbscan_reg_ros.recordings.poses import PoseError, matrix_of, pose_of_transform
from dbscan_reg_ros.robot.base_state import BaseState, base_state

STAMP = 1_234_567_890_123_456_789


@pytest.fixture(scope='module')
def scan():
    rng = np.random.default_rng(3)
    ranges = rng.uniform(0.1, 20.0, 271)
    ranges[::7] = math.inf
    ranges[5] = math.nan
    return Scan(STAMP, ranges, ScanGeometry(-2.0, 0.0123, 271, 0.05, 12.0), 1e-5, 'front_laser')


def state(pose=SE2(1.0, -2.0, 0.5), covariance=np.diag([1e-4, 4e-4, 9e-6])):
    return BaseState(STAMP, pose, covariance, np.array([0.3, -0.1, 0.2]), 2.0 * covariance)


def odometry_message(base):
    return filled(Odometry(), odometry_fields(base, 'odom', 'base'))


def test_a_scan_survives_its_message_and_the_wire(scan):
    wire = rclpy.serialization.serialize_message(scan_to_message(scan))
    back = Scan.from_message(rclpy.serialization.deserialize_message(wire, LaserScan))
    assert back.stamp == STAMP
    assert back.ranges.tobytes() == scan.ranges.tobytes()
    assert (back.geometry, back.time_increment, back.frame_id) == (scan.geometry, scan.time_increment, 'front_laser')


def test_a_scan_whose_bearings_are_given_one_by_one_makes_no_message():
    with pytest.raises(ScanError, match='one by one'):
        scan_to_message(Scan.from_points([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))


def test_odometry_and_transform_hold_the_state():
    odometry = odometry_message(state())
    transform = filled(TransformStamped(), transform_fields(state(), 'odom', 'base'))
    assert in_nanoseconds(odometry.header.stamp) == STAMP
    assert odometry.header == transform.header
    assert (odometry.child_frame_id, transform.child_frame_id) == ('base', 'base')
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (1.0, -2.0)
    assert (transform.transform.translation.x, transform.transform.translation.y) == (1.0, -2.0)
    assert odometry.pose.pose.orientation == transform.transform.rotation
    assert 2.0 * math.atan2(transform.transform.rotation.z, transform.transform.rotation.w) == pytest.approx(0.5)
    twist = odometry.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (0.3, -0.1, 0.2)


def published(prepared, base, numbers):
    """Return the serialised message that a prepared one publishes."""
    sent = []
    prepared.publish(SimpleNamespace(publish=sent.append), base.stamp, numbers)
    return sent[0]


def test_a_prepared_odometry_has_the_fields_of_the_state():
    base = state(covariance=np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.25], [0.5, 0.25, 2.0]]))
    prepared = PreparedMessage(filled(Odometry(), {'header': {'frame_id': 'odom'}, 'child_frame_id': 'base'}),
                               ODOM_NUMBERS)
    wire = published(prepared, base, odometry_numbers(base))
    assert rclpy.serialization.deserialize_message(wire, Odometry) == odometry_message(base)


def test_a_prepared_transform_has_the_fields_of_the_state():
    tf2_msgs = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')
    given, base = {'header': {'frame_id': 'odom'}, 'child_frame_id': 'base'}, state()
    prepared = PreparedMessage(tf2_msgs.TFMessage(transforms=[filled(TransformStamped(), given)]),
                               transform_sender.NUMBERS, transform_sender.COUNT)
    expected = tf2_msgs.TFMessage(transforms=[filled(TransformStamped(), transform_fields(base, 'odom', 'base'))])
    wire = published(prepared, base, transform_numbers(base.pose))
    assert rclpy.serialization.deserialize_message(wire, tf2_msgs.TFMessage) == expected


def test_covariances_are_never_zero_and_large_where_nothing_is_known():
    message = odometry_message(state(covariance=np.zeros((3, 3))))
    for covariance in (message.pose.covariance, message.twist.covariance):
        matrix = covariance.reshape(6, 6)
        assert np.diag(matrix) == pytest.approx([1e-9, 1e-9, 1e6, 1e6, 1e6, 1e-9])
        assert np.count_nonzero(matrix) == 6


def test_planar_covariances_stand_in_the_rows_of_x_y_and_yaw():
    planar = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.25], [0.5, 0.25, 2.0]])
    matrix = odometry_message(state(covariance=planar)).pose.covariance.reshape(6, 6)
    assert matrix[np.ix_([0, 1, 5], [0, 1, 5])] == pytest.approx(planar)


def update(pose, twist=(0.0, 0.0, 0.0), covariance=None, twist_covariance=None):
    zero = np.zeros((3, 3))
    return OdometryUpdate(STAMP, pose, zero if covariance is None else covariance, np.array(twist),
                          zero if twist_covariance is None else twist_covariance, 0.1, SE2(), Status.OK, None, None,
                          None, SE2(), False)


def test_a_base_that_turns_on_the_spot_stays_where_it_is():
    laser = SE2(0.3, 0.1, 2.0)
    turn = laser.inverse() @ SE2(0.0, 0.0, 1.2) @ laser
    velocity = laser.inverse().adjoint() @ [0.0, 0.0, 0.7]
    result = base_state(update(turn, velocity), laser, laser)
    assert result.pose.as_array() == pytest.approx([0.0, 0.0, 1.2])
    assert result.twist == pytest.approx([0.0, 0.0, 0.7])


def test_covariances_are_those_of_many_poses_moved_one_by_one():
    rng = np.random.default_rng(5)
    origin, laser, pose = SE2(0.4, -0.2, 1.1), SE2(-0.3, 0.6, -2.0), SE2(3.0, 1.0, 0.8)
    root = np.array([[2e-3, 0.0, 0.0], [1e-3, 1e-3, 0.0], [5e-4, -3e-4, 1e-3]])
    errors = rng.normal(size=(5_000, 3)) @ root.T
    result = base_state(update(pose, covariance=root @ root.T, twist_covariance=root @ root.T), origin, laser)
    moved = [(origin @ SE2(*(pose.as_array() + e)) @ laser.inverse()).as_array() for e in errors]
    assert np.cov(moved, rowvar=False) == pytest.approx(result.covariance, abs=6e-7)
    twists = [base_state(update(pose, e), origin, laser).twist for e in errors]
    assert np.cov(twists, rowvar=False) == pytest.approx(result.twist_covariance, abs=6e-7)


def given(covariance, frame='odom'):
    message = PoseWithCovarianceStamped()
    message.header.frame_id, message.pose.covariance = frame, np.ravel(covariance)
    return message


def test_a_pose_that_is_set_may_be_known_exactly_along_a_direction():
    """Rounding makes an eigenvalue of zero negative, by the size of the others."""
    spread = np.array([300.0, 700.0, 0.0, 0.0, 0.0, 1.0])
    found = initial_pose(given(np.outer(spread, spread) - 1e-9 * np.eye(6)), 'odom')
    assert found.covariance == pytest.approx(np.outer(spread, spread)[np.ix_([0, 1, 5], [0, 1, 5])], abs=1e-6)
    for wrong in (given(np.diag([1.0, -1.0, 0.0, 0.0, 0.0, 1.0])), given(np.full((6, 6), math.nan)),
                  given(np.eye(6), 'map')):
        with pytest.raises(PoseError):
            initial_pose(wrong, 'odom')


def quaternion(roll=0.0, pitch=0.0, yaw=0.0):
    """A Transform with that rotation (about the fixed x, y and z axes in this order) and a position."""
    cr, sr, cp, sp, cy, sy = (f(a / 2.0) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    message = Transform()
    message.translation.x, message.translation.y, message.translation.z = 0.2, -0.1, 1.5
    message.rotation.w = cr * cp * cy + sr * sp * sy
    message.rotation.x = sr * cp * cy - cr * sp * sy
    message.rotation.y = cr * sp * cy + sr * cp * sy
    message.rotation.z = cr * cp * sy - sr * sp * cy
    return message


@pytest.mark.parametrize('yaw', [-3.0, 0.5, 3.1])
@pytest.mark.parametrize('roll', [0.1, math.pi, math.pi - 0.1])
def test_a_transform_says_where_the_laser_sits_and_which_way_up(yaw, roll):
    mounting = Mounting.from_matrix(matrix_of(*pose_of_transform(quaternion(roll=roll, yaw=yaw))))
    assert mounting.upside_down == (roll > 1.0)
    assert mounting.pose.as_array() == pytest.approx([0.2, -0.1, yaw])


@pytest.mark.parametrize('tilt', [0.5, math.pi / 2.0, 2.5])
def test_a_tilted_laser_is_refused(tilt):
    with pytest.raises(MountingError, match=f'tilted by {math.degrees(tilt):.0f} deg'):
        Mounting.from_matrix(matrix_of(*pose_of_transform(quaternion(roll=tilt))))


@pytest.mark.parametrize('change', [{'w': 0.0}, {'w': math.nan}, {'w': 2.0}])
def test_a_transform_without_a_rotation_is_refused(change):
    message = Transform()
    message.rotation.w = change['w']
    with pytest.raises(PoseError, match='expected one of length 1'):
        pose_of_transform(message)
