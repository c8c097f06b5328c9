# SPDX-License-Identifier: Apache-2.0
"""Points of a scan in beam order, cut into surfaces."""
from typing import NamedTuple

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray


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
        Sums of x, y, xx, xy, yy before each point: the difference of two columns is the sum over a range of points.
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
