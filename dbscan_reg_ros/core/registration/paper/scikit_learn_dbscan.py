# SPDX-License-Identifier: Apache-2.0
"""DBSCAN of scikit-learn, with the interface of `clustering.Clustering`."""
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ...errors import ParameterError
from ...geometry.array_types import FloatArray, IntArray


class ScikitLearnClustering:
    """Adapter of ``sklearn.cluster.DBSCAN``; angles are clustered with precomputed circular distances.

    Raises
    ------
    ParameterError
        When scikit-learn is not installed.
    """

    def __init__(self) -> None:
        try:
            from sklearn.cluster import DBSCAN
            from sklearn.neighbors import sort_graph_by_row_values
        except ModuleNotFoundError:
            raise ParameterError("clustering = 'scikit_learn': scikit-learn is not installed; install python3-sklearn, "
                                 "or choose 'built_in'") from None
        self._dbscan, self._sort = DBSCAN, sort_graph_by_row_values

    def dbscan_line(self, samples: FloatArray, eps: float, min_samples: int,
                    sample_weight: FloatArray | None = None,
                    period: float | None = None) -> IntArray:
        """Cluster numbers ``(N,)``; with a `period`, on a circle of this circumference."""
        if period is None:
            return self.dbscan_plane(samples[:, None], eps, min_samples, sample_weight)
        if not len(samples):
            return np.empty(0, dtype=int)
        distances = self._sort(circular_distances(samples, eps, period), warn_when_not_sorted=False)
        return self._fit(distances, eps, min_samples, sample_weight, 'precomputed')

    def dbscan_plane(self, samples: FloatArray, eps: float, min_samples: int,
                     sample_weight: FloatArray | None = None) -> IntArray:
        """Cluster points ``(N, D)`` by their Euclidean distances."""
        return self._fit(samples, eps, min_samples, sample_weight, 'euclidean')

    def _fit(self, samples: Any, eps: float, min_samples: int, sample_weight: FloatArray | None,
             metric: str) -> IntArray:
        if not samples.shape[0]:
            return np.empty(0, dtype=int)
        found = self._dbscan(eps=eps, min_samples=min_samples, metric=metric).fit(samples, sample_weight=sample_weight)
        return np.asarray(found.labels_, dtype=int)


def circular_distances(angles: FloatArray, eps: float, period: float) -> Any:
    """Return the distances of all pairs at most `eps` apart on a circle of circumference `period`, sparse ``(N, N)``.

    A full table of 100 x 100 pairs of segments would take 800 MB.
    """
    on_circle = np.mod(angles, period)
    on_circle[on_circle >= period] = 0.0
    tree = cKDTree(on_circle[:, None], boxsize=period)
    return tree.sparse_distance_matrix(tree, eps, output_type='coo_matrix').tocsr()
