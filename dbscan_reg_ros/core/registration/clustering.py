# SPDX-License-Identifier: Apache-2.0
"""Implementations of DBSCAN behind one interface, chosen by a parameter."""
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from . import dbscan


class Clustering(Protocol):
    """An implementation of DBSCAN.

    Both methods return the cluster of each sample as ``(N,) int``, numbered by the first core sample of each, and -1 for
    noise. A border sample belongs to the first of the clusters that reach it.
    """

    def dbscan_line(self, samples: NDArray[np.float64], eps: float, min_samples: int,
                    sample_weight: NDArray[np.float64] | None = None,
                    period: float | None = None) -> NDArray[np.int_]:
        """Cluster numbers ``(N,)``, on a circle of circumference `period` where one is given."""
        ...

    def dbscan_plane(self, samples: NDArray[np.float64], eps: float, min_samples: int,
                     sample_weight: NDArray[np.float64] | None = None) -> NDArray[np.int_]:
        """Cluster points ``(N, D)`` by their Euclidean distances."""
        ...


def choose_clustering(name: str) -> Clustering:
    """Return the implementation that the parameter ``clustering`` names; scikit-learn is imported only when it is chosen.

    Raises
    ------
    ParameterError
        When scikit-learn is chosen and not installed.
    """
    if name == 'scikit_learn':
        from .paper.scikit_learn_dbscan import ScikitLearnClustering
        return ScikitLearnClustering()
    return dbscan
