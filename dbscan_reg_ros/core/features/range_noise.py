# SPDX-License-Identifier: Apache-2.0
"""How noisy the ranges of a scan are, and whether far ones are noisier than near ones."""
import math
from dataclasses import dataclass

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
    return min(max(float(bend[at]) / (_NORMAL * math.sqrt(1.5)), limits.noise_min), limits.noise_max)


def estimate_noise_ratio(places, beams, limits):
    """Standard deviation of a range as a share of it; 0 where far ranges are not noisier than near ones.

    From how far points lie along their beams from the line through their neighbours: points of a straight wall lie on it, at a
    grazing angle, too, and however unevenly its beams are spread. The nearer and the farther half of the points decide: their
    noise differs as their ranges do, or not at all, whichever is closer. What is spread wider than noise is clutter and outliers.

    Parameters
    ----------
    places : (P,) complex array [m]
        Points in beam order.
    beams : (P,) int array
        Their beams.
    limits : ScanParameters
    """
    # Areas between the beams of neighbours; of three points on a line those of both pairs are the whole.
    pair, whole = (places[:-1].conj() * places[1:]).imag, (places[:-2].conj() * places[2:]).imag
    first, second, radius = pair[:-1], pair[1:], np.abs(places)
    usable = ((beams[2:] - beams[:-2] == 2) & (first * second > 0.0)).nonzero()[0]
    half = len(usable) // 2
    if half < 8:
        return 0.0
    away = radius[1:-1]
    # The line has so much of its ends' noise where the point is.
    ends = np.hypot(second * radius[:-2], first * radius[2:])
    bend = (away * away * np.abs(whole - first - second)).take(usable) / np.hypot(whole * away, ends).take(usable)
    away = away.take(usable)
    order, at, above = away.argsort(kind='stable'), int(_NOISE_QUANTILE * half), int((1.0 - _NOISE_QUANTILE) * half)
    near, far = order[:half], order[-half:]
    near_noise = np.partition(bend[near], at)[at]
    far_noise, far_most = np.partition(bend[far], (at, above))[[at, above]]
    near_range, far_range = away[near[half // 2]], away[far[half // 2]]
    if far_noise ** 2 * near_range <= near_noise ** 2 * far_range or far_most > _WIDE * far_noise:
        return 0.0
    return min(float(far_noise / far_range) / _NORMAL, limits.noise_ratio_max)


def range_noise(radius, noise, share):
    """Standard deviation [m] of each range ``(P,)``: the `noise` of the scan, and more where its `share` of the range is unusual."""
    return noise + np.maximum(share * radius - TYPICAL_NOISE, 0.0)


@dataclass(frozen=True)
class NoiseRatioHistory:
    """The noise share of a sensor: what nearly all of its last scans say at least, as clutter seems to be noise in some."""

    shares: tuple = ()

    def after(self, share):
        """With that of one more scan."""
        return NoiseRatioHistory((*self.shares, share)[-_SCANS:])

    @property
    def value(self):
        """Of the scans so far, at least one."""
        return sorted(self.shares)[int(_SHARE_QUANTILE * len(self.shares))]


TYPICAL_NOISE = 0.05
"""[m] Ranges noisier than this are taken to be so."""
_NOISE_QUANTILE = 0.3
# That quantile of |N(0, 1)|.
_NORMAL = 0.38532
# Between these quantiles |N(0, 1)| grows to 2.7 times as much, and of forty values hardly ever to so many times.
_WIDE = 4.0
_SCANS = 30
_SHARE_QUANTILE = 0.3
