# SPDX-License-Identifier: Apache-2.0
"""Surfaces of a scan: points in beam order, cut at breakpoints (Eq. 5), and their normals."""
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..parameters.features import SegmentParameters
from .oriented_points import PointSequence

def point_sequence(
    points: ComplexArray, beams: IntArray, increment: float, noise: float, parameters: SegmentParameters
) -> PointSequence: ...
def find_breaks(
    points: ComplexArray, beams: IntArray, increment: float, noise: float, parameters: SegmentParameters
) -> BoolArray: ...
def estimate_normals(sequence: PointSequence, noise: FloatArray, parameters: SegmentParameters) -> ComplexArray: ...
