# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Returns of a scan that the parameters admit, with their noise."""
from dataclasses import replace

import numpy as np

from ..errors import ScanError
from ..scan import MAX_RANGE, Scan

from libc.math cimport INFINITY, NAN, cos, isfinite, sin

from ..geometry.plane cimport rotated, vector
from .noise cimport noise_of, noise_ratio_of


cdef class Returns:
    """The admitted returns of a scan.

    Parameters
    ----------
    scan : Scan
    limits : ScanParameters
        A return lies between its `range_min` and `range_max`, and within the limits of the scan.
    twist : (3,) float, optional
        Velocity (vx, vy, omega) of the sensor in its own frame [m/s, m/s, rad/s], with which the scan is deskewed.

    Attributes
    ----------
    points : (N, 2) float [m]
        Points in the frame of the sensor at the stamp of the scan, one for each beam; not finite without an admitted
        return.
    noise : float
        Standard deviation of a range [m].
    """

    def __init__(self, scan, limits, twist=None):
        cdef const float[::1] ranges = scan.ranges
        cdef Py_ssize_t size = ranges.shape[0], k
        self.scan, self.limits, self.twist = scan, limits, twist
        self.place = deskewed_points(scan, twist)  # Eq. 2
        cdef double *x = &self.place[0, 0]
        cdef double *y = &self.place[1, 0]
        cdef double *radius = &self.place[2, 0]
        cdef double[:, ::1] work = np.empty((2, size))
        # Single precision, as the ranges.
        cdef float least = limits.range_min, most = limits.range_max or INFINITY
        for k in range(size):
            radius[k] = ranges[k]
            if not least <= ranges[k] <= most:
                x[k] = y[k] = NAN
            work[0, self.count] = radius[k]
            self.count += isfinite(x[k])
        if self.count < limits.min_returns:
            raise ScanError(f'{self.count} of {size} beams have a return; advanced.scan.min_returns asks for '
                            f'{limits.min_returns}')
        self.noise = noise_of(&work[0, 0], self.count, limits, &work[1, 0])

    @property
    def points(self):
        return np.stack(self.place[:2], axis=1)

    @property
    def noise_ratio(self):
        """Standard deviation of a range as a fraction of the range; 0 if far ranges are no noisier than near ones."""
        return noise_ratio_of(&self.place[0, 0], &self.place[1, 0], &self.place[2, 0], self.place.shape[1], self.limits)


cdef deskewed_points(scan, twist):
    """Return ``(3, N)``: x and y of the point of each beam [m], seen from the pose of the sensor at the stamp (Eq. 2).

    Beam i is measured at ``t = i * time_increment`` after the stamp; its point p becomes ``Rot(omega t) p + (vx, vy) t``.
    A beam without a return becomes nan. The last row is not set.
    """
    geometry = scan.geometry
    cdef const float[::1] ranges = scan.ranges
    cdef const double[:, ::1] directions = geometry.directions
    cdef double increment = scan.time_increment, vx = 0.0, vy = 0.0, omega = 0.0, along, across
    if twist is not None:
        vx, vy, omega = twist
    cdef bint moves = increment != 0.0 and (vx != 0.0 or vy != 0.0 or omega != 0.0)
    # One beam turns by this more than the one before.
    cdef double complex turn = 1.0, step = vector(cos(omega * increment), sin(omega * increment))
    # Single precision, as the ranges.
    cdef float least = geometry.range_min, limit = min(geometry.range_max, MAX_RANGE)
    cdef Py_ssize_t size = ranges.shape[0], k
    places = np.empty((3, size))
    cdef double[:, ::1] place = places
    cdef double *x = &place[0, 0]
    cdef double *y = &place[1, 0]
    if directions.shape[0] != size:
        raise IndexError('directions of another number of beams')
    for k in range(size):
        x[k], y[k] = ranges[k] * directions[k, 0], ranges[k] * directions[k, 1]
        if not (ranges[k] > 0.0 and least <= ranges[k] < limit):
            x[k] = y[k] = NAN
    if moves:
        for k in range(size):
            along, across = x[k], y[k]
            x[k] = turn.real * along - turn.imag * across + vx * increment * k
            y[k] = turn.real * across + turn.imag * along + vy * increment * k
            turn = rotated(turn, step)
    return places


def deskew(scan, twist):
    """Transform every beam to what the sensor would have measured at the stamp of the scan.

    Parameters
    ----------
    scan : Scan
        Beam i was measured ``i * time_increment`` [s] after the stamp.
    twist : (3,) float
        Velocity (vx, vy, omega) of the sensor in its own frame [m/s, m/s, rad/s].

    Returns
    -------
    Scan
        The deskewed scan, with one bearing per beam; `scan` itself if the twist or its `time_increment` is 0.
    """
    if scan.time_increment == 0.0 or not np.any(twist) or not scan.valid.any():
        return scan
    points = deskewed_points(scan, twist)[:2].T
    made = Scan.from_points(points, stamp=scan.stamp, angle_increment=scan.geometry.angle_increment)
    return replace(made, frame_id=scan.frame_id)
