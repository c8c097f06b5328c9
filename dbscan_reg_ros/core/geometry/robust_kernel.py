# SPDX-License-Identifier: Apache-2.0
"""The Gaussian kernel (Eq. 18) for arrays; compiled steps have it inline."""
import numpy as np

from .array_types import FloatArray


def kernel(error: FloatArray, scale: float) -> FloatArray:
    """Return the weight of each `error` [m] from a Gaussian kernel (Eq. 18) of this `scale` [m]; 1 for error 0."""
    weight: FloatArray = error * error
    weight *= -0.5 / (scale * scale)
    return np.exp(weight, out=weight)
