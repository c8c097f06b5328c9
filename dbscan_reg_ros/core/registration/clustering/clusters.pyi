# SPDX-License-Identifier: Apache-2.0
"""Clusters of translations by DBSCAN (Ester et al., KDD 1996): components of the core samples, and their borders."""
from ...geometry.array_types import ComplexArray, IntArray

def dbscan_plane(samples: ComplexArray, eps: float, min_samples: int) -> IntArray: ...
