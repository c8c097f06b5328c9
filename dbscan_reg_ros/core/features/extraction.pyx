# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Extraction of the features of a scan (sections 2.1 and 2.2)."""
import numpy as np

from ..errors import ScanError
from ..parameters.tree import Parameters

from libc.math cimport isfinite

from ..geometry.plane cimport modulus
from .noise cimport estimate_noise, write_range_noise
from .poles cimport with_poles
from .records cimport Features, Segments
from .returns cimport Returns
from .ring_band cimport filter_points
from .segments cimport extract_segments
from .surfaces cimport BreakLimits, break_limits, fit_normals, mark_breaks, sum_moments

_DEFAULTS = Parameters()


def extract_features(scan, parameters=_DEFAULTS, noise_ratio=None):
    """Filter a scan and describe it by points, normals and line segments (sections 2.1 and 2.2).

    Parameters
    ----------
    scan : Scan
    parameters : Parameters
    noise_ratio : float, optional
        Standard deviation of a range as a fraction of the range, if it is known from several scans of this sensor. By
        default it is estimated from this scan.

    Raises
    ------
    ScanError
        When fewer than `scan.min_returns` beams have a return.
    """
    returns = Returns(scan, parameters.scan)
    return extract_from_returns(returns, parameters, returns.noise_ratio if noise_ratio is None else noise_ratio)


def extract_from_returns(Returns returns, parameters, double noise_ratio, double pole_size=0.0):
    """Extract the features of a scan from its returns; as `extract_features`.

    Small objects without normals, smaller than `pole_size` [m], become poles.
    """
    filtered = np.array(returns.places)
    filter_points(filtered, returns.noise, parameters.filter, np.zeros(filtered.shape[0], np.intp))
    # The points that are left, their ranges and their beams.
    cdef const double complex[::1] place = filtered
    cdef Py_ssize_t size = 0, k, at = 0
    for k in range(place.shape[0]):
        size += isfinite(place[k].real)
    if size < parameters.scan.min_returns:
        raise ScanError(f'{size} returns remain after the ring band filter; advanced.scan.min_returns asks for '
                        f'{parameters.scan.min_returns}')
    vectors, beams, breaks = np.empty((2, size), complex), np.empty(size, np.intp), np.empty(size - 1, bool)
    cdef double complex[::1] point = vectors[0], normal = vectors[1]
    cdef double[:, ::1] moments = np.empty((5, size + 1)), work = np.empty((2, size))
    cdef double[::1] radius = work[0], noise = work[1]
    cdef Py_ssize_t[::1] beam = beams
    for k in range(place.shape[0]):
        if isfinite(place[k].real):
            point[at], radius[at], beam[at] = place[k], modulus(place[k]), k
            at += 1
    # Before the filter, outliers count as noise. Corners must stand out from this noise, normals and breaks need not.
    cdef double left = returns.noise
    if size < returns.count:
        left = min(left, estimate_noise(radius, parameters.scan))
    increment = returns.scan.geometry.angle_increment
    cdef BreakLimits limits = break_limits(increment, left, parameters.segments)
    mark_breaks(point, beam, &limits, breaks)
    sum_moments(point, moments)
    write_range_noise(radius, left, noise_ratio, noise)
    fit_normals(point, breaks, moments, noise, increment, parameters.segments, normal)
    write_range_noise(radius, returns.noise, noise_ratio, noise)
    cdef Segments segments = extract_segments(point, breaks, moments, radius, beam, noise, parameters.segments)
    if increment < 0.0:
        segments = segments.reversed()
    pairs = vectors.view(float).reshape(2, size, 2)
    features = Features(returns.scan, pairs[0], beams, breaks, pairs[1], segments, left, parameters.density, noise_ratio,
                        twist=returns.twist)
    return with_poles(features, pole_size, parameters.segments) if pole_size else features
