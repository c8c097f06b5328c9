# SPDX-License-Identifier: Apache-2.0
"""What is wrong with told motions time and again."""
import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.wheel_calibration import WheelCalibration
from dbscan_reg_ros.core.registration.records import Prior

SPREAD = np.array((0.02, 0.02, 0.03))
WRONG = np.array(((-0.04, 0.0, 0.0), (0.0, 0.0, 0.09), (0.05, 0.0, -0.05)))
"""Wheels 4 % smaller than they are thought to be, unequal, and a sensor mounted 9 cm from where it is said to be."""


def told(*motion):
    return Prior(SE2(*motion), np.diag(SPREAD) ** 2)


def taught(steps, wrong=WRONG, noise=0.0, weights=1.0, memory=300.0, error=None, seed=0):
    """`WheelCalibration` after so many random steps that were `wrong`."""
    error, rng = error or WheelCalibration(), np.random.default_rng(seed)
    for _ in range(steps):
        step = told(*rng.normal(0.0, (0.1, 0.01, 0.1)))
        off = wrong @ step.transform.as_array() + noise * rng.normal(0.0, 1.0, 3)
        error.learn(step, step.transform @ SE2.from_array(off), weights, memory)
    return error


def off(error, *motion, wrong=WRONG):
    """What a corrected motion is off by."""
    step = told(*motion)
    true = step.transform @ SE2.from_array(wrong @ step.transform.as_array())
    return (error.corrected(step).transform.inverse() @ true).as_array()


def share(error):
    """Standard deviations after, as shares of those before."""
    return np.sqrt(error.tightened(told(0.1, 0.0, 0.1)).covariance.diagonal()) / SPREAD


def test_who_was_never_wrong_is_taken_at_their_word():
    step = told(0.1, 0.02, -0.3)
    for error in (WheelCalibration(), taught(5, wrong=np.zeros((3, 3)))):
        assert error.corrected(step).transform.as_array() == pytest.approx(step.transform.as_array(), abs=1e-12)
        assert (error.corrected(step).covariance == step.covariance).all()


@pytest.mark.parametrize('noise', [0.0, 0.005])
def test_scale_curve_and_mounting_are_learned(noise):
    error = taught(400, noise=noise)
    assert np.abs(off(error, 1.0, 0.0, 0.0)).max() < 0.01
    assert np.abs(off(error, 0.0, 0.0, 1.0)).max() < 0.01
    assert np.abs(off(WheelCalibration(), 0.0, 0.0, 1.0)).max() > 0.08


def test_what_counts_for_nothing_teaches_nothing():
    step = told(0.1, 0.0, 0.1)
    assert taught(50, weights=0.0).corrected(step).transform.as_array() == pytest.approx(step.transform.as_array(), abs=1e-12)
    assert share(taught(50, weights=0.0)) == pytest.approx(1.0)


def test_what_counts_for_less_is_learned_more_slowly():
    little, much = (np.abs(off(taught(3, weights=weights), 0.1, 0.0, 0.1)).max() for weights in (0.1, 1.0))
    assert much < little < np.abs(off(WheelCalibration(), 0.1, 0.0, 0.1)).max()


def test_a_load_put_down_is_noticed_within_the_memory():
    short, long = (taught(900, wrong=-WRONG, memory=memory, error=taught(900, memory=memory)) for memory in (30.0, 1e6))
    assert np.abs(off(short, 1.0, 0.0, 0.0, wrong=-WRONG)).max() < 0.01
    assert np.abs(off(long, 1.0, 0.0, 0.0, wrong=-WRONG)).max() > 0.03


def test_no_more_than_a_fifth_is_taken_to_be_wrong():
    error = taught(400, wrong=np.diag((-0.5, -0.5, 0.5)))
    assert error.corrected(told(1.0, 0.0, 0.0)).transform.x == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize(('noise', 'expected'), [(0.0, 0.15), (0.005, 0.25), (0.1, 1.0)])
def test_a_told_motion_is_as_sure_as_those_before_have_been(noise, expected):
    """No surer than a limit, however right they were, and no less sure than it was told."""
    assert share(WheelCalibration()) == pytest.approx(1.0)
    assert share(taught(1500, noise=noise))[:2] == pytest.approx(expected, rel=0.2)


def test_standing_still_proves_nobody_right():
    error = WheelCalibration()
    for _ in range(1000):
        error.learn(told(0.0, 0.0, 0.0), SE2(), 1.0, 300.0)
    assert share(error) == pytest.approx(1.0)
