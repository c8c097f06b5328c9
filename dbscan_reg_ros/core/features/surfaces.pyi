# SPDX-License-Identifier: Apache-2.0
"""Surfaces of a scan: points in beam order, cut at breakpoints (Eq. 5), and their normals."""
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..parameters.features import SegmentParameters

def find_breaks(
    points: ComplexArray, beams: IntArray, increment: float, noise: float, parameters: SegmentParameters
) -> BoolArray: ...
def estimate_normals(
    points: ComplexArray, breaks: BoolArray, increment: float, noise: FloatArray, parameters: SegmentParameters
) -> ComplexArray: ...
