# SPDX-License-Identifier: Apache-2.0
"""Records of the features of a scan: segments, points, likelihood field and free-space profile."""
import dataclasses
import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import as_complex, wrap
from ..parameters.registration import DensityParameters
from ..scan import Scan
from .free_space import FreeSpaceProfile
from .likelihood_field import LikelihoodField
from .noise import TYPICAL_NOISE
from .oriented_points import OrientedPoints
from .points import build_oriented_points, leverage
from .tables import build_free_space_profile, build_likelihood_field


class EndKind(IntEnum):
    """Kind of the end of a segment."""

    CORNER = 0
    """Two segments meet at this end: it is a fixed point of the environment."""
    FREE = 1
    """The wall ends, and the next beams see farther: this end is a fixed point of the environment."""
    OCCLUSION = 2
    """The next return is not farther, or there is none: often a nearer object hides the rest of the wall. This end
    moves with the sensor."""


@dataclass(frozen=True, eq=False)
class Segments:
    """The M line segments of one scan in beam order, as a structure of arrays.

    Attributes
    ----------
    start, end : (M, 2) float [m]
        End points on the fitted line, counter-clockwise as seen from the sensor: segments are directed, and the sensor
        lies on their left.
    direction : (M,) float [rad]
        Angle of the line from start to end, in [-pi, pi).
    length : (M,) float [m]
    sigma_direction : (M,) float [rad]
        Standard deviation of the direction.
    sigma_offset : (M,) float [m]
        Standard deviation of the line's distance from its midpoint.
    kinds : (M, 2) int
        `EndKind` of start and end.
    beams : (M, 2) int
        Beams at start and end of each segment.
    """

    start: FloatArray
    end: FloatArray
    direction: FloatArray
    length: FloatArray
    sigma_direction: FloatArray
    sigma_offset: FloatArray
    kinds: IntArray
    beams: IntArray

    def __len__(self) -> int:
        return len(self.direction)

    def __repr__(self) -> str:
        lengths = f' of {self.length.min():.2f} to {self.length.max():.2f} m' if len(self) else ''
        return f'Segments({len(self)}{lengths})'

    @property
    def midpoint(self) -> FloatArray:
        """``(M, 2)`` midpoint of each segment [m]."""
        return 0.5 * (self.start + self.end)

    @cached_property
    def fixed_ends(self) -> ComplexArray:
        """``(E,)`` complex [m]: positions of the corners and free ends of the segments, each corner once."""
        starts, ends = self.kinds.T
        places: ComplexArray = np.concatenate((as_complex(self.start)[starts != EndKind.OCCLUSION],
                                               as_complex(self.end)[ends == EndKind.FREE]))
        return places

    def reversed(self) -> 'Segments':
        """Return the segments with start and end exchanged."""
        return dataclasses.replace(self, start=self.end, end=self.start, direction=wrap(self.direction + math.pi),
                                   kinds=self.kinds[:, ::-1], beams=self.beams[:, ::-1])


@dataclass(frozen=True, eq=False)
class Features:
    """Features of a scan, computed once.

    Attributes
    ----------
    scan : Scan
    points : (P, 2) float [m]
        Filtered points in the frame of the sensor, in beam order.
    beams : (P,) int
        Beam of each point.
    breaks : (P - 1,) bool
        True where a point and the next lie on different surfaces (Eq. 5).
    normals : (P, 2) float
        Unit normals that face the sensor; zero for points without one.
    segments : Segments
    noise : float [m]
        Standard deviation of a range, as estimated from the filtered points of this scan.
    density : DensityParameters
    noise_ratio : float
        Standard deviation of a range as a fraction of the range; 0 where far ranges are not noisier than near ones.
    poles : OrientedPoints or None
        Points around small objects without normals, from `poles.with_poles`.
    weights : (Q,) float or None
        Weight of each point of `oriented_points`, from 0 to 1; None if the points keep their own weights.
    map_points : OrientedPoints or None
        Points of other scans that belong to `likelihood_field` as well.
    """

    scan: Scan
    points: FloatArray
    beams: IntArray
    breaks: BoolArray
    normals: FloatArray
    segments: Segments
    noise: float
    density: DensityParameters
    noise_ratio: float
    poles: OrientedPoints | None = None
    weights: FloatArray | None = None
    map_points: OrientedPoints | None = None

    def __repr__(self) -> str:
        return (f'Features({len(self.points)} points, {len(self.segments)} segments, noise {self.noise:.4f} m, '
                f'of {self.scan!r})')

    def without(self, left_out: BoolArray) -> 'Features':
        """Remove points of `oriented_points`: `left_out` ``(Q,)`` is a mask. Poles are removed as a whole."""
        walls, normals = len(self.wall_points), self.normals.copy()
        normals[as_complex(normals).nonzero()[0][left_out[:walls]]] = 0.0
        poles = self.poles
        if poles and left_out[walls:].any():
            poles = poles.select((poles.beams[:, None] != poles.beams[left_out[walls:]]).all(axis=1))
        return dataclasses.replace(self, normals=normals, poles=poles)

    def downweighted(self, points: IntArray | BoolArray, weights: FloatArray | float) -> 'Features':
        """Multiply weights of the `oriented_points` selected by `points`, indices or a mask, by `weights`."""
        each = self.oriented_points.weighted(np.ones(len(self.oriented_points)))
        each[points] *= weights
        return dataclasses.replace(self, weights=each)

    @cached_property
    def wall_points(self) -> OrientedPoints:
        """The points that have a normal."""
        return build_oriented_points(self.points, self.normals, self.beams)

    @cached_property
    def oriented_points(self) -> OrientedPoints:
        """The `wall_points` followed by the `poles`, Q points in all, with weights and inverse noise scales."""
        oriented = self.wall_points.joined(self.poles) if self.poles else self.wall_points
        weights, inverse_noise = oriented.weights if self.weights is None else self.weights, None
        if self.noise_ratio:
            noise_scale = self.noise_ratio / TYPICAL_NOISE * np.abs(oriented.points)
            inverse_noise = 1.0 / np.maximum(noise_scale, 1.0) if (noise_scale > 1.0).any() else None
        return OrientedPoints(oriented.points, oriented.normals, oriented.beams, weights, inverse_noise)

    @cached_property
    def sampled_points(self) -> OrientedPoints:
        """Points from which hypotheses are scored, evenly spaced along the scan."""
        return self.oriented_points.thinned(self.density.max_points)

    @cached_property
    def leverage(self) -> FloatArray:
        """Weight of each of the `sampled_points` in a score; the weights sum to 1."""
        return leverage(self.sampled_points, self.density.leverage_ridge)

    @cached_property
    def isolated(self) -> float:
        """Fraction of the points that lie on no surface with either neighbour, such as random ranges."""
        edge = np.concatenate(([True], self.breaks, [True]))
        return float(np.mean(edge[1:] & edge[:-1]))

    @cached_property
    def likelihood_field(self) -> LikelihoodField:
        """Likelihood field with which other scans are compared when this scan is the reference."""
        oriented = self.oriented_points
        oriented = oriented.joined(self.map_points) if self.map_points else oriented
        return build_likelihood_field(oriented, self.density)

    @cached_property
    def free_space(self) -> FreeSpaceProfile:
        """Free-space profile of this scan."""
        return build_free_space_profile(self.points, self.scan.geometry.angle_increment)
