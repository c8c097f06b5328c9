# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Ring band filter: tests each beam against those around it (section 2.1, Eq. 4, by lines instead of Eq. 3)."""
from enum import IntEnum

import numpy as np

from ..geometry import tolerance

from libc.math cimport INFINITY, NAN, fabs, isfinite
from libc.stdlib cimport labs

from ..geometry.plane cimport length_of

cdef double SIGMAS = tolerance.SIGMAS
# Tolerance as a fraction of the range: walls seen at a grazing angle bend within a ring by quantised ranges.
cdef double RELATIVE_TOLERANCE = 0.01
# T1 and T2 of Eq. 4. With these an outlier alone is noise, and one beside an edge of its own ring is a corner.
cdef Py_ssize_t INNER_THRESHOLD = 2, OUTER_THRESHOLD = 3

cdef enum:
    # Beams of the outer and of the inner ring on each side; outcomes.
    RING = 3
    INNER = 1
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
    """An outlier beside many other outliers: it is taken as a corner and kept as measured. Corners are found later."""
    REMOVED = 3
    """Noise next to a corner, or a gross outlier: the point is removed."""


cdef struct Ring:
    # Beams, between `RING` times nan on either side.
    const double *x
    const double *y
    # Tolerance by noise [m].
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
    filtered, outcome = np.array(np.transpose(points), order='C'), np.zeros(len(points), dtype=int)
    cdef double[:, ::1] place = filtered
    cdef Py_ssize_t[::1] of = outcome
    if outcome.size:
        filter_points(&place[0, 0], &place[1, 0], outcome.size, noise, parameters, &of[0])
    return filtered.T, outcome


cdef int filter_points(double *x, double *y, Py_ssize_t beams, double noise, parameters, Py_ssize_t *outcome) except -1:
    """Filter points in beam order in place, as `ring_band_filter`; write what became of those that are not kept."""
    if parameters.test == 'off' or beams <= 2 * INNER:
        return 0
    cdef double gross = parameters.gross_error or INFINITY
    cdef Py_ssize_t size = ring_size(x, beams), k, i, count, each
    cdef double[:, ::1] work = np.empty((6, size + 2 * RING))
    cdef Py_ssize_t[:, ::1] index = np.empty((2, size), np.intp)
    cdef Py_ssize_t *of = &index[0, 0]
    cdef Py_ssize_t *candidate = &index[1, 0]
    cdef double *across = &work[0, RING]
    cdef double *along = &work[1, RING]
    cdef double *deviation = &work[5, 0]
    cdef Ring ring = Ring(across, along, SIGMAS * noise)
    cdef Py_ssize_t[2] counts
    take_points(x, y, beams, size, across, along, of)
    count = find_candidates(&ring, size, &work[2, 0], candidate, deviation)
    for each in range(count):
        k = candidate[each]
        # C1 and C2 count the outliers in the inner and the outer ring, the candidate included.
        i, counts[0], counts[1] = of[k], 1, 1
        if deviation[each] <= gross:
            count_outliers(&ring, k, counts)
        if counts[0] >= INNER_THRESHOLD or deviation[each] > gross:
            x[i] = y[i] = NAN
            outcome[i] = REMOVED
        elif counts[1] >= OUTER_THRESHOLD:
            outcome[i] = CORNER
        elif (0 < k < size - 1 and of[k - 1] == i - 1 and of[k + 1] == i + 1
              and isfinite(across[k - 1] + across[k + 1])):
            x[i] = (across[k - 1] + across[k] + across[k + 1]) / 3.0
            y[i] = (along[k - 1] + along[k] + along[k + 1]) / 3.0
            outcome[i] = SMOOTHED
    return 0


cdef Py_ssize_t ring_size(const double *x, Py_ssize_t beams) noexcept nogil:
    """Return the number of beams that make up the rings: without those without a return where these are most."""
    cdef Py_ssize_t known = isfinite(x[0]), adjacent = 0, k
    for k in range(1, beams):
        known += isfinite(x[k])
        adjacent += isfinite(x[k]) & isfinite(x[k - 1])
    return beams if 2 * adjacent >= known - 1 else known


