# SPDX-License-Identifier: Apache-2.0
"""Predictions of a scan by the motion model and by external priors."""
import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.motion import MotionConstraints
from dbscan_reg_ros.core.odometry.models.stamps import ScanInterval
from dbscan_reg_ros.core.odometry.prediction import predict
from dbscan_reg_ros.core.odometry.state import Tracking, TrackState
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Prior

P = Parameters()
TICK = ScanInterval(0.1, 0.1, 0.0, steady=True)
STEP = SE2(0.05, 0.0, 0.02)
WHEELS = Prior(SE2(0.06, 0.0, 0.01), np.diag((0.02, 0.02, 0.03)) ** 2)


@pytest.fixture
def state():
    """After a second at a constant velocity."""
    state = TrackState.initial(SE2(1.0, 2.0, 0.5), number=0)
    for _ in range(10):
        state.motion.elapse(TICK.length)
        state.pose = state.motion.update(state.pose @ STEP, TICK, MotionConstraints(), P)
    return state


def test_without_a_prior_the_motion_model_predicts(state):
    found = predict(state, None, TICK, P)
    assert found.best is found.motion and found.by_motion_model and found.external is None
    assert found.best.pose.as_array() == pytest.approx((state.pose @ STEP).as_array())
    np.testing.assert_array_equal(found.best.gate_covariance, found.best.prior.covariance)
    assert found.interval is TICK


def test_an_external_prior_predicts_beside_the_motion_model(state):
    found = predict(state, WHEELS, TICK, P)
    assert found.external is WHEELS and not found.by_motion_model
    assert found.best.pose.as_array() == pytest.approx((state.pose @ WHEELS.transform).as_array())
    assert found.motion.pose.as_array() == pytest.approx((state.pose @ STEP).as_array())
    np.testing.assert_array_equal(found.best.gate_covariance, WHEELS.covariance)


def test_a_gyroscope_changes_the_rotation_and_is_no_external_motion(state):
    by_motion = state.motion.predict(TICK, P)
    found = predict(state, by_motion.with_rotation(0.1, 0.001), TICK, P)
    assert found.external is None and not found.by_motion_model
    assert found.best.prior.transform.theta == pytest.approx(0.1)
    assert found.motion.prior.transform.theta == pytest.approx(0.02)


@pytest.mark.parametrize('parameters', [P, P.replace({'prior.source': 'none'})])
def test_a_gyroscope_measures_no_translation_where_the_velocity_is_unknown(state, parameters):
    """After a correction of the pose and without a motion model, the predicted translation is 0."""
    state.motion.forget_position()
    state.motion.update(state.pose, TICK, MotionConstraints(), P)
    by_motion = state.motion.predict(TICK, parameters)
    assert by_motion.transform == SE2() and by_motion.velocity_change is None
    found = predict(state, by_motion.with_rotation(0.1, 0.001), TICK, parameters)
    assert found.external is None and not found.by_motion_model
    assert found.best.prior.transform.as_tuple() == pytest.approx((0.0, 0.0, 0.1))


def test_after_scans_that_were_not_found_the_gate_is_wider_than_the_prior(state):
    state.tracking = Tracking(lost_time=0.5)
    found = predict(state, None, TICK, P)
    added = found.best.gate_covariance - found.best.prior.covariance
    assert np.sqrt(added[0, 0]) == pytest.approx(0.5 * P.prior.acceleration * 0.5 ** 2)
    wheels = predict(state, WHEELS, TICK, P)
    np.testing.assert_array_equal(wheels.best.gate_covariance, WHEELS.covariance)
