# SPDX-License-Identifier: Apache-2.0
"""Rotation: the largest DBSCAN cluster of the angle differences between the lines of both scans (Eq. 9)."""
import math

import numpy as np

from ..features.records import Segments
from ..geometry.array_types import FloatArray, IntArray
from ..geometry.se2 import wrap, wrap_period
from ..registration.hypotheses import Rotations

_EPS = 0.0566
"""Neighbourhood [rad]: the paper's 0.08 in the plane of (d, d) is 0.08 / sqrt(2) in angle."""
_MIN_SAMPLES = 1
"""MinPts of the paper."""
_MEDIAN_SCALE = 0.001
"""Open: weights of the cluster's mean. A sample this far [rad] from the median has half the weight."""


def estimate_rotation(reference: Segments, current: Segments) -> Rotations:
    """Return the mean angle of the largest cluster, as the one hypothesis of `Rotations`; none without lines.

    Straight lines have no direction: all angles are modulo pi.
    """
    difference: FloatArray = wrap_period(reference.direction[:, None] - current.direction, math.pi)
    samples = difference.ravel()
    labels = dbscan_on_circle(samples)
    if not len(samples):
        return Rotations(np.empty(0), np.empty(0), difference, labels.reshape(difference.shape), _EPS)
    largest = int(np.bincount(labels).argmax())
    members = labels == largest
    offset = wrap_period(samples[members] - samples[members][-1], math.pi)
    weight = 1.0 / (1.0 + ((offset - np.median(offset)) / _MEDIAN_SCALE) ** 2)
    phi = wrap(samples[members][-1] + (weight * offset).sum() / weight.sum())
    return Rotations(np.array([phi]), np.array([float(members.sum())]), difference,
                     np.where(members, 0, -1).reshape(difference.shape), _EPS)


def dbscan_on_circle(samples: FloatArray) -> IntArray:
    """Cluster angles [rad] modulo pi with scikit-learn's DBSCAN, from their distances along the circle.

    The distances are sparse: a full table of 100 x 100 pairs of segments would take 800 MB.
    """
    from scipy.spatial import cKDTree
    from sklearn.cluster import DBSCAN
    from sklearn.neighbors import sort_graph_by_row_values
    if not len(samples):
        return np.empty(0, dtype=int)
    on_circle = np.mod(samples, math.pi)
    on_circle[on_circle >= math.pi] = 0.0
    tree = cKDTree(on_circle[:, None], boxsize=math.pi)
    distances = tree.sparse_distance_matrix(tree, _EPS, output_type='coo_matrix').tocsr()
    distances = sort_graph_by_row_values(distances, warn_when_not_sorted=False)
    return np.asarray(DBSCAN(eps=_EPS, min_samples=_MIN_SAMPLES, metric='precomputed').fit(distances).labels_)
