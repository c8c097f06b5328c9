# SPDX-License-Identifier: Apache-2.0
"""Points of a scan in beam order, cut into surfaces at breakpoints (Eq. 5)."""
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.line_fit import summed_moments
from ..parameters.features import SegmentParameters


class PointSequence(NamedTuple):
    """The P points of a scan in beam order, cut into surfaces.

    Attributes
    ----------
    points : (P,) complex [m]
        Positions in the frame of the sensor.
    radius : (P,) float [m]
        Range of each point.
    beams : (P,) int
    moments : (5, P + 1) float
        `summed_moments` of the points.
    breaks : (P - 1,) bool
        True where a point and the next lie on different surfaces.
    increment : float [rad]
        Step from one beam to the next.
    """

    points: ComplexArray
    radius: FloatArray
    beams: IntArray
    moments: FloatArray
    breaks: BoolArray
    increment: float


def point_sequence(points: ComplexArray, beams: IntArray, increment: float, noise: float,
                   parameters: SegmentParameters) -> PointSequence:
    """Make the `PointSequence` of a scan; arguments as for `find_breaks`."""
    breaks = find_breaks(points, beams, increment, noise, parameters)
    return PointSequence(points, np.abs(points), beams, summed_moments(points), breaks, increment)


def find_breaks(points: ComplexArray, beams: IntArray, increment: float, noise: float,
                parameters: SegmentParameters) -> BoolArray:
    """Find where neighbouring points of a scan lie too far apart for one surface (Eq. 5).

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    beams : (P,) int
        Beam of each point; the threshold grows with the number of beams between two points.
    increment : float
        Step from one beam to the next [rad].
    noise : float
        Standard deviation of a range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P - 1,) bool
        True where a break lies between a point and the next.
    """
    radius, distance = np.abs(points), np.abs(points[1:] - points[:-1])
    gap = beams[1:] - beams[:-1]
    threshold = parameters.breakpoint_factor * abs(increment) * gap * np.minimum(radius[1:], radius[:-1])
    threshold += parameters.breakpoint_noise * noise
    breaks: BoolArray = (distance >= threshold) | (gap > parameters.max_gap)
    return breaks
