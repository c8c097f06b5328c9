# SPDX-License-Identifier: Apache-2.0
"""Message by message, as the node does, without DDS: the trajectory and the twist of the base for any lidar on it."""
import array
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock
from ros_helpers import changed, distances, inverted, of_base, pose_of
from scipy.linalg import expm

from dbscan_reg_ros import SE2, Odometry, Scan
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.node.interfaces.messages import filled, scan_to_message, stamp_to_message
from dbscan_reg_ros.node.interfaces.scan_reader import ScanReader
from dbscan_reg_ros.recordings.message_fields import odometry_fields
from dbscan_reg_ros.robot.base_state import BaseState, base_state, predicted_state
from dbscan_reg_ros.robot.parameter_groups import InputParameters
from dbscan_reg_ros.robot.parameters import NodeParameters
from dbscan_reg_ros.simulation import Lidar, follow, measure, rooms, simulate

START = 1_700_000_000 * 10**9
AHEAD = SE2(0.3, -0.1, 0.0)


def answers(messages, mounting=Mounting()):
    """The odometry messages that answer those of a lidar."""
    reader, odometry, parameters = ScanReader(Clock(), SimpleNamespace(warn=print)), Odometry(), NodeParameters().input
    source, at = SimpleNamespace(find=lambda *_: mounting), mounting.aligned_pose
    found = []
    for message in messages:
        message = scan_to_message(message) if isinstance(message, Scan) else message
        scan, _ = reader.read(message, source, parameters)
        state = base_state(odometry.process(scan), at, at)
        found.append(filled(OdometryMessage(), odometry_fields(state, 'odom', 'base_link')))
    return found


def planar(stamped):
    return np.reshape(stamped.covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]


def twists(messages):
    return np.array([(t.linear.x, t.linear.y, t.angular.z) for t in (m.twist.twist for m in messages)])


def test_covariances_are_never_zero_and_grow_with_the_path(scans, truth):
    found = answers(scans)
    assert distances(found, truth).max() < 0.05
    for message in found:
        for stamped in (message.pose, message.twist):
            assert np.linalg.eigvalsh(planar(stamped))[0] > 0.0
            assert (np.diag(np.reshape(stamped.covariance, (6, 6)))[2:5] == 1e6).all()
    traces = [np.trace(planar(message.pose)[:2, :2]) for message in found]
    assert traces[-1] > traces[1]


@pytest.mark.parametrize('laser', [SE2(0.3, 0.0, math.pi / 2.0), SE2(0.0, 0.0, -math.pi / 2.0)])
def test_the_twist_is_in_the_frame_of_the_base(scans, truth, laser):
    """The laser may look sideways and sit ahead: its own velocity is quite another."""
    expected = [(a.inverse() @ b).as_array() / 0.1 for a, b in itertools.pairwise(of_base(truth, laser))]
    off = twists(answers(scans, Mounting(laser)))[1:] - expected
    assert np.abs(off).max() < 0.5 and (np.abs(off).mean(axis=0) < 0.12).all()
    assert np.linalg.norm(expected, axis=1).max() > 0.5


def spoilt(scans):
    """Beams of NaN, infinity and other ranges that none can have."""
    rng = np.random.default_rng(2)
    for scan in scans:
        ranges = scan.ranges.copy()
        for value in (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e9):
            ranges[rng.choice(len(ranges), 20, replace=False)] = value
        yield Scan(scan.stamp, ranges, scan.geometry, 0.0, 'laser')


def cut(scans):
    """Another number of beams in each scan."""
    rng = np.random.default_rng(3)
    return (changed(scan, beams=int(rng.integers(330, 361))) for scan in scans)


def clockwise(scans):
    """The same beams counted the other way round, as a clockwise lidar does."""
    for scan in scans:
        message = scan_to_message(scan)
        message.angle_min, message.angle_max = message.angle_max, message.angle_min
        message.angle_increment = -message.angle_increment
        message.ranges = array.array('f', message.ranges[::-1])
        yield message


def backwards(scans):
    """As of a lidar that is turned by 180 deg."""
    for scan in scans:
        message = scan_to_message(scan)
        message.angle_min, message.angle_max = message.angle_min + math.pi, message.angle_max + math.pi
        yield message


@pytest.mark.parametrize(('sent', 'laser', 'upside_down'), [
    (spoilt, SE2(), False), (cut, SE2(), False), (clockwise, SE2(), False),
    (backwards, SE2(AHEAD.x, AHEAD.y, math.pi), False), (inverted, SE2(AHEAD.x, AHEAD.y, math.pi), True)])
