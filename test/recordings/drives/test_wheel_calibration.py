# SPDX-License-Identifier: Apache-2.0
"""Online calibration of systematic wheel-odometry errors."""
import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.wheel_calibration import WheelCalibration
from dbscan_reg_ros.core.registration.records import Prior

SPREAD = np.array((0.02, 0.02, 0.03))
WRONG = np.array(((-0.04, 0.0, 0.0), (0.0, 0.0, 0.09), (0.05, 0.0, -0.05)))
"""Wheels 4 % smaller than stated, unequal, and a sensor 9 cm from its stated mounting."""


def wheel_prior(*motion):
    return Prior(SE2(*motion), np.diag(SPREAD) ** 2)


def calibrated_by(steps, wrong=WRONG, noise=0.0, weights=1.0, memory=300.0, error=None):
    """`WheelCalibration` after `steps` random steps that were `wrong`."""
    error, rng = error or WheelCalibration(), np.random.default_rng(0)
    for _ in range(steps):
        step = wheel_prior(*rng.normal(0.0, (0.1, 0.01, 0.1)))
        off = wrong @ step.transform.as_array() + noise * rng.normal(0.0, 1.0, 3)
        error.learn(step, step.transform @ SE2.from_array(off), weights, memory)
    return error


def off(error, *motion, wrong=WRONG):
    """What a corrected motion is off by."""
    step = wheel_prior(*motion)
    true = step.transform @ SE2.from_array(wrong @ step.transform.as_array())
    return (error.corrected(step).transform.inverse() @ true).as_array()


def sigma_ratio(error):
    """Ratios of the standard deviations after to those before."""
    return np.sqrt(error.tightened(wheel_prior(0.1, 0.0, 0.1)).covariance.diagonal()) / SPREAD


def test_exact_wheels_are_not_corrected():
    step = wheel_prior(0.1, 0.02, -0.3)
    for error in (WheelCalibration(), calibrated_by(5, wrong=np.zeros((3, 3)))):
        assert error.corrected(step).transform.as_array() == pytest.approx(step.transform.as_array(), abs=1e-12)
        assert (error.corrected(step).covariance == step.covariance).all()


@pytest.mark.parametrize('noise', [0.0, 0.005])
def test_scale_curve_and_mounting_are_learned(noise):
    error = calibrated_by(400, noise=noise)
    assert np.abs(off(error, 1.0, 0.0, 0.0)).max() < 0.01
    assert np.abs(off(error, 0.0, 0.0, 1.0)).max() < 0.01
    assert np.abs(off(WheelCalibration(), 0.0, 0.0, 1.0)).max() > 0.08


def test_motions_without_weight_are_not_learned():
    step = wheel_prior(0.1, 0.0, 0.1)
    assert calibrated_by(50,
                         weights=0.0).corrected(step).transform.as_array() == pytest.approx(step.transform.as_array(),
                                                                                            abs=1e-12)
    assert sigma_ratio(calibrated_by(50, weights=0.0)) == pytest.approx(1.0)


def test_a_load_put_down_is_noticed_within_the_memory():
    short, long = (calibrated_by(900, wrong=-WRONG, memory=memory, error=calibrated_by(900, memory=memory))
                   for memory in (30.0, 1e6))
    assert np.abs(off(short, 1.0, 0.0, 0.0, wrong=-WRONG)).max() < 0.01
    assert np.abs(off(long, 1.0, 0.0, 0.0, wrong=-WRONG)).max() > 0.03


def test_the_correction_is_at_most_a_fifth():
    error = calibrated_by(400, wrong=np.diag((-0.5, -0.5, 0.5)))
    assert error.corrected(wheel_prior(1.0, 0.0, 0.0)).transform.x == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize(('noise', 'expected'), [(0.0, 0.15), (0.005, 0.25), (0.1, 1.0)])
def test_the_covariance_of_a_prior_is_tightened_to_the_errors_so_far(noise, expected):
    """With a lower limit, however exact the wheels were, and no more than the prior states."""
    assert sigma_ratio(WheelCalibration()) == pytest.approx(1.0)
    assert sigma_ratio(calibrated_by(1500, noise=noise))[:2] == pytest.approx(expected, rel=0.2)
