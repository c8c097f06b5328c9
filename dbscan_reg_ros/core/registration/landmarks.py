# SPDX-License-Identifier: Apache-2.0
"""Hypotheses from landmarks, small things that stand free: two of them as far apart in both scans.

A trunk has no line that says how the sensor has turned: what it shows always faces the sensor. The line through two of them
has, and tells the whole motion.
"""
import numpy as np

from ..features.records import Features
from ..features.small_objects import find_small_objects
from ..geometry.robust_kernel import kernel
from ..geometry.se2 import as_vectors
from ..parameters.tree import Parameters
from .point_to_line import transform_points
from .records import Prior
from .scoring import distinct, within_gate


def landmarks(features: Features, parameters: Parameters):
    """Their middles (complex [m]), of the nearest first."""
    things = find_small_objects(features, parameters.selection.landmark_size, parameters.segments)
    return things.middle[things.nearest.argsort(kind='stable')[:parameters.selection.max_landmarks]]


def landmark_motions(reference: Features, current: Features, parameters: Parameters, prior: Prior | None = None):
    """The motions ``(H, 3)`` that lay the current scan's landmarks best onto the reference's, best first.

    A pair of landmarks as far apart as one of the reference is a sample. Its support is the sum of the kernels (Eq. 16) of
    all landmarks' distances from the nearest one of the reference. What a `prior` rules out is left out.
    """
    here, there = (landmarks(each, parameters) for each in (reference, current))
    ways, steps = here - here[:, None], there - there[:, None]
    first, second = ways.nonzero()
    start, end = np.triu(steps).nonzero()
    ways, steps = ways[first, second], steps[start, end]
    off = np.abs(np.abs(ways)[:, None] - np.abs(steps))
    of, to = (off < _CLOSE).nonzero()
    alike = off[of, to].argsort(kind='stable')[:_SAMPLES]
    of, to = of[alike], to[alike]
    turn = ways[of] / steps[to]
    turn /= np.abs(turn)
    way = 0.5 * (here[first[of]] + here[second[of]] - turn * (there[start[to]] + there[end[to]]))
    motions = np.column_stack((as_vectors(way), np.angle(turn)))
    if prior is not None:
        motions = motions[within_gate(motions, prior, parameters.prior)]
    missed = np.abs(transform_points(motions, there)[:, :, None] - here).min(axis=2, initial=np.inf)
    support = kernel(missed, _CLOSE).sum(axis=1)
    motions = motions[(-support).argsort(kind='stable')[:np.count_nonzero(support >= _LEAST)]]
    return motions[distinct(motions, _MOST, 2.0 * _CLOSE, _CLOSE_TURN)]


_CLOSE = 0.1
"""Places [m] that may be one."""
_CLOSE_TURN = 0.1
"""Turns [rad] that may be one."""
_LEAST = 2.5
"""Support: two tell a motion, and a third has to agree."""
_SAMPLES = 500
"""Those that are as far apart to the last millimetre come first."""
_MOST = 8
"""Motions that are followed."""
