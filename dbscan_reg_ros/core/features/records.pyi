# SPDX-License-Identifier: Apache-2.0
"""Segments and features of a scan."""
from enum import IntEnum

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..parameters.registration import DensityParameters
from ..scan import Scan
from .free_space import FreeSpaceProfile
from .likelihood_field import LikelihoodField
from .oriented_points import OrientedPoints

class EndKind(IntEnum):
    CORNER = 0
    FREE = 1
    OCCLUSION = 2

class Segments:
    start: FloatArray
    end: FloatArray
    direction: FloatArray
    length: FloatArray
    sigma_direction: FloatArray
    sigma_offset: FloatArray
    kinds: IntArray
    beams: IntArray

    def __init__(
        self,
        start: FloatArray,
        end: FloatArray,
        direction: FloatArray,
        length: FloatArray,
        sigma_direction: FloatArray,
        sigma_offset: FloatArray,
        kinds: IntArray,
        beams: IntArray,
    ) -> None: ...
    def __len__(self) -> int: ...
    @property
    def midpoint(self) -> FloatArray: ...
    @property
    def fixed_ends(self) -> ComplexArray: ...
    def reversed(self) -> Segments: ...

class Features:
    measured: Scan
    twist: FloatArray | None
    points: FloatArray
    beams: IntArray
    breaks: BoolArray
    normals: FloatArray
    segments: Segments
    noise: float
    density: DensityParameters
    noise_ratio: float
    poles: OrientedPoints | None
    weights: FloatArray | None
    map_points: OrientedPoints | None
    scattered: bool

    def __init__(
        self,
        measured: Scan,
        points: FloatArray,
        beams: IntArray,
        breaks: BoolArray,
        normals: FloatArray,
        segments: Segments,
        noise: float,
        density: DensityParameters,
        noise_ratio: float,
        poles: OrientedPoints | None = None,
        weights: FloatArray | None = None,
        map_points: OrientedPoints | None = None,
        twist: FloatArray | None = None,
        scattered: bool = False,
    ) -> None: ...
    def without(self, left_out: BoolArray) -> Features: ...
    def downweighted(self, points: IntArray | BoolArray, weights: FloatArray | float) -> Features: ...
    def without_poles(self) -> Features: ...
    def with_noise_ratio(self, noise_ratio: float) -> Features: ...
    def with_scattered_surfaces(self) -> Features: ...
    def with_map_points(self, map_points: OrientedPoints) -> Features: ...
    @property
    def scan(self) -> Scan: ...
    @property
    def wall_points(self) -> OrientedPoints: ...
    @property
    def oriented_points(self) -> OrientedPoints: ...
    @property
    def sampled_points(self) -> OrientedPoints: ...
    @property
    def leverage(self) -> FloatArray: ...
    @property
    def isolated(self) -> float: ...
    @property
    def likelihood_field(self) -> LikelihoodField: ...
    @property
    def free_space(self) -> FreeSpaceProfile: ...
