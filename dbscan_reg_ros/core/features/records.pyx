# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Segments and features of a scan."""
import math
from enum import IntEnum

import numpy as np

from ..geometry.se2 import wrap
from ..scan_geometry import read_only
from .oriented_points import leverage
from .returns import deskew
from .tables import build_free_space_profile, build_likelihood_field

from ..geometry.plane cimport vector
from .noise cimport TYPICAL
from .oriented_points cimport OrientedPoints, oriented_with_poles


class EndKind(IntEnum):
    """Kind of the end of a segment."""

    CORNER = KIND_CORNER
    """Two segments meet at this end: it is a fixed point of the environment."""
    FREE = KIND_FREE
    """The wall ends, and the next beams see farther: this end is a fixed point of the environment."""
    OCCLUSION = KIND_OCCLUSION
    """The next return is not farther, or there is none: often a nearer object hides the rest of the wall. This end
    moves with the sensor."""


cdef class Segments:
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

    def __init__(self, start, end, direction, length, sigma_direction, sigma_offset, kinds, beams):
        self.start, self.end, self.direction, self.length = start, end, direction, length
        self.sigma_direction, self.sigma_offset, self.kinds, self.beams = sigma_direction, sigma_offset, kinds, beams

    def __len__(self):
        return len(self.direction)

    def __repr__(self):
        lengths = f' of {self.length.min():.2f} to {self.length.max():.2f} m' if len(self) else ''
        return f'Segments({len(self)}{lengths})'

    def __reduce__(self):
        return Segments, (self.start, self.end, self.direction, self.length, self.sigma_direction, self.sigma_offset,
                          self.kinds, self.beams)

    @property
    def midpoint(self):
        """``(M, 2)`` midpoint of each segment [m]."""
        return 0.5 * (self.start + self.end)

    @property
    def fixed_ends(self):
        """``(E,)`` complex [m]: positions of the corners and free ends of the segments, each corner once."""
        cdef const double[:, :] start, end
        cdef const Py_ssize_t[:, :] kinds
        cdef double complex[::1] place
        cdef Py_ssize_t k, count = 0
        if self._fixed_ends is None:
            start, end, kinds = self.start, self.end, self.kinds
            place = places = np.empty(2 * kinds.shape[0], complex)
            for k in range(kinds.shape[0]):
                if kinds[k, 0] != KIND_OCCLUSION:
                    place[count] = vector(start[k, 0], start[k, 1])
                    count += 1
            for k in range(kinds.shape[0]):
                if kinds[k, 1] == KIND_FREE:
                    place[count] = vector(end[k, 0], end[k, 1])
                    count += 1
            self._fixed_ends = places[:count]
        return self._fixed_ends

    def reversed(self):
        """Return the segments with start and end exchanged."""
        return Segments(self.end, self.start, wrap(self.direction + math.pi), self.length, self.sigma_direction,
                        self.sigma_offset, self.kinds[:, ::-1], self.beams[:, ::-1])


