# SPDX-License-Identifier: Apache-2.0
"""LaserScan messages at their worst: any field may be impossible, and any sequence of ranges may come."""
import math
from types import SimpleNamespace

import numpy as np
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros.core.geometry.se2 import SE2

ROOM = outline(L_ROOM)
LARGEST = 3.4e38
NO_NUMBERS = [0.0, -0.0, -1.0, math.nan, math.inf, -math.inf, LARGEST, -LARGEST, 1e-45, -1e-45, 1e-7, 1e7]
ANGLES = [*NO_NUMBERS, -math.pi, math.pi, 0.5 * math.pi, 6.4, 0.01, -0.01, 100.0]
STAMPS = [(0, 0), (-2**31, 0), (2**31 - 1, 999_999_999), (5, 2**32 - 1), (5, 10**9), (-1, 5), (1, 0)]
SIZES = [0, 1, 2, 3, 7, 19, 20, 21, 64, 181, 720, 1141]
HUGE = [100_000, 100_001, 1_000_000]


def worst_scan(rng, index, huge=0.0):
    """An object with the fields of a LaserScan, mostly those of a room with a few of them spoilt.

    Parameters
    ----------
    rng : numpy.random.Generator
    index : int
        Of the scan in its sequence: where the sensor is, and its stamp where that is not spoilt.
    huge : float
        How probable far too many beams are.
    """
    pose = SE2(0.02 * index, 0.0, 0.03 * index)
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=100 + index // 10, nanosec=index % 10 * 100_000_000),
                               frame_id='laser'),
        angle_min=FULL.angle_min, angle_max=FULL.angle_min + (FULL.size - 1) * FULL.angle_increment,
        angle_increment=FULL.angle_increment, time_increment=0.0, scan_time=0.1, range_min=0.0, range_max=100.0,
        ranges=look(ROOM, pose, FULL, 0.01, int(rng.integers(2**31))).ranges.copy(),
                              intensities=np.zeros(0, np.float32))
    spoils = [_spoil_angles, _spoil_limits, _spoil_stamp, _spoil_some_ranges, _replace_ranges, _cut, _spoil_rest]
    for spoil in rng.permutation(len(spoils))[:rng.choice(4, p=[0.1, 0.5, 0.25, 0.15])]:
        spoils[spoil](message, rng)
    if rng.random() < huge:
        message.ranges = _pattern(rng, int(rng.choice(HUGE)))
        message.angle_increment, message.range_max = 2.0 * math.pi / len(message.ranges), 0.0
    return message


def _spoil_angles(message, rng):
    for name in rng.permutation(['angle_min', 'angle_max', 'angle_increment'])[:rng.integers(1, 4)]:
        setattr(message, name, float(rng.choice(ANGLES)))
    if rng.random() < 0.3:
        message.angle_increment = -FULL.angle_increment


def _spoil_limits(message, rng):
    message.range_min = float(rng.choice([*NO_NUMBERS, 0.5, 3.0]))
    message.range_max = float(rng.choice([*NO_NUMBERS, 0.5, 3.0]))


def _spoil_stamp(message, rng):
    message.header.stamp.sec, message.header.stamp.nanosec = STAMPS[rng.integers(len(STAMPS))]


def _spoil_rest(message, rng):
    message.time_increment = float(rng.choice([*NO_NUMBERS, 1e-4, -1e-4, 1.0]))
    message.scan_time = float(rng.choice(NO_NUMBERS))
    message.intensities = np.zeros(int(rng.choice(SIZES)), np.float32)
    message.header.frame_id = str(rng.choice(['', 'laser', '/', 'ü\\n%s{}', 'x' * 1000]))


def _spoil_some_ranges(message, rng):
    spoilt = rng.random(len(message.ranges)) < rng.choice([0.02, 0.3, 0.95])
    message.ranges[spoilt] = rng.choice(NO_NUMBERS, spoilt.sum())


def _replace_ranges(message, rng):
    size = int(rng.choice(SIZES))
    message.ranges = _pattern(rng, size)
    if rng.random() < 0.7:
        message.angle_increment = 2.0 * math.pi / max(size, 1)


def _cut(message, rng):
    message.ranges = message.ranges[:rng.choice(SIZES)]


def _pattern(rng, size):
    """``(size,)`` ranges without a world behind them."""
    beams = np.arange(size)
    scale = 10.0 ** rng.uniform(-6.0, 6.0) if rng.random() < 0.3 else 5.0
    period = int(rng.integers(2, 40))
    patterns = [np.full(size, rng.choice(NO_NUMBERS)), np.ones(size), 1.0 + beams % period / period,
                rng.uniform(0.0, 1.0, size),
                1.0 + (beams // period % 2), np.linspace(0.01, 1.0, size), np.exp(rng.normal(0.0, 3.0, size)),
                1.0 / np.maximum(np.abs(np.cos(beams * math.tau / max(size, 1) * period / 2.0)), 0.05),
                _many_walls(rng, size, period)]
    with np.errstate(over='ignore', invalid='ignore'):
        return (scale * patterns[rng.integers(len(patterns))]).astype(np.float32)


def _many_walls(rng, size, beams):
    """``(size,)`` ranges of as many short walls of `beams` beams each as fit, far away and far apart."""
    walls = np.arange(size) // beams
    level, tilt = rng.uniform(0.5, 1.0, size // beams + 1), rng.uniform(-1.0, 1.0, size // beams + 1)
    return 60.0 * level[walls] * (1.0 + tilt[walls] * (np.arange(size) % beams) * math.tau / max(size, 1))
