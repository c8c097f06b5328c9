# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Extraction of the features of a scan (sections 2.1 and 2.2)."""
import numpy as np

from ..errors import ScanError
from ..parameters.tree import Parameters, expect_parameters
from ..scan import expect_scan

from libc.math cimport isfinite
from libc.string cimport memcpy

from ..geometry.plane cimport length_of
from .noise cimport noise_of, write_range_noise
from .poles cimport with_poles
from .records cimport Features, Segments
from .returns cimport Returns
from .ring_band cimport filter_points
from .segments cimport extract_segments
from .surfaces cimport (BreakLimits, NormalLimits, Surfaces, break_limits, fit_normals, mark_breaks, normal_limits,
                        room_of, sum_moments, surfaces_in)

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
        When `scan` is no `Scan`, or fewer than `scan.min_returns` of its beams have a return.
    ParameterError
        When `parameters` are no `Parameters`.
    """
    expect_scan(scan)
    expect_parameters(parameters)
    returns = Returns(scan, parameters.scan)
    return extract_from_returns(returns, parameters, returns.noise_ratio if noise_ratio is None else noise_ratio)


def extract_from_returns(Returns returns, parameters, double noise_ratio, double pole_size=0.0):
    """Extract the features of a scan from its returns; as `extract_features`.

    Small objects without normals, smaller than `pole_size` [m], become poles.
    """
    cdef Py_ssize_t beams = returns.place.shape[1], size = 0, k
    # The block of the surfaces, and the noise of each range.
    cdef double[::1] block = np.empty(room_of(beams) + beams)
    cdef Surfaces surfaces = surfaces_in(&block[0], beams)
    cdef double *noise = &block[room_of(beams)]
    cdef Py_ssize_t[::1] outcome = np.empty(beams, np.intp)
    memcpy(surfaces.x, &returns.place[0, 0], 2 * beams * sizeof(double))
    filter_points(surfaces.x, surfaces.y, beams, returns.noise, parameters.filter, &outcome[0])
    for k in range(beams):
        size += isfinite(surfaces.x[k])
    if size < parameters.scan.min_returns:
        raise ScanError(f'{size} returns remain after the ring band filter; advanced.scan.min_returns asks for '
                        f'{parameters.scan.min_returns}')
    # The points that are left, their ranges and their beams.
    vectors, numbers, breaks = np.empty((2, size, 2)), np.empty(size, np.intp), np.empty(size - 1, bool)
    cdef double[:, :, ::1] vector = vectors
    cdef Py_ssize_t[::1] beam = numbers
    cdef unsigned char[::1] broken = breaks
    surfaces.size, surfaces.beam, surfaces.breaks = 0, &beam[0], &broken[0]
    for k in range(beams):
        if isfinite(surfaces.x[k]):
            beam[surfaces.size] = k
            surfaces.x[surfaces.size], surfaces.y[surfaces.size] = surfaces.x[k], surfaces.y[k]
            surfaces.size += 1
    for k in range(size):
        vector[0, k, 0], vector[0, k, 1] = surfaces.x[k], surfaces.y[k]
        surfaces.radius[k] = length_of(surfaces.x[k], surfaces.y[k])
    # Before the filter, outliers count as noise. Corners must stand out from this noise, normals and breaks need not.
    cdef double left = returns.noise
    if size < returns.count:
        left = min(left, noise_of(surfaces.radius, size, parameters.scan, surfaces.work))
    increment = returns.scan.geometry.angle_increment
    cdef BreakLimits break_limit = break_limits(increment, left, parameters.segments)
    cdef NormalLimits normal_limit = normal_limits(increment, parameters.segments)
    mark_breaks(&surfaces, &break_limit)
    sum_moments(&surfaces)
    write_range_noise(surfaces.radius, size, left, noise_ratio, noise)
    fit_normals(&surfaces, noise, &normal_limit, &vector[1, 0, 0])
    write_range_noise(surfaces.radius, size, returns.noise, noise_ratio, noise)
    cdef Segments segments = extract_segments(&surfaces, noise, parameters.segments)
    if increment < 0.0:
        segments = segments.reversed()
    features = Features(returns.scan, vectors[0], numbers, breaks, vectors[1], segments, left, parameters.density,
                        noise_ratio, twist=returns.twist)
    return with_poles(features, pole_size, parameters.segments) if pole_size else features
