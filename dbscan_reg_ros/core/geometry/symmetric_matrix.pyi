# SPDX-License-Identifier: Apache-2.0
"""Types of the symmetric 3 x 3 matrices."""
from collections.abc import Iterable

from .array_types import FloatArray

IDENTITY: FloatArray

def inverse(matrix: FloatArray) -> FloatArray: ...
def mahalanobis(error: Iterable[float], covariance: FloatArray) -> float: ...
def diagonal(x: float, y: float, t: float) -> FloatArray: ...
