# SPDX-License-Identifier: Apache-2.0
"""The robust kernel that weighs errors in every alignment."""
import numpy as np


def kernel(error, scale):
    """Gaussian kernel of the `scale` [m] of distances [m] (Eq. 18), 1 at 0."""
    weight = error * error
    weight *= -0.5 / (scale * scale)
    return np.exp(weight, out=weight)
