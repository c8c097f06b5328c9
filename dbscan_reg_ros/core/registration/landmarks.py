# SPDX-License-Identifier: Apache-2.0
"""Hypotheses from landmarks (small objects): pairs of landmarks with the same distance in both scans.

A trunk has no line that gives the rotation of the sensor, as its visible side always faces the sensor. The line through
two trunks gives the rotation and the translation.
"""
import numpy as np

from ..features.poles import find_small_objects
from ..features.records import Features
from ..geometry.array_types import ComplexArray, FloatArray
from ..geometry.robust_kernel import kernel
from ..geometry.se2 import as_complex, as_vectors, moduli, rotated, wrap
from ..geometry.ties import order_up_to_rounding
from ..geometry.tolerance import SAME
from ..parameters.tree import Parameters
from .records import Prior
from .scoring import distinct, within_gate

LANDMARK_SIZE = 1.0
"""Small objects below this size [m] are landmarks: trunks, bins and legs, whose middles agree from all sides."""


def landmarks(features: Features, parameters: Parameters) -> ComplexArray:
    """Return the middles (complex [m]) of the nearest `selection.max_landmarks` small objects, nearest first."""
    objects = find_small_objects(features, LANDMARK_SIZE, parameters.segments)
    nearest = order_up_to_rounding(objects.nearest)[:parameters.selection.max_landmarks]
    middles: ComplexArray = objects.middle[nearest]
    return middles


def landmark_motions(reference: Features, current: Features, parameters: Parameters,
                     prior: Prior | None = None) -> FloatArray:
    """Return the motions ``(H, 3)`` that align the current scan's landmarks best with the reference's, best first.

    A pair of landmarks in each scan, with equal distances, gives a sample motion. Its support is the sum of the kernels
    (Eq. 18) of the distances of all landmarks from the nearest landmark of the reference. Samples outside the gate
    around a `prior` are left out.
    """
    ours, theirs = (landmarks(each, parameters) for each in (reference, current))
    motions = pair_motions(ours, theirs)
    if prior is not None:
        motions = motions[within_gate(motions, prior, parameters.prior)]
    # Eq. 8
    moved = rotated(theirs, motions[:, 2:]) + as_complex(motions[:, :2])[:, None]
    distance = moduli(moved[:, :, None] - ours).min(axis=2, initial=np.inf)
    support = kernel(distance, SAME).sum(axis=1)
    motions = motions[order_up_to_rounding(-support)[:np.count_nonzero(support >= _MIN_SUPPORT)]]
    chosen: FloatArray = motions[distinct(motions, _MAX_MOTIONS, 2.0 * SAME, SAME)]
    return chosen


def pair_motions(reference: ComplexArray, current: ComplexArray) -> FloatArray:
    """Return the motions ``(S, 3)`` that align a pair of landmarks with a pair of nearly the same distance.

    Parameters
    ----------
    reference, current : (L,), (M,) complex arrays [m]
        Landmarks of the reference, and of the current scan.
    """
    baselines_r, baselines_o = reference - reference[:, None], current - current[:, None]
    # Each pair of the reference in both orders, each pair of the current scan in one.
    first, second = baselines_r.nonzero()
    start, end = np.triu(baselines_o).nonzero()
    baselines_r, baselines_o = baselines_r[first, second], baselines_o[start, end]
    off = np.abs(moduli(baselines_r)[:, None] - moduli(baselines_o))
    r, o = (off < SAME).nonzero()
    closest = order_up_to_rounding(off[r, o])[:_MAX_SAMPLES]
    r, o = r[closest], o[closest]
    rotation = wrap(np.angle(baselines_r[r]) - np.angle(baselines_o[o]))
    translation = 0.5 * (reference[first[r]] + reference[second[r]]
                         - rotated(current[start[o]] + current[end[o]], rotation))
    return np.column_stack((as_vectors(translation), rotation))


_MIN_SUPPORT = 2.5
"""Least support of a motion: two landmarks determine it, and a third one has to confirm it."""
_MAX_SAMPLES = 500
"""At most this many samples are checked, those with the most similar distances first."""
_MAX_MOTIONS = 8
"""At most this many motions become hypotheses."""
