# SPDX-License-Identifier: Apache-2.0
"""Records of the features of a scan."""
import dataclasses
import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from ..geometry.se2 import wrap
from ..parameters.registration import DensityParameters
from ..scan import Scan
from .free_space import build_free_space_profile
from .likelihood_field import build_likelihood_field
from .oriented_points import OrientedPoints, build_oriented_points, leverage
from .range_noise import TYPICAL_NOISE


class EndKind(IntEnum):
    """What ends a segment."""

    CORNER = 0
    """Another segment starts there: a true point of the world."""
    FREE = 1
    """The wall ends there and the beams beyond it see farther: a true point of the world."""
    OCCLUSION = 2
    """Something nearer hides the rest, or the view ends: the point moves with the sensor."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Line segments of one scan as a structure of arrays, in beam order, M of them.

    Attributes
    ----------
    start, end : (M, 2) float [m]
        End points on the fitted line, counter-clockwise as the sensor sees them, so that a segment is directed and the
        sensor always lies on its left.
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
        Beams at start and end.
    """

    start: np.ndarray
    end: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    sigma_direction: np.ndarray
    sigma_offset: np.ndarray
    kinds: np.ndarray
    beams: np.ndarray

    def __len__(self):
        return len(self.direction)

    def __repr__(self) -> str:
        lengths = f' of {self.length.min():.2f} to {self.length.max():.2f} m' if len(self) else ''
        return f'Segments({len(self)}{lengths})'

    @property
    def midpoint(self):
        """(M, 2) [m]"""
        return 0.5 * (self.start + self.end)

    def reversed(self):
        """The same, each from its end to its start."""
        return dataclasses.replace(self, start=self.end, end=self.start, direction=wrap(self.direction + math.pi),
                                   kinds=self.kinds[:, ::-1], beams=self.beams[:, ::-1])


@dataclass(frozen=True, eq=False)
class Features:
    """What is kept of a scan, computed once.

    Attributes
    ----------
    scan : Scan
    points : (P, 2) float [m]
        Filtered points in the sensor's frame, in beam order.
    beams : (P,) int
        The beam of each point.
    normals : (P, 2) float
        Unit normals that face the sensor; zero where the surroundings have no direction.
    segments : Segments
    noise : float [m]
        Standard deviation of a range, as estimated from what the filter left of this scan.
    noise_share : float
        The same as a share of the range, where far ranges are noisier than near ones.
    posts : Cloud or None
        What small things without normals count as, from `poles.with_poles`.
    walls : Cloud
        The points that have a normal.
    dense_cloud : Cloud
        `wall_points`, and then the `poles`.
    cloud : Cloud
        Some of them, evenly along the scan: those that hypotheses are compared by.
    leverage : (P,) float
        Weight of each point of `sampled_points` in a comparison.
    surface : Surface
        The density of this scan as a reference; made when first asked for, like `free_space`.
    view : View
        How far this scan saw.
    worth : (P',) float or None
        What each point of `oriented_points` counts, from 0 to 1; None: all the same.
    around : Cloud or None
        Points of other scans that belong to `likelihood_field` as well.
    """

    scan: Scan
    points: np.ndarray
    beams: np.ndarray
    normals: np.ndarray
    segments: Segments
    noise: float
    density: DensityParameters
    noise_ratio: float = 0.0
    poles: OrientedPoints | None = None
    weights: np.ndarray | None = None
    map_points: OrientedPoints | None = None

    def __repr__(self) -> str:
        return f'Features({len(self.points)} points, {len(self.segments)} segments, noise {self.noise:.4f} m, of {self.scan!r})'

    def without(self, left_out):
        """The same, without the normals of those points of `oriented_points` that `left_out`, a mask, picks; posts go as a whole."""
        walls, normals = len(self.wall_points), self.normals.copy()
        normals[np.flatnonzero(normals.any(axis=1))[left_out[:walls]]] = 0.0
        poles = self.poles and self.poles.select(~np.isin(self.poles.beams, self.poles.beams[left_out[walls:]]))
        return dataclasses.replace(self, normals=normals, poles=poles)

    def downweighted(self, points, weights):
        """The same, but those points of `oriented_points` that `points`, a mask or indices, picks count `weights`."""
        each = self.oriented_points.weighted(np.ones(len(self.oriented_points)))
        each[points] *= weights
        return dataclasses.replace(self, weights=each)

    @cached_property
    def wall_points(self):
        return build_oriented_points(self.points, self.normals, self.beams)

    @cached_property
    def oriented_points(self):
        cloud = self.wall_points.joined(self.poles) if self.poles else self.wall_points
        # Errors of points that are noisier than usual are measured in units of their noise.
        times = self.noise_ratio / TYPICAL_NOISE * np.abs(cloud.points)
        inverse_noise = 1.0 / np.maximum(times, 1.0) if (times > 1.0).any() else None
        weights = cloud.weights if self.weights is None else self.weights
        return dataclasses.replace(cloud, weights=weights, inverse_noise=inverse_noise)

    @cached_property
    def sampled_points(self):
        return self.oriented_points.thinned(self.density.max_points)

    @cached_property
    def leverage(self):
        return leverage(self.sampled_points, self.density.leverage_ridge)

    @cached_property
    def likelihood_field(self):
        return build_likelihood_field(self.oriented_points.joined(self.map_points) if self.map_points else self.oriented_points, self.density)

    @cached_property
    def free_space(self):
        return build_free_space_profile(self.points, self.scan.geometry.angle_increment)
