# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Ring band filter: tests each beam against those around it (section 2.1, Eq. 4, by lines instead of Eq. 3)."""
from enum import IntEnum

import numpy as np

from ..geometry import tolerance

from libc.math cimport INFINITY, NAN, fabs, isfinite, isnan
from libc.stdlib cimport labs

from ..geometry.plane cimport cross, modulus, vector

cdef double SIGMAS = tolerance.SIGMAS

cdef enum:
    # Beams of the outer and of the inner ring on each side; flags; outcomes.
    RING = 3
    INNER = 1
    ASTRIDE = 1
    CANDIDATE = 2
    SMOOTHED = 1
    CORNER = 2
    REMOVED = 3


class Outcome(IntEnum):
    """Result of the ring band filter for a beam (the four regions of Figure 2)."""

    KEPT = 0
    """The beam is no outlier, or has no return."""
    SMOOTHED = 1
    """Noise: the point is replaced by the mean of the inner ring."""
    CORNER = 2
    """An outlier beside many other outliers: it is taken as a corner and kept as measured."""
    REMOVED = 3
    """Noise next to a corner, or a gross outlier: the point is removed."""


cdef struct Ring:
    # Tolerance as a fraction of the range, and that by noise [m].
    double relative_tolerance
    double noise_tolerance


def ring_band_filter(points, double noise, parameters):
    """Filter the points of a scan according to Eq. 4.

    A beam is a candidate when it is an outlier in the ring around it; ``C1`` and ``C2`` count the outliers in the inner
    (3 beams) and the outer (7 beams) ring around a candidate, the candidate included.

    Parameters
    ----------
    points : (N, 2) float
        Points in beam order [m]; not finite where a beam has no return.
    noise : float
        Standard deviation of a range [m].
    parameters : RingBandParameters

    Returns
    -------
    filtered : (N, 2) float
        Removed points are ``nan``.
    outcome : (N,) int
        `Outcome` of each beam.
    """
    filtered, outcome = np.array(points, order='C'), np.zeros(len(points), dtype=int)
    filter_points(filtered.view(complex)[:, 0], noise, parameters, outcome)
    return filtered, outcome


cdef int filter_points(double complex[::1] place, double noise, parameters, Py_ssize_t[::1] outcome) except -1:
    """Filter points in beam order in place, as `ring_band_filter`; write what became of those that are not kept."""
    if parameters.test == 'off' or place.shape[0] <= 2 * INNER:
        return 0
    cdef Ring ring = Ring(parameters.relative_tolerance, SIGMAS * noise)
    cdef Py_ssize_t inner_threshold = parameters.inner_threshold, outer_threshold = parameters.outer_threshold
    cdef double gross = parameters.gross_error or INFINITY
    cdef Py_ssize_t size = ring_size(place), k, i
    cdef double complex[::1] beam = np.full(size + 2 * RING, complex(NAN, NAN))
    cdef Py_ssize_t[::1] of = np.empty(size, np.intp)
    cdef signed char[::1] flags = np.zeros(size + 2 * RING, np.int8)
    cdef double[::1] deviation = np.zeros(size + 2 * RING)
    cdef Py_ssize_t[2] counts
    with nogil:
        take_points(place, beam, of)
        if not find_candidates(beam, &ring, flags, deviation):
            return 0
        for k in range(RING, beam.shape[0] - RING):
            if not flags[k] & CANDIDATE:
                continue
            # C1 and C2 count the outliers in the inner and the outer ring, the candidate included.
            i, counts[0], counts[1] = of[k - RING], 1, 1
            if deviation[k] <= gross:
                count_outliers(beam, k, &ring, counts)
            if counts[0] >= inner_threshold or deviation[k] > gross:
                place[i] = vector(NAN, NAN)
                outcome[i] = REMOVED
            elif counts[1] >= outer_threshold:
                outcome[i] = CORNER
            elif (RING < k < RING + size - 1 and of[k - RING - 1] == i - 1 and of[k - RING + 1] == i + 1
                  and isfinite(beam[k - 1].real + beam[k + 1].real)):
                place[i] = vector((beam[k - 1].real + beam[k].real + beam[k + 1].real) / 3.0,
                                  (beam[k - 1].imag + beam[k].imag + beam[k + 1].imag) / 3.0)
                outcome[i] = SMOOTHED
    return 0


