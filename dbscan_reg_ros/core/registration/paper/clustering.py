# SPDX-License-Identifier: Apache-2.0
"""Implementations of DBSCAN behind one interface, chosen by a parameter."""
from typing import Protocol

from ...geometry.array_types import FloatArray, IntArray
from .. import dbscan


class Clustering(Protocol):
    """An implementation of DBSCAN.

    `dbscan_line` and `dbscan_plane` return the cluster of each sample as ``(N,) int``, -1 for noise. Clusters are
    numbered in the order of their first core samples. A border sample belongs to the first cluster that has a core
    sample within `eps` of it.
    """

    def dbscan_line(self, samples: FloatArray, eps: float, min_samples: int,
                    sample_weight: FloatArray | None = None,
                    period: float | None = None) -> IntArray:
        """Cluster numbers ``(N,)``; with a `period`, on a circle of this circumference."""
        ...

    def dbscan_plane(self, samples: FloatArray, eps: float, min_samples: int,
                     sample_weight: FloatArray | None = None) -> IntArray:
        """Cluster points ``(N, D)`` by their Euclidean distances."""
        ...


def choose_clustering(name: str) -> Clustering:
    """Return the DBSCAN implementation with this `name`; scikit-learn is imported only if chosen.

    Raises
    ------
    ParameterError
        When scikit-learn is chosen and not installed.
    """
    if name == 'scikit_learn':
        from .scikit_learn_dbscan import ScikitLearnClustering
        return ScikitLearnClustering()
    return dbscan
