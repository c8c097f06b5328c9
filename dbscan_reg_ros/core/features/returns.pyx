# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Returns of a scan that the parameters admit, with their noise."""
import numpy as np

from ..errors import ScanError
from ..scan import MAX_RANGE

from libc.math cimport INFINITY, NAN

from ..geometry.plane cimport vector
from .noise cimport estimate_noise, estimate_noise_ratio


cdef class Returns:
    """The admitted returns of a scan.

    Parameters
    ----------
    scan : Scan
    limits : ScanParameters
        A return lies between its `range_min` and `range_max`, and within the limits of the scan.

    Attributes
    ----------
    points : (N, 2) float [m]
        Points in the frame of the sensor, one for each beam; not finite without an admitted return.
    noise : float
        Standard deviation of a range [m].
    """

    def __init__(self, scan, limits):
        geometry = scan.geometry
        cdef const float[::1] ranges = scan.ranges
        cdef const double[:, ::1] directions = geometry.directions
        cdef Py_ssize_t size = ranges.shape[0], k
        self.scan, self.limits = scan, limits
        self.places = np.empty(size, complex)
        cdef double complex[::1] place = self.places
        cdef double[::1] found = np.empty(size)
        cdef Py_ssize_t[::1] beam = np.empty(size, np.intp)
        # Single precision, as the ranges.
        cdef float least = max(geometry.range_min, limits.range_min), limit = min(geometry.range_max, MAX_RANGE)
        cdef float most = limits.range_max or INFINITY
        with nogil:
            for k in range(size):
                place[k] = vector(NAN, NAN)
                if ranges[k] > 0.0 and least <= ranges[k] < limit and ranges[k] <= most:
                    place[k] = vector(ranges[k] * directions[k, 0], ranges[k] * directions[k, 1])
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
    def valid(self):
        """``(N,)`` bool: beams with an admitted return."""
        return np.isfinite(self.places.real)

    @property
    def noise_ratio(self):
        """Standard deviation of a range as a fraction of the range; 0 if far ranges are no noisier than near ones."""
        cdef const double complex[::1] place = self.places
        cdef double complex[::1] known = np.empty(self.count, complex)
        cdef Py_ssize_t k
        for k in range(self.count):
            known[k] = place[self.beams[k]]
        return estimate_noise_ratio(known, self.ranges, self.beams, self.limits)
