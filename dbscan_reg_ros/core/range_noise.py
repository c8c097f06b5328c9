"""How noisy the ranges of a scan are, and whether far ones are noisier than near ones."""
import math
from collections import deque

import numpy as np


def estimate_noise(ranges, limits):
    """Standard deviation of a range [m], from second differences along the scan.

    A low quantile of them, so that corners, jumps and a good share of outliers do not matter; kept within the limits.
    """
    if len(ranges) < 8:
        return limits.noise_max
    bend = np.abs(ranges[1:-1] - 0.5 * (ranges[2:] + ranges[:-2]))
    at = int(_NOISE_QUANTILE * len(bend))
    bend.partition(at)
    return min(max(float(bend[at]) / _NOISE_BEND, limits.noise_min), limits.noise_max)


def estimate_noise_share(radius, beams, increment, limits):
    """Standard deviation of a range as a share of it; 0 where far ranges are not noisier than near ones.

    From second differences of the inverse range, which along a straight wall is a sine of the bearing: what the wall itself
    bends, at a grazing angle many times the noise, is taken out. The nearer and the farther half of the points decide: their
    noise differs as their ranges do, or not at all, whichever is closer.

    Parameters
    ----------
    radius : (P,) array [m]
        Ranges in beam order.
    beams : (P,) int array
        Their beams.
    increment : float [rad]
        Between beams.
    limits : ScanParameters
    """
    middle = (beams[2:] - beams[:-2] == 2).nonzero()[0] + 1
    half = len(middle) // 2
    if half < 8:
        return 0.0
    inverse = 1.0 / radius
    bend = np.abs(inverse[middle] - 0.5 / math.cos(increment) * (inverse[middle - 1] + inverse[middle + 1]))
    away = radius[middle]
    bend *= away * away
    order, at = away.argsort(kind='stable'), int(_NOISE_QUANTILE * half)
    near, far = order[:half], order[-half:]
    near_noise, far_noise = (float(np.partition(bend[part], at)[at]) / _NOISE_BEND for part in (near, far))
    near_range, far_range = away[near[half // 2]], away[far[half // 2]]
    if far_noise ** 2 * near_range <= near_noise ** 2 * far_range:
        return 0.0
    return min(far_noise / float(far_range), limits.noise_share_max)


class UsualShare:
    """The noise share of a sensor: what nearly all of its last scans say at least, as clutter seems to be noise in some."""

    def __init__(self):
        self._shares = deque(maxlen=_SCANS)

    def add(self, share):
        """One more scan's."""
        self._shares.append(share)

    @property
    def value(self):
        """Of the scans so far, at least one."""
        return sorted(self._shares)[int(_SHARE_QUANTILE * len(self._shares))]


_NOISE_QUANTILE = 0.3
# That quantile of |N(0, 1)|, for a second difference with weights 1, -1/2, -1/2.
_NOISE_BEND = 0.38532 * math.sqrt(1.5)
_SCANS = 30
_SHARE_QUANTILE = 0.3
