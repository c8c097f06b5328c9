# SPDX-License-Identifier: Apache-2.0
"""Translations from squared line equations, which do not determine the sign, and their clusters (Eq. 10-15)."""
import math

import numpy as np

from ..features.records import Segments
from ..geometry.array_types import ComplexArray, FloatArray
from ..geometry.se2 import SE2, as_vectors
from ..geometry.tolerance import TINY
from ..registration.hypotheses import Translations

_PARALLEL = 0.1
"""Open: eps1 of Eq. 12 to begin with [rad]; it shrinks until no more pairs are left than the current scan has lines."""
_MIN_CROSSING_SINE = 0.35
"""Open: eps2 of Eq. 13, as a sine: two lines at a smaller angle give no translation."""
_EPS, _MIN_SAMPLES = 0.05, 1
"""Neighbourhood [m] and MinPts of DBSCAN."""


def estimate_translations(reference: Segments, current: Segments, phi: FloatArray) -> Translations:
    """Solve all pairs of squared line equations under the rotation `phi` ``(1,)`` and cluster the solutions.

    The right signs form one large cluster, and both wrong signs a second one; solutions with one wrong sign scatter.
    Without a rotation, `phi` ``(0,)``, there are none.
    """
    from sklearn.cluster import DBSCAN
    samples = squared_solutions(*line_equations(reference, current, float(phi[0]))) if len(phi) else np.empty((0, 2))
    labels = np.empty(0, dtype=int)
    if len(samples):
        labels = np.asarray(DBSCAN(eps=_EPS, min_samples=_MIN_SAMPLES).fit(samples).labels_)
    size = np.bincount(labels)
    order = np.argsort(-size, kind='stable')
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    means = np.array([samples[labels == cluster].mean(axis=0) for cluster in order.tolist()]).reshape(-1, 2)
    transform = np.column_stack((means, np.full(len(means), phi[0] if len(phi) else 0.0)))
    return Translations(transform, size[order].astype(float), samples, np.ones(len(samples)),
                        np.zeros(len(samples), dtype=int), rank[labels], _EPS)


def line_equations(reference: Segments, current: Segments, phi: float) -> tuple[FloatArray, FloatArray]:
    """Match the lines that the rotation makes parallel (Eq. 12), and compute their distances (Eq. 14).

    Returns
    -------
    angle : (L,) float [rad]
        Direction of each pair: the mean of the directions of its two lines, modulo pi.
    distance : (L,) float [m]
        Distance from the rotated midpoint of the current scan's segment (Eq. 10) to the reference's line.
    """
    difference = reference.direction[:, None] - (current.direction + phi)
    difference = (difference + 0.5 * math.pi) % math.pi - 0.5 * math.pi
    size = np.sort(np.abs(difference), axis=None)
    eps1 = min(_PARALLEL, size[len(current)] - TINY) if len(size) > len(current) else _PARALLEL
    r, o = np.nonzero(np.abs(difference) < eps1)
    angle = reference.direction[r] - 0.5 * difference[r, o]
    apart = reference.midpoint[r] - SE2(0.0, 0.0, phi).apply(current.midpoint)[o]
    return angle, np.abs(np.cos(angle) * apart[:, 1] - np.sin(angle) * apart[:, 0])


def squared_solutions(angle: FloatArray, distance: FloatArray) -> FloatArray:
    """Solve ``(n1 . t)^2 = d1^2`` and ``(n2 . t)^2 = d2^2`` (Eq. 15) of all lines that cross, ``(4 K, 2)`` [m]."""
    along: ComplexArray = np.exp(1j * angle)
    first, second = np.triu_indices(len(angle), 1)
    determinant = (along[first].conj() * along[second]).imag
    crossing = np.abs(determinant) > _MIN_CROSSING_SINE
    first, second, determinant = first[crossing], second[crossing], determinant[crossing]
    one, two = distance[first] * along[second] / determinant, -distance[second] * along[first] / determinant
    return as_vectors(np.concatenate((one + two, one - two, two - one, -one - two)))