cdef class Features:
    """Features of a scan, computed once.

    Attributes
    ----------
    measured : Scan
        The scan as it was measured.
    twist : (3,) float or None
        Velocity of the sensor [m/s, m/s, rad/s] with which the scan was deskewed; None: not deskewed.
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
        Points around small objects without normals, from `poles.find_poles`.
    weights : (Q,) float or None
        Weight of each point of `oriented_points`, from 0 to 1; None if the points keep their own weights.
    map_points : OrientedPoints or None
        Points of other scans that belong to `likelihood_field` as well.
    scattered : bool
        Whether the surfaces look different in each scan, as a hedge does: their normals constrain no motion along them.
    """

    def __init__(self, measured, points, beams, breaks, normals, Segments segments, double noise, density,
                 double noise_ratio, OrientedPoints poles=None, weights=None, OrientedPoints map_points=None,
                 twist=None, bint scattered=False):
        self.measured, self.twist = measured, twist
        self.points, self.beams = read_only(points), read_only(beams)
        self.breaks, self.normals = read_only(breaks), read_only(normals)
        self.segments, self.noise, self.density, self.noise_ratio = segments, noise, density, noise_ratio
        self.poles, self.weights, self.map_points, self.scattered = poles, weights, map_points, scattered

    def __repr__(self):
        return (f'Features({len(self.points)} points, {len(self.segments)} segments, noise {self.noise:.4f} m, '
                f'of {self.scan!r})')

    def __reduce__(self):
        return Features, (self.measured, self.points, self.beams, self.breaks, self.normals, self.segments, self.noise,
                          self.density, self.noise_ratio, self.poles, self.weights, self.map_points, self.twist,
                          self.scattered)

    cdef Features copied(self):
        """Return a copy, to be changed, with all that was made."""
        cdef Features copy = Features.__new__(Features)
        copy.measured, copy.twist, copy.points, copy.beams = self.measured, self.twist, self.points, self.beams
        copy.breaks, copy.normals, copy.segments, copy.noise = self.breaks, self.normals, self.segments, self.noise
        copy.density, copy.noise_ratio, copy.poles = self.density, self.noise_ratio, self.poles
        copy.weights, copy.map_points, copy.scattered = self.weights, self.map_points, self.scattered
        copy._wall_points, copy._oriented_points, copy._sampled_points = (
            self._wall_points, self._oriented_points, self._sampled_points)
        copy._scan, copy._leverage, copy._isolated = self._scan, self._leverage, self._isolated
        copy._free_space, copy._likelihood_field = self._free_space, self._likelihood_field
        return copy

    cdef Features with_points_of(self, normals, OrientedPoints poles, weights, double noise_ratio):
        """Return features with other `oriented_points`: what does not depend on them is not made again."""
        cdef Features other = self.copied()
        other.normals, other.poles, other.weights, other.noise_ratio = read_only(normals), poles, weights, noise_ratio
        other._wall_points = other._oriented_points = other._sampled_points = None
        other._leverage = other._likelihood_field = None
        return other

    def without(self, left_out):
        """Remove points of `oriented_points`: `left_out` ``(Q,)`` is a mask. Poles are removed as a whole."""
        cdef const unsigned char[:] removed = left_out
        normals, kept, weights = self.normals.copy(), ~left_out, self.weights
        cdef double[:, ::1] normal = normals
        cdef OrientedPoints poles = self.poles
        cdef Py_ssize_t k, wall = 0
        for k in range(normal.shape[0]):
            if normal[k, 0] != 0.0 or normal[k, 1] != 0.0:
                if removed[wall]:
                    normal[k, 0] = normal[k, 1] = 0.0
                wall += 1
        if poles is not None and left_out[wall:].any():
            kept[wall:] = (poles.beams[:, None] != poles.beams[left_out[wall:]]).all(axis=1)
            poles = poles.select(kept[wall:])
        weights = None if weights is None else read_only(weights[kept])
        return self.with_points_of(normals, poles, weights, self.noise_ratio)

    def downweighted(self, points, weights):
        """Multiply weights of the `oriented_points` that `points` (indices or a mask ``(Q,)``) selects by `weights`."""
        each = np.array(self.oriented().weights_view)
        each[points] *= weights
        return self.with_points_of(self.normals, self.poles, read_only(each), self.noise_ratio)

    def without_poles(self):
        """Remove the poles and `map_points`, and let all other points keep their own weights."""
        other = self.with_points_of(self.normals, None, None, self.noise_ratio)
        other.map_points = None
        return other

    def with_noise_ratio(self, double noise_ratio):
        """Give the points the noise of another ratio."""
        return self.with_points_of(self.normals, self.poles, self.weights, noise_ratio)

    def with_scattered_surfaces(self):
        """Return these features as `scattered` ones."""
        other = self.copied()
        other.scattered = True
        return other

    def with_map_points(self, OrientedPoints map_points):
        """Add points of other scans to the `likelihood_field`."""
        other = self.copied()
        other.map_points, other._likelihood_field = map_points, None
        return other

    @property
    def scan(self):
        """The scan, deskewed."""
        if self._scan is None:
            self._scan = self.measured if self.twist is None else deskew(self.measured, self.twist)
        return self._scan

    @property
    def wall_points(self):
        """The points that have a normal."""
        if self._wall_points is None:
            count = self.oriented().size - (0 if self.poles is None else self.poles.size)
            self._wall_points = self.oriented().first(count)
        return self._wall_points

    @property
    def oriented_points(self):
        """The `wall_points` followed by the `poles`, Q points in all, with weights and inverse noise scales."""
        return self.oriented()

    @property
    def sampled_points(self):
        """Points from which hypotheses are scored, evenly spaced along the scan."""
        return self.sampled()

    @property
    def leverage(self):
        """Weight of each of the `sampled_points` in a score; the weights sum to 1."""
        if self._leverage is None:
            self._leverage = leverage(self.sampled())
        return self._leverage

    @property
    def isolated(self):
        """Fraction of the points that lie on no surface with either neighbour, such as random ranges."""
        cdef const unsigned char[::1] broken = self.breaks
        cdef Py_ssize_t size = broken.shape[0], k, alone = 0
        if self._isolated is None:
            for k in range(size + 1):
                alone += (k == 0 or broken[k - 1]) and (k == size or broken[k])
            self._isolated = <double> alone / (size + 1)
        return self._isolated

    @property
    def likelihood_field(self):
        """Likelihood field with which other scans are compared when this scan is the reference."""
        if self._likelihood_field is None:
            oriented = self.oriented()
            if self.map_points is not None:
                oriented = oriented.joined(self.map_points)
            self._likelihood_field = build_likelihood_field(oriented, self.density)
        return self._likelihood_field

    @property
    def free_space(self):
        """Free-space profile of this scan."""
        if self._free_space is None:
            self._free_space = build_free_space_profile(self.points, self.measured.geometry.angle_increment)
        return self._free_space

    cdef OrientedPoints sampled(self):
        """Return the `sampled_points`."""
        if self._sampled_points is None:
            self._sampled_points = self.oriented().thinned(self.density.max_points)
        return self._sampled_points

    cdef OrientedPoints oriented(self):
        """Return the `oriented_points`."""
        if self._oriented_points is None:
            self._oriented_points = oriented_with_poles(self.points, self.normals, self.beams, self.poles, self.weights,
                                                        self.noise_ratio / TYPICAL)
        return self._oriented_points
