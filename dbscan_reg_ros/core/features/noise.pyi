# SPDX-License-Identifier: Apache-2.0
"""Noise of the ranges of a scan, and how it grows with the range."""
from ..geometry.array_types import ComplexArray, FloatArray, IntArray
from ..parameters.features import ScanParameters

def estimate_noise(ranges: FloatArray, limits: ScanParameters) -> float: ...
def estimate_noise_ratio(
    points: ComplexArray, ranges: FloatArray, beams: IntArray, limits: ScanParameters
) -> float: ...
def range_noise(radius: FloatArray, noise: float, ratio: float) -> FloatArray: ...
