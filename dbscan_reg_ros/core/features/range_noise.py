# SPDX-License-Identifier: Apache-2.0
"""Noise of the ranges of a scan, and how it grows with the range."""
import math
from dataclasses import dataclass

import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray, IntArray
from ..parameters.features import ScanParameters


def estimate_noise(ranges: FloatArray, limits: ScanParameters) -> float:
    """Estimate the standard deviation of a range [m] from second differences along the scan.

    A low quantile of the differences is robust against corners, range jumps and a good part of outliers. The result is
    clipped to the limits `noise_min` and `noise_max`.

    Parameters
    ----------
    ranges : (P,) float
        Returns in beam order [m].
    limits : ScanParameters
    """
    if len(ranges) < _MIN_RANGES:
        return limits.noise_max
    bend = np.abs(ranges[1:-1] - 0.5 * (ranges[2:] + ranges[:-2]))
    rank = int(_NOISE_QUANTILE * len(bend))
    bend.partition(rank)
    return min(max(float(bend[rank]) / (_NORMAL * math.sqrt(1.0 + 2.0 * 0.5 ** 2)), limits.noise_min), limits.noise_max)


def estimate_noise_ratio(points: ComplexArray, ranges: FloatArray, beams: IntArray, limits: ScanParameters) -> float:
    """Estimate the standard deviation of a range as a fraction of the range.

    The error of a point is its distance, along its beam, from the line through its two neighbours; this holds for
    straight walls at any angle and for uneven beams. The errors of the nearer and of the farther half of the points are
    compared: the noise is taken as proportional to the range or as constant, whichever fits better. Errors that spread
    more widely than noise come from clutter and outliers; the result is then 0.

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    ranges : (P,) float
        Their ranges [m]. Many of a lidar are equal: computed again from the points, rounding would decide their order.
    beams : (P,) int
        Beam of each point.
    limits : ScanParameters

    Returns
    -------
    float
        At most `noise_ratio_max`; 0 where far ranges are not noisier than near ones.
    """
    error, radius = _errors_along_beams(points, ranges, beams)
    half = len(error) // 2
    if half < _MIN_RANGES:
        return 0.0
    order = radius.argsort(kind='stable')
    near, far = order[:half], order[-half:]
    rank, high_rank = int(_NOISE_QUANTILE * half), int((1.0 - _NOISE_QUANTILE) * half)
    near_noise = np.partition(error[near], rank)[rank]
    far_noise, far_high = np.partition(error[far], (rank, high_rank))[[rank, high_rank]]
    near_range, far_range = radius[near[half // 2]], radius[far[half // 2]]
    if far_noise ** 2 * near_range <= near_noise ** 2 * far_range or far_high > _MAX_SPREAD * far_noise:
        return 0.0
    return min(float(far_noise / far_range) / _NORMAL, limits.noise_ratio_max)


def _errors_along_beams(points: ComplexArray, ranges: FloatArray,
                        beams: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return two arrays [m]: errors of points, each scaled to the noise of one range, and ranges of the same points.

    The error is the distance of a point, along its beam, from the line through its two neighbours. Points are used if
    both adjacent beams have a return, and the line crosses the point's own beam between these returns.
    """
    # Twice the areas of the triangles between the sensor and two points: for points on a line both pairs add up.
    pair, whole = (points[:-1].conj() * points[1:]).imag, (points[:-2].conj() * points[2:]).imag
    first, second = pair[:-1], pair[1:]
    usable = ((beams[2:] - 1 == beams[:-2] + 1) & (first * second > 0.0)).nonzero()[0]
    middle = ranges[1:-1]
    # Noise of the line at the beam of the point, from that of its two ends.
    ends = np.hypot(second * ranges[:-2], first * ranges[2:])
    area = (middle * middle * np.abs(whole - first - second)).take(usable)
    return area / np.hypot(whole * middle, ends).take(usable), middle.take(usable)


def range_noise(radius: FloatArray, noise: float, ratio: float) -> FloatArray:
    """Return the standard deviation [m] of each range.

    Parameters
    ----------
    radius : (P,) float
        Ranges [m].
    noise : float
        Standard deviation of a range of the scan [m].
    ratio : float
        Standard deviation of a range as a fraction of the range. Where ``ratio * radius`` exceeds `TYPICAL_NOISE`, the
        excess is added to `noise`.
    """
    return noise + np.maximum(ratio * radius - TYPICAL_NOISE, 0.0)


@dataclass(frozen=True)
class NoiseRatioHistory:
    """Noise ratio of a sensor: a low quantile over the last scans, because clutter increases the ratio in some scans.

    Attributes
    ----------
    ratios : tuple of float
        `estimate_noise_ratio` of the last scans.
    """

    ratios: tuple[float, ...] = ()

    def after(self, ratio: float) -> 'NoiseRatioHistory':
        """Return the history with the `ratio` of one more scan."""
        return NoiseRatioHistory((*self.ratios, ratio)[-_SCANS:])

    @property
    def value(self) -> float:
        """Low quantile of `ratios`, which must not be empty."""
        return sorted(self.ratios)[int(_NOISE_QUANTILE * len(self.ratios))]


TYPICAL_NOISE = 0.05
"""Points whose range noise [m] exceeds this get a smaller weight."""
_MIN_RANGES = 8
"""Minimum number of ranges for a noise estimate."""
_NOISE_QUANTILE = 0.3
"""Quantile of the errors that gives the noise, and of the history that gives the noise ratio of the sensor."""
_NORMAL = 0.38532
"""Quantile `_NOISE_QUANTILE` of |N(0, 1)|."""
_MAX_SPREAD = 4.0
"""Errors are no noise if their quantile 0.7 exceeds this multiple of their quantile 0.3 (2.7 for |N(0, 1)|)."""
_SCANS = 30
"""Number of scans in the history of the noise ratio."""
