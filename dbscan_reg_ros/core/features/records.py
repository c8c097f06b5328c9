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
from .free_space import build_view
from .likelihood_field import build_surface
from .oriented_points import Cloud, build_cloud, leverage
from .range_noise import USUAL_NOISE


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
        What small things without normals count as, from `posts.with_posts`.
    walls : Cloud
        The points that have a normal.
    dense_cloud : Cloud
        `walls`, and then the `posts`.
    cloud : Cloud
        Some of them, evenly along the scan: those that hypotheses are compared by.
    leverage : (P,) float
        Weight of each point of `cloud` in a comparison.
    surface : Surface
        The density of this scan as a reference; made when first asked for, like `view`.
    view : View
        How far this scan saw.
    worth : (P',) float or None
        What each point of `dense_cloud` counts, from 0 to 1; None: all the same.
    around : Cloud or None
        Points of other scans that belong to `surface` as well.
    """

    scan: Scan
    points: np.ndarray
    beams: np.ndarray
    normals: np.ndarray
    segments: Segments
    noise: float
    density: DensityParameters
    noise_share: float = 0.0
    posts: Cloud | None = None
    worth: np.ndarray | None = None
    around: Cloud | None = None

    def without(self, left_out):
        """The same, without the normals of those points of `dense_cloud` that `left_out`, a mask, picks; posts go as a whole."""
        walls, normals = len(self.walls), self.normals.copy()
        normals[np.flatnonzero(normals.any(axis=1))[left_out[:walls]]] = 0.0
        posts = self.posts and self.posts.select(~np.isin(self.posts.beams, self.posts.beams[left_out[walls:]]))
        return dataclasses.replace(self, normals=normals, posts=posts)

    def doubting(self, points, worth):
        """The same, but those points of `dense_cloud` that `points`, a mask or indices, picks count `worth`."""
        each = self.dense_cloud.weighed(np.ones(len(self.dense_cloud)))
        each[points] *= worth
        return dataclasses.replace(self, worth=each)

    @cached_property
    def walls(self):
        return build_cloud(self.points, self.normals, self.beams)

    @cached_property
    def dense_cloud(self):
        cloud = self.walls.joined(self.posts) if self.posts else self.walls
        # Errors of points that are noisier than usual are measured in units of their noise.
        times = self.noise_share / USUAL_NOISE * np.abs(cloud.points)
        sharpness = 1.0 / np.maximum(times, 1.0) if (times > 1.0).any() else None
        worth = cloud.worth if self.worth is None else self.worth
        return dataclasses.replace(cloud, worth=worth, sharpness=sharpness)

    @cached_property
    def cloud(self):
        return self.dense_cloud.thinned(self.density.points)

    @cached_property
    def leverage(self):
        return leverage(self.cloud, self.density.balance)

    @cached_property
    def surface(self):
        return build_surface(self.dense_cloud.joined(self.around) if self.around else self.dense_cloud, self.density)

    @cached_property
    def view(self):
        return build_view(self.points, self.scan.geometry.angle_increment)
