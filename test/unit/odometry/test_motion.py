# SPDX-License-Identifier: Apache-2.0
"""Constant-velocity motion model, from poses alone."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.motion import ConstantVelocityModel, MotionConstraints
from dbscan_reg_ros.core.odometry.models.stamps import Jump, ScanInterval
from dbscan_reg_ros.core.odometry.models.unobserved_motion import unknown_motion_covariance
from dbscan_reg_ros.core.parameters.registration import SEARCH_DISTANCE
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Prior

P = Parameters()
TICK = ScanInterval(length=0.1, elapsed=0.1, middle_offset=0.02, steady=True)
STEP = SE2(0.05, 0.01, 0.03)


def drive(motion, pose, steps, step=STEP, free=None, share=1.0):
    """The last pose after some steps, each of them found."""
    for _ in range(steps):
        motion.elapse(TICK.length)
        pose = motion.update(pose @ step, TICK, MotionConstraints(free, share), P)
    return pose


def test_a_constant_velocity_is_predicted():
    motion = ConstantVelocityModel(SE2())
    assert not motion.has_velocity
    drive(motion, SE2(), 30)
    assert motion.has_velocity
    expected = motion.predict(TICK, P).transform.as_array()
    assert expected == pytest.approx(STEP.as_array(), abs=1e-4)


def test_after_a_gap_the_motion_is_unknown():
    motion, gap = ConstantVelocityModel(SE2()), ScanInterval(0.1, 1.5, 0.02, steady=True)
    drive(motion, SE2(), 30)
    prior = motion.predict(gap, P)
    assert prior.velocity_change is None
    np.testing.assert_array_equal(prior.covariance, unknown_motion_covariance(gap, P))


def test_in_a_long_gap_the_velocity_decays_and_its_variance_grows():
    """Against a simulated Ornstein-Uhlenbeck process: 0.5 m/s at first, a standard deviation of 0.5 m/s at last."""
    motion, rng, step = ConstantVelocityModel(SE2()), np.random.default_rng(0), 0.02
    drive(motion, SE2(), 30, SE2(0.05))
    for time in (3.0, 12.0):
        velocity, way = np.tile((0.5, 0.0), (4000, 1)), np.zeros((4000, 2))
        for _ in range(round(time / step)):
            velocity += -step / 5.0 * velocity + 0.5 * math.sqrt(2.0 * step / 5.0) * rng.normal(size=velocity.shape)
            way += step * velocity
        prior = motion.predict(ScanInterval(0.1, time, 0.02, Jump.FORWARD, 'no scan', missing=True), P)
        assert prior.transform.as_array() == pytest.approx([*way.mean(axis=0), 0.0], abs=0.15)
        variance = way.var(axis=0) + P.prior.unknown_sigma ** 2
        assert prior.covariance.diagonal() == pytest.approx([*variance, 1.0], rel=0.06)


def test_along_a_degenerate_direction_the_speed_is_kept():
    motion = ConstantVelocityModel(SE2())
    pose = drive(motion, SE2(), 30, SE2(0.05))
    drive(motion, pose, 1, SE2(0.09, 0.02), free=0.0, share=0.0)
    assert motion.twist == pytest.approx([0.5, 0.2, 0.0], abs=1e-9)


def test_once_the_direction_is_observable_the_speed_follows_from_the_distance():
    motion = ConstantVelocityModel(SE2())
    pose = drive(motion, SE2(), 30, SE2(0.05))
    pose = drive(motion, pose, 9, SE2(0.05), free=0.0, share=0.0)
    drive(motion, pose, 1, SE2(0.25))
    # 0.70 m in a second, not 0.05 m ten times: 0.2 m/s faster, and a speed that wanders has changed by half as much
    # again.
    assert motion.twist[0] == pytest.approx(0.5 + 1.5 * 0.2, abs=1e-9)


def test_the_sigma_along_a_degenerate_direction_grows_with_time():
    motion = ConstantVelocityModel(SE2())
    drive(motion, SE2(), 5, free=0.5 * math.pi, share=0.0)
    here = motion.predict(TICK, P)
    reach = motion.gate_covariance(here, SE2(), 0.0, P) - here.covariance
    assert reach[1, 1] == pytest.approx((0.5 * P.prior.acceleration * 0.5 ** 2) ** 2)
    assert abs(reach[0]).max() < 1e-12
    motion.elapse(1000.0)
    assert motion.gate_covariance(here, SE2(), 0.0,
                                  P)[1, 1] - here.covariance[1, 1] == pytest.approx(SEARCH_DISTANCE ** 2)


def test_while_lost_the_sigma_grows_in_every_direction():
    motion = ConstantVelocityModel(SE2())
    drive(motion, SE2(), 5)
    here = motion.predict(TICK, P)
    np.testing.assert_array_equal(motion.gate_covariance(here, SE2(), 0.0, P), here.covariance)
    farther = motion.gate_covariance(here, SE2(), 0.5, P) - here.covariance
    way, turn = (0.5 * each * 0.5 ** 2 for each in (P.prior.acceleration, P.prior.angular_acceleration))
    np.testing.assert_allclose(farther, np.diag((way, way, turn)) ** 2, atol=1e-12)
    most = motion.gate_covariance(here, SE2(), P.time.max_jump, P)
    np.testing.assert_array_equal(motion.gate_covariance(here, SE2(), 1000.0, P), most)
    external = Prior(SE2(), here.covariance)
    np.testing.assert_array_equal(motion.gate_covariance(external, SE2(), 1000.0, P), external.covariance)


def test_the_velocity_is_clipped_to_the_limits():
    motion = ConstantVelocityModel(SE2())
    drive(motion, SE2(), 1, SE2(3.0, 4.0, 1.0))
    speed, turn_rate = P.odometry.max_speed, P.odometry.max_turn_rate
    np.testing.assert_allclose(motion.twist, (0.6 * speed, 0.8 * speed, turn_rate))


def test_the_distance_from_an_unknown_position_gives_no_velocity():
    motion = ConstantVelocityModel(SE2())
    pose = drive(motion, SE2(), 30)
    motion.forget_position()
    assert motion.position_unknown
    drive(motion, pose, 1, SE2(1.0))
    assert not motion.position_unknown
    assert not motion.twist.any()
    np.testing.assert_array_equal(motion.predict(TICK, P).covariance, unknown_motion_covariance(TICK, P))


@pytest.mark.parametrize('before, speed', [(0.3, 2.0), (0.1, 0.8)])
def test_where_the_last_scan_of_a_sensor_is_old_that_of_another_counts_unless_it_is_new(before, speed):
    """The last scan of the same sensor is 0.6 s old, that of the other 0.3 or 0.1 s: then the velocity is kept."""
    motion = ConstantVelocityModel(SE2(), 'own')
    for sensor, length, distance in (('other', 0.6 - before, 0.6 - 2.0 * before), ('own', before, 0.6)):
        motion.elapse(length)
        motion.update(SE2(distance), ScanInterval(length, length, 0.0, of_others=True), MotionConstraints(), P, sensor)
    np.testing.assert_allclose(motion.twist, (speed, 0.0, 0.0), atol=1e-12)