cdef void take_points(const double *x, const double *y, Py_ssize_t beams, Py_ssize_t size, double *across,
                      double *along, Py_ssize_t *of) noexcept nogil:
    """Write `size` points between `RING` times nan on either side, and the beam of each."""
    cdef Py_ssize_t k, count = 0
    for k in range(beams):
        if size == beams or isfinite(x[k]):
            across[count], along[count], of[count] = x[k], y[k], k
            count += 1
    for k in range(RING):
        across[-1 - k] = along[-1 - k] = across[size + k] = along[size + k] = NAN


cdef inline double beyond(const Ring *ring, Py_ssize_t third, Py_ssize_t first, Py_ssize_t second,
                          double *distance) noexcept nogil:
    """Return by how much the third beam is off the line through two others beyond the tolerance [m].

    The line through p and q meets the beam b s at s = cross(p, q) / cross(b, q - p). The `distance` is that along the
    beam [m]; it is not a number, as the result, where one of the beams has no return.
    """
    cdef double px = ring.x[first], py = ring.y[first], qx = ring.x[second], qy = ring.y[second]
    cdef double x = ring.x[third], y = ring.y[third], radius = length_of(x, y)
    cdef double meeting = (px * qy - py * qx) / (x * (qy - py) - y * (qx - px))
    cdef double growth = 1.0 + <double> (labs(first - third) + labs(second - third)) / <double> (second - first)
    distance[0] = fabs(meeting - 1.0) * radius
    return distance[0] - (RELATIVE_TOLERANCE * radius + ring.noise_tolerance * growth)


cdef Py_ssize_t find_candidates(const Ring *ring, Py_ssize_t size, double *work, Py_ssize_t *candidate,
                                double *deviation) noexcept nogil:
    """Write the beams that lie on no line through two other beams of their ring, and how far off; return their number.

    A corner lies on the lines of both its walls. Where the beams before and those after are straight, a pair with one
    beam on each side is no evidence: its line would cut the corner off. `work` has room for three numbers a beam and
    those around them.
    """
    # Of lines through both neighbours, those before and those after.
    cdef double *astride = work + RING
    cdef double *before = work + (size + 2 * RING)
    cdef double *after = work + 2 * (size + 2 * RING)
    cdef Py_ssize_t k, found = 0
    cdef double off
    cdef bint corner
    for k in range(RING):
        astride[-1 - k] = astride[size + k] = NAN
    for k in range(size):
        astride[k] = beyond(ring, k, k - 1, k + 1, &off)
    for k in range(size):
        before[k] = beyond(ring, k, k - 2, k - 1, &off)
    for k in range(size):
        after[k] = beyond(ring, k, k + 1, k + 2, &off)
    for k in range(size):
        corner = (astride[k - 2] <= 0.0) & (astride[k + 2] <= 0.0)
        if ((astride[k] <= 0.0) & (not corner)) | (before[k] <= 0.0) | (after[k] <= 0.0) or not isfinite(ring.x[k]):
            continue
        if not on_some_line(ring, k, corner, &deviation[found]):
            candidate[found] = k
            found += 1
    return found


cdef bint on_some_line(const Ring *ring, Py_ssize_t k, bint corner, double *least) noexcept nogil:
    """Return whether a beam lies on a line through two others of its ring; `least` is the least distance [m]."""
    cdef Py_ssize_t first, second
    cdef double off
    cdef bint on, found = False
    least[0] = INFINITY
    for first in range(k - RING, k + RING):
        for second in range(first + 1, k + RING + 1):
            if first == k or second == k:
                continue
            on = beyond(ring, k, first, second, &off) <= 0.0
            found |= on and not (corner and first < k < second)
            least[0] = off if off < least[0] else least[0]
    return found


cdef void count_outliers(const Ring *ring, Py_ssize_t k, Py_ssize_t *counts) noexcept nogil:
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
                on |= beyond(ring, other, first, second, &off) <= 0.0
                tested |= isfinite(off)
        if tested and not on:
            counts[1] += 1
            counts[0] += labs(other - k) <= INNER
