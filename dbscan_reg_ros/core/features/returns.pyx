# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Returns of a scan that the parameters admit, with their noise."""
import numpy as np

from ..errors import ScanError
from ..scan import MAX_RANGE, Scan

from libc.math cimport INFINITY, NAN, cos, isfinite, sin

from ..geometry.plane cimport rotated, vector
from .noise cimport estimate_noise, estimate_noise_ratio


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
        self.places = deskewed_points(scan, twist)  # Eq. 2
        cdef double complex[::1] place = self.places
        cdef double[::1] found = np.empty(size)
        cdef Py_ssize_t[::1] beam = np.empty(size, np.intp)
        # Single precision, as the ranges.
        cdef float least = limits.range_min, most = limits.range_max or INFINITY
        with nogil:
            for k in range(size):
                if not least <= ranges[k] <= most:
                    place[k] = vector(NAN, NAN)
                elif isfinite(place[k].real):
                    found[self.count], beam[self.count] = ranges[k], k
                    self.count += 1
        if self.count < limits.min_returns:
            raise ScanError(f'{self.count} of {size} beams have a return; advanced.scan.min_returns asks for '
                            f'{limits.min_returns}')
        self.ranges, self.beams = found[:self.count], beam[:self.count]
        self.noise = estimate_noise(self.ranges, limits)

    @property
    def points(self):
        return self.places.view(float).reshape(-1, 2)

    @property
    def noise_ratio(self):
        """Standard deviation of a range as a fraction of the range; 0 if far ranges are no noisier than near ones."""
        cdef const double complex[::1] place = self.places
        cdef double complex[::1] known = np.empty(self.count, complex)
        cdef Py_ssize_t k
        for k in range(self.count):
            known[k] = place[self.beams[k]]
        return estimate_noise_ratio(known, self.ranges, self.beams, self.limits)


cdef deskewed_points(scan, twist):
    """Return ``(N,)`` complex: the point of each beam [m], seen from the pose of the sensor at the stamp (Eq. 2).

    Beam i is measured at ``t = i * time_increment`` after the stamp; its point p becomes ``Rot(omega t) p + (vx, vy) t``.
    A beam without a return becomes nan.
    """
    geometry = scan.geometry
    cdef const float[::1] ranges = scan.ranges
    cdef const double[:, ::1] directions = geometry.directions
    cdef double increment = scan.time_increment, vx = 0.0, vy = 0.0, omega = 0.0
    if twist is not None:
        vx, vy, omega = twist
    cdef bint moves = increment != 0.0 and (vx != 0.0 or vy != 0.0 or omega != 0.0)
    # One beam turns by this more than the one before.
    cdef double complex turn = 1.0, step = vector(cos(omega * increment), sin(omega * increment))
    # Single precision, as the ranges.
    cdef float least = geometry.range_min, limit = min(geometry.range_max, MAX_RANGE)
    cdef Py_ssize_t k
    places = np.empty(ranges.shape[0], complex)
    cdef double complex[::1] place = places
    with nogil:
        for k in range(ranges.shape[0]):
            place[k] = vector(NAN, NAN)
            if ranges[k] > 0.0 and least <= ranges[k] < limit:
                place[k] = vector(ranges[k] * directions[k, 0], ranges[k] * directions[k, 1])
                if moves:
                    place[k] = rotated(turn, place[k]) + vector(vx * increment * k, vy * increment * k)
            if moves:
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
    points = deskewed_points(scan, twist).view(float).reshape(-1, 2)
    return Scan.from_points(points, scan.stamp, scan.frame_id, scan.geometry.angle_increment)
