# SPDX-License-Identifier: Apache-2.0
"""Simulated wheel odometry and gyroscope: noise at every step, scale, bias and slip."""
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.geometry.se2 import wrap
from .paths import Path
from .simulate import START


@dataclass(frozen=True)
class WheelErrors:
    """Errors of wheel odometry."""

    scale: tuple[float, float] = (1.02, 0.98)
    """Ratio of measured to true distance and rotation."""
    noise: tuple[float, float] = (0.02, 0.02)
    """Standard deviation of the error of each step, as a fraction of its distance and of its rotation; the second value
    is also the standard deviation of the rotation error per distance [rad/m]."""
    slips: Sequence[tuple[float, float, float]] = ()
    """From `begin` to `end` [s] the wheels measure `factor` times the true distance."""


USUAL_ERRORS = WheelErrors()


def wheel_odometry(path: Path, errors: WheelErrors = USUAL_ERRORS, *, rate: float = 20.0, seed: int = 0,
                   start: int = START) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the poses of the robot according to its wheel odometry.

    Parameters
    ----------
    path : Path
    errors : WheelErrors
    rate : float [Hz]
    seed : int
    start : int [ns]
        Stamp at the start of the path.

    Returns
    -------
    stamps : (N,) int64 [ns]
    poses : (N, 3) float
        x, y [m], theta [rad] in the frame of the first pose.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, path.duration, 1.0 / rate)
    poses = path.poses_at(times)
    steps = np.diff(poses, axis=0)
    turns = wrap(steps[:, 2])
    distances = steps[:, 0] * np.cos(poses[:-1, 2]) + steps[:, 1] * np.sin(poses[:-1, 2])
    for begin, end, factor in errors.slips:
        distances[(times[:-1] >= begin) & (times[:-1] < end)] *= factor
    turns = turns * (errors.scale[1] + errors.noise[1] * rng.normal(size=len(turns))) \
        + errors.noise[1] * distances * rng.normal(size=len(turns))
    distances = distances * (errors.scale[0] + errors.noise[0] * rng.normal(size=len(distances)))
    headings = np.concatenate(([0.0], np.cumsum(turns)))
    middle = headings[:-1] + 0.5 * turns
    positions = np.cumsum(distances[:, None] * np.stack((np.cos(middle), np.sin(middle)), axis=1), axis=0)
    measured = np.column_stack((np.concatenate((np.zeros((1, 2)), positions)), wrap(headings)))
    return start + np.round(times * 1e9).astype(np.int64), measured


def yaw_rates(path: Path, *, rate: float = 100.0, seed: int = 0, bias: float = 0.002, noise: float = 0.005,
              start: int = START) -> tuple[np.ndarray, np.ndarray]:
    """Simulate a gyroscope: return stamps (N,) int64 [ns] and yaw rates (N,) [rad/s]; `bias` and `noise` in [rad/s]."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, path.duration, 1.0 / rate)
    turned = np.interp(times + 0.5 / rate, path.times, path.poses[:, 2]) \
        - np.interp(times - 0.5 / rate, path.times, path.poses[:, 2])
    rates = turned * rate + bias + noise * rng.normal(size=len(times))
    return start + np.round(times * 1e9).astype(np.int64), rates
