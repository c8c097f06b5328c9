# SPDX-License-Identifier: Apache-2.0
"""Normals of the points of a scan, from line fits to their neighbours."""
import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray, IntArray
from ..geometry.line_fit import fit_lines
from ..geometry.se2 import unit_complex
from ..parameters.features import SegmentParameters
from .point_sequence import PointSequence


def estimate_normals(sequence: PointSequence, noise: FloatArray, parameters: SegmentParameters) -> ComplexArray:
    """Estimate unit normals from the neighbours of each point on its surface.

    Normals face the sensor; their side follows from the order of the beams. A point with fewer than three neighbours on
    its surface, or whose neighbours lie on no line, gets no normal.

    Parameters
    ----------
    sequence : PointSequence
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P,) complex
        0 for points without a normal.
    """
    low, high = _windows(sequence, noise, parameters)
    count, points = high - low, sequence.points
    line = fit_lines(sequence.moments.take(high, axis=1) - sequence.moments.take(low, axis=1), count)
    normals: ComplexArray = 1j * unit_complex(line.angle)
    onward = points[high - 1] - points[low]
    np.negative(normals, out=normals, where=(onward.conj() * normals).imag * sequence.increment < 0.0)
    normals[(count < _MIN_NEIGHBOURS) | (line.residual > _MAX_RESIDUAL * line.spread)] = 0.0
    return normals


def _windows(sequence: PointSequence, noise: FloatArray, parameters: SegmentParameters) -> tuple[IntArray, IntArray]:
    """Return the index of the first neighbour of each point, and the index of the point after the last neighbour.

    The window of a point spans `normal_reach`, or `normal_noise` times the noise where that is more, and at least
    `normal_beams` on each side: noise acts along the beams and tilts lines through points that lie close together. The
    distance along a surface is measured over three beams at a time, because noise makes single steps zigzag.
    """
    points, breaks = sequence.points, sequence.breaks
    size, step = len(points), np.abs(points[1:] - points[:-1])
    unbroken = ~(breaks[:-2] | breaks[1:-1] | breaks[2:])
    step[1:-1][unbroken] = np.abs(points[_STEPS:] - points[:-_STEPS])[unbroken] / _STEPS
    path = np.zeros(size)
    step[breaks] = 0.0
    step.cumsum(out=path[1:])
    edge = np.concatenate(([0], breaks.nonzero()[0] + 1, [size]))
    first, end = edge[:-1], edge[1:]
    index, length = np.arange(size), end - first
    reach = np.maximum(parameters.normal_reach, parameters.normal_noise * noise)
    low = np.minimum(path.searchsorted(path - reach), index - parameters.normal_beams)
    high = np.maximum(path.searchsorted(path + reach, 'right'), index + (parameters.normal_beams + 1))
    return np.maximum(low, first.repeat(length)), np.minimum(high, end.repeat(length))


_STEPS = 3
"""The distance along a surface is averaged over this number of steps between neighbouring points."""
_MIN_NEIGHBOURS = 3
"""Minimum number of points in the window of a point for it to have a normal."""
_MAX_RESIDUAL = 0.25
"""A point gets no normal if the neighbours' squared extents across and along the fitted line exceed this ratio."""
