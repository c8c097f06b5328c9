# SPDX-License-Identifier: Apache-2.0
"""What wheels and a gyroscope say of a path: small errors at every step, scale, bias and slip."""
import numpy as np

from ..core.geometry.se2 import wrap
from .simulate import START


def wheel_odometry(path, rate=20.0, seed=0, scale=(1.02, 0.98), noise=(0.02, 0.02), slips=(), start=START):
    """Poses of the robot by its wheels.

    Parameters
    ----------
    path : Path
    rate : float [Hz]
    seed : int
    scale : (float, float)
        Measured over true, of distance and of turning.
    noise : (float, float)
        Standard deviation of the errors that every step adds, as a share of its distance and of its turn, and as much
        again of turn for distance [rad/m].
    slips : sequence of (begin, end, factor)
        Between these times [s] the wheels turn `factor` times as far as the robot drives.
    start : int [ns]

    Returns
    -------
    stamps : (N,) int64 [ns]
    poses : (N, 3) float
        x, y [m], theta [rad] in the frame of the first.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, path.duration, 1.0 / rate)
    poses = path.poses_at(times)
    steps = np.diff(poses, axis=0)
    turns = wrap(steps[:, 2])
    distances = steps[:, 0] * np.cos(poses[:-1, 2]) + steps[:, 1] * np.sin(poses[:-1, 2])
    for begin, end, factor in slips:
        distances[(times[:-1] >= begin) & (times[:-1] < end)] *= factor
    turns = turns * (scale[1] + noise[1] * rng.normal(size=len(turns))) \
        + noise[1] * distances * rng.normal(size=len(turns))
    distances = distances * (scale[0] + noise[0] * rng.normal(size=len(distances)))
    headings = np.concatenate(([0.0], np.cumsum(turns)))
    middle = headings[:-1] + 0.5 * turns
    way = np.cumsum(distances[:, None] * np.stack((np.cos(middle), np.sin(middle)), axis=1), axis=0)
    measured = np.column_stack((np.concatenate((np.zeros((1, 2)), way)), wrap(headings)))
    return start + np.round(times * 1e9).astype(np.int64), measured


def yaw_rates(path, rate=100.0, seed=0, bias=0.002, noise=0.005, start=START):
    """What a gyroscope measures: stamps (N,) int64 [ns] and yaw rates (N,) [rad/s], `bias` and `noise` in [rad/s]."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, path.duration, 1.0 / rate)
    turned = np.interp(times + 0.5 / rate, path.times, path.poses[:, 2]) \
        - np.interp(times - 0.5 / rate, path.times, path.poses[:, 2])
    rates = turned * rate + bias + noise * rng.normal(size=len(times))
    return start + np.round(times * 1e9).astype(np.int64), rates
