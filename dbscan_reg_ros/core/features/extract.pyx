# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Features of a scan whose returns are selected (sections 2.1 and 2.2)."""
import numpy as np

from ..errors import ScanError
from .noise import estimate_noise, range_noise
from .records import Features
from .ring_band import ring_band_filter
from .segments import extract_segments
from .surfaces import estimate_normals, point_sequence

from libc.math cimport isfinite

from ..geometry.plane cimport length_of


def extract_from_returns(returns, parameters, noise_ratio=None):
    """Extract the features of a scan whose returns are selected already; as `extract_features`."""
    limits, scan = parameters.scan, returns.scan
    cdef double noise = returns.noise, left = noise
    filtered, _ = ring_band_filter(returns.points, noise, parameters.filter)
    points, positions, radii, beams = finite_points(filtered)
    if len(points) < limits.min_returns:
        raise ScanError(f'{len(points)} returns remain after the ring band filter; advanced.scan.min_returns asks for '
                        f'{limits.min_returns}')
    cdef double ratio = returns.noise_ratio if noise_ratio is None else noise_ratio
    # Before the filter, outliers count as noise. Corners must stand out from this noise, normals and breaks need not.
    if len(points) < np.count_nonzero(returns.valid):
        left = min(noise, <double> estimate_noise(radii, limits))
    sequence = point_sequence(positions, beams, scan.geometry.angle_increment, left, parameters.segments)
    normals = estimate_normals(sequence, range_noise(radii, left, ratio), parameters.segments)
    segments = extract_segments(sequence, range_noise(radii, noise, ratio), parameters.segments)
    if sequence.increment < 0.0:
        segments = segments.reversed()
    return Features(scan, points, beams, sequence.breaks, normals.view(float).reshape(-1, 2), segments, left,
                    parameters.density, ratio, backend=returns.backend)


cdef finite_points(filtered):
    """Return the finite points of a scan ``(P, 2)`` [m], also as complex numbers ``(P,)``, their ranges and beams."""
    cdef const double[:, :] place = filtered
    cdef Py_ssize_t size = place.shape[0], k, count = 0
    points, radii, beams = np.empty((size, 2)), np.empty(size), np.empty(size, np.intp)
    cdef double[:, ::1] point = points
    cdef double[::1] radius = radii
    cdef Py_ssize_t[::1] beam = beams
    with nogil:
        for k in range(size):
            if isfinite(place[k, 0]):
                point[count, 0], point[count, 1], beam[count] = place[k, 0], place[k, 1], k
                radius[count] = length_of(place[k, 0], place[k, 1])
                count += 1
    points = points[:count]
    return points, points.view(complex)[:, 0], radii[:count], beams[:count]