def test_the_trajectory_of_the_base_is_the_same_for_other_beams_and_mountings(scans, truth, sent, laser, upside_down):
    found = answers(sent(scans[:40]), Mounting(laser, upside_down))
    assert distances(found, of_base(truth[:40], SE2(laser.x, laser.y))).max() < 0.06
    assert all(np.isfinite(m.pose.covariance).all() and np.isfinite(m.twist.covariance).all() for m in found)


@pytest.mark.parametrize('mounting', [Mounting(), Mounting(SE2(0.1, 0.0, 2.0), upside_down=True)])
def test_the_robots_own_body_is_masked(scans, mounting):
    """A post 0.4 m away hides one sector; another one across the seam sees farther than the range of the mask."""
    given = InputParameters(mask=(0.5, 1.5, 3.0, -3.0, 0.0, 0.0, 0.0, 0.0), mask_range=0.6)
    bearings = scans[0].geometry.bearings
    post = (bearings > 0.5) & (bearings < 1.5)
    message = changed(scans[0], ranges=array.array('f', np.where(post, 0.4, scans[0].ranges)))
    reader = ScanReader(Clock(), SimpleNamespace(warn=print))
    scan, _ = reader.read(message, SimpleNamespace(find=lambda *_: mounting), given)
    assert np.isnan(scan.ranges[post]).all()
    np.testing.assert_array_equal(scan.ranges[~post], scans[0].ranges[~post])


def test_a_driver_that_drops_most_of_its_scans_is_followed(scans, truth):
    kept = [k for k in range(80) if k % 5 in (0, 3)]
    assert distances(answers([scans[k] for k in kept]), [truth[k] for k in kept]).max() < 0.08


def test_a_field_of_view_to_one_side_does_not_matter():
    """A lidar of 240 deg that begins straight ahead; it is mounted so that it looks all round but to the right."""
    world, laser = rooms(seed=1), SE2(0.1, 0.0, -0.5)
    lidar = Lidar(beams=240, angle_min=0.0, mounting=laser)
    drive = simulate(world, follow(world.tour[:3], speed=1.0), lidar, seed=2)
    start = (SE2.from_array(drive.truth[0]) @ laser.inverse()).inverse()
    bases = [start @ SE2.from_array(pose) @ laser.inverse() for pose in drive.truth[:60]]
    assert distances(answers(drive.scans[:60], Mounting(laser)), bases).max() < 0.08


@pytest.mark.parametrize('beams', [180, 720])
def test_a_robot_at_rest_does_not_drift(drive, beams):
    rng = np.random.default_rng(3)
    lidar = Lidar(beams=beams, angle_min=-0.75 * math.pi, angle_increment=1.5 * math.pi / beams, noise=0.02)
    place = drive.path.poses_at(np.array([2.0]))
    last = answers(measure(drive.world, place, lidar, rng, START + 40_000_000 * k) for k in range(100))[-1]
    assert math.hypot(pose_of(last).x, pose_of(last).y) < 0.01 and abs(pose_of(last).theta) < 0.003


def test_jitter_of_the_stamps_makes_no_spikes_in_the_twist(scans):
    rng = np.random.default_rng(4)
    messages = [scan_to_message(scan) for scan in scans[:60]]
    for k in range(20, 60, 10):
        messages[k].header.stamp = stamp_to_message(scans[k - 1].stamp + int(rng.integers(-50_000_000, 2_000_000)))
    speeds = np.hypot(*twists(answers(messages))[:, :2].T)
    assert np.isfinite(speeds).all() and speeds.max() < 3.0


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_the_state_between_scans_is_that_of_a_constant_twist(seed):
    rng = np.random.default_rng(seed)
    twist, pose = rng.uniform(-2.0, 2.0, 3), SE2.from_array(rng.uniform(-2.0, 2.0, 3))
    known = BaseState(START, pose, 0.01 * np.eye(3), twist, np.diag((0.01, 0.02, 0.03)))
    later = predicted_state(known, START + 400_000_000, NodeParameters())
    generator = np.array([[0.0, -twist[2], twist[0]], [twist[2], 0.0, twist[1]], [0.0, 0.0, 0.0]])
    assert later.pose.as_matrix() == pytest.approx(pose.as_matrix() @ expm(0.4 * generator))
    variances = [np.trace(predicted_state(known, START + time, NodeParameters()).covariance)
                 for time in (1_000_000, 100_000_000, 400_000_000)]
    assert np.trace(known.covariance) < variances[0] < variances[1] < variances[2]
    assert later.twist_covariance[0, 0] > 0.01
