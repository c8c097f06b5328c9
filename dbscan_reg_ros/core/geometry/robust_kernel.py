# SPDX-License-Identifier: Apache-2.0
"""The robust kernel that weighs the errors of every alignment."""
import numpy as np

from .array_types import FloatArray


def kernel(error: FloatArray, scale: float) -> FloatArray:
    """Gaussian kernel (Eq. 18) of errors [m] with a `scale` [m]; 1 for an error of 0."""
    weight: FloatArray = error * error
    weight *= -0.5 / (scale * scale)
    return np.exp(weight, out=weight)