cdef Py_ssize_t ring_size(const double complex[::1] place) except -1 nogil:
    """Return the number of beams that make up the rings: without those without a return where these are most."""
    cdef Py_ssize_t known = 0, adjacent = 0, k
    for k in range(place.shape[0]):
        if isfinite(place[k].real):
            known += 1
            adjacent += k > 0 and isfinite(place[k - 1].real)
    return place.shape[0] if 2 * adjacent >= known - 1 else known


cdef int take_points(const double complex[::1] place, double complex[::1] beam, Py_ssize_t[::1] of) except -1 nogil:
    """Write the points between `RING` times nan on either side, and the beam of each."""
    cdef Py_ssize_t k, count = 0
    cdef bint dense = of.shape[0] == place.shape[0]
    for k in range(place.shape[0]):
        if dense or isfinite(place[k].real):
            beam[RING + count], of[count] = place[k], k
            count += 1
    return 0


cdef inline bint on_line(const double complex[::1] beam, Py_ssize_t third, Py_ssize_t first, Py_ssize_t second,
                         Ring *ring, double *distance) except -1 nogil:
    """Return whether the third beam lies on the line through two others; `distance` is that along the beam [m].

    The line through p and q meets the beam b s at s = cross(p, q) / cross(b, q - p). The distance is infinite where one
    of the beams has no return.
    """
    cdef double complex p = beam[first], q = beam[second], b = beam[third]
    cdef double radius = modulus(b), meeting = cross(p, q) / cross(b, q - p)
    cdef double growth = 1.0 + (<double> (labs(first - third) + labs(second - third))) / (<double> (second - first))
    distance[0] = fabs(meeting - 1.0) * radius
    if isnan(distance[0]):
        distance[0] = INFINITY
    return distance[0] <= ring.relative_tolerance * radius + ring.noise_tolerance * growth


cdef bint find_candidates(const double complex[::1] beam, Ring *ring, signed char[::1] flags,
                          double[::1] deviation) except -1 nogil:
    """Flag beams that lie on no line through two other beams of their ring; return whether there are any.

    A corner lies on the lines of both its walls. Where the beams before and those after are straight, a pair with one
    beam on each side is no evidence: its line would cut the corner off.
    """
    cdef Py_ssize_t k, end = beam.shape[0] - RING
    cdef double off
    cdef bint corner, found = False
    for k in range(RING, end):
        if on_line(beam, k, k - 1, k + 1, ring, &off):
            flags[k] |= ASTRIDE
    for k in range(RING, end):
        if not isfinite(beam[k].real):
            continue
        corner = flags[k - 2] & ASTRIDE and flags[k + 2] & ASTRIDE
        if flags[k] & ASTRIDE and not corner:
            continue
        if on_line(beam, k, k - 2, k - 1, ring, &off) or on_line(beam, k, k + 1, k + 2, ring, &off):
            continue
        if not on_some_line(beam, k, corner, ring, &deviation[k]):
            flags[k] |= CANDIDATE
            found = True
    return found


cdef bint on_some_line(const double complex[::1] beam, Py_ssize_t k, bint corner, Ring *ring,
                       double *least) except -1 nogil:
    """Return whether a beam lies on a line through two others of its ring; `least` is the least distance [m]."""
    cdef Py_ssize_t first, second
    cdef double off
    cdef bint on, found = False
    least[0] = INFINITY
    for first in range(k - RING, k + RING):
        for second in range(first + 1, k + RING + 1):
            if first == k or second == k:
                continue
            on = on_line(beam, k, first, second, ring, &off)
            found |= on and not (corner and first < k < second)
            least[0] = min(least[0], off)
    return found


cdef int count_outliers(const double complex[::1] beam, Py_ssize_t k, Ring *ring, Py_ssize_t *counts) except -1 nogil:
    """Add the outliers of the inner and of the outer ring: beams on no line through two beams across from `k`."""
    cdef Py_ssize_t other, first, second, start
    cdef double off
    cdef bint tested, on
    for other in range(k - RING, k + RING + 1):
        if other == k:
            continue
        start, tested, on = k + 1 if other < k else k - RING, False, False
        for first in range(start, start + RING - 1):
            for second in range(first + 1, start + RING):
                on |= on_line(beam, other, first, second, ring, &off)
                tested |= isfinite(off)
        if tested and not on:
            counts[1] += 1
            counts[0] += labs(other - k) <= INNER
    return 0
