# SPDX-License-Identifier: Apache-2.0
"""Small objects of a scan."""
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import moduli
from ..geometry.tolerance import TINY


class SmallObjects(NamedTuple):
    """The T small objects of a scan.

    Attributes
    ----------
    beam : (T,) int
        First beam with a return from each object.
    returns : (T,) int
        Number of returns from each object.
    nearest : (T,) float [m]
        Smallest range of each object.
    front : (T,) complex [m]
        Midpoint of the first and the last point of each object.
    width : (T,) float [m]
        Width of each object: the width covered by `returns` beams at the distance of `front`.
    without_normals : (T,) bool
        Whether no point of the object has a normal.
    """

    beam: IntArray
    returns: IntArray
    nearest: FloatArray
    front: ComplexArray
    width: FloatArray
    without_normals: BoolArray

    @property
    def middle(self) -> ComplexArray:
        """``(T,)`` complex [m]: centre of each object, under the assumption that it is round."""
        return self.front * ((self.nearest + 0.5 * self.width) / np.maximum(moduli(self.front), TINY))
