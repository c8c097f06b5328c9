# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Surfaces of a scan: points in beam order, cut at breakpoints (Eq. 5), and their normals."""
import numpy as np

from libc.math cimport fabs

from ..geometry.plane cimport Line, Moments, difference, distance, fit_line, length_of, modulus

DEPTH_MARGIN = 0.15
# Minimum number of points in the window of a point for it to have a normal.
cdef double MIN_NEIGHBOURS = 3.0
# Distance [m] on each side of a point, along its surface, within which neighbours are used to fit its normal: less than
# the depth of a door frame. At least so many beams are used on each side: fewer give no normal at large ranges.
NORMAL_REACH, NORMAL_BEAMS = 0.1, 2
# Least reach as a multiple of the noise of a range: below it the noise turns normals towards the sensor.
NORMAL_NOISE = 4.0
# A point gets no normal if the neighbours' squared extents across and along the fitted line exceed this ratio.
cdef double MAX_RESIDUAL = 0.25


cdef enum:
    # Windows whose lines are fitted together: a number that compilers turn into vectors.
    BLOCK = 64


cdef struct Windows:
    # Number of points in each window, their sums [m, m^2], the way from the first to the last [m], and the normal.
    double[BLOCK] count, x, y, xx, xy, yy, dx, dy, nx, ny


def find_breaks(const double complex[::1] points, const Py_ssize_t[::1] beams, double increment, double noise,
                parameters):
    """Find where neighbouring points lie too far apart for one surface (Eq. 5).

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    beams : (P,) int
        Beam of each point; the threshold grows with the number of beams between two points.
    increment : float
        Step from one beam to the next [rad].
    noise : float
        Standard deviation of a range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P - 1,) bool
        True where a break lies between a point and the next.
    """
    cdef Py_ssize_t size = points.shape[0]
    cdef double[::1] work = np.empty(room_of(size))
    breaks = np.empty(max(size - 1, 0), dtype=bool)
    cdef unsigned char[::1] broken = breaks
    cdef BreakLimits limits = break_limits(increment, noise, parameters)
    cdef Surfaces surfaces = surfaces_in(&work[0], size)
    if size > 1:
        surfaces.beam, surfaces.breaks = &beams[0], &broken[0]
        take_points(points, &surfaces)
        mark_breaks(&surfaces, &limits)
    return breaks


cdef Surfaces surfaces_in(double *block, Py_ssize_t size) noexcept nogil:
    """Return surfaces of `size` points whose numbers are kept in a block of `room_of` that size."""
    cdef Surfaces surfaces = Surfaces(size, block, block + size, block + 2 * size, block + 3 * size,
                                      <Moments *> (block + 4 * size), block + 9 * size + 5, NULL, NULL)
    return surfaces


cdef Py_ssize_t room_of(Py_ssize_t size) noexcept nogil:
    """Return how many numbers the `Surfaces` of `size` points keep."""
    return 10 * size + 5


cdef int take_points(const double complex[::1] points, Surfaces *surfaces) except -1 nogil:
    """Write points and ranges."""
    cdef Py_ssize_t k
    for k in range(surfaces.size):
        surfaces.x[k], surfaces.y[k], surfaces.radius[k] = points[k].real, points[k].imag, modulus(points[k])
    return 0


cdef void mark_breaks(Surfaces *surfaces, BreakLimits *limits) noexcept nogil:
    """Write the breaks between neighbouring points, as `find_breaks`, and the distance from each point to the next."""
    cdef const double *x = surfaces.x
    cdef const double *y = surfaces.y
    cdef const double *radius = surfaces.radius
    cdef const Py_ssize_t *beam = surfaces.beam
    cdef double *step = surfaces.step
    cdef Py_ssize_t k
    for k in range(surfaces.size - 1):
        step[k] = length_of(x[k + 1] - x[k], y[k + 1] - y[k])
    for k in range(surfaces.size - 1):
        surfaces.breaks[k] = is_break(step[k], beam[k + 1] - beam[k], min(radius[k + 1], radius[k]), limits)


cdef BreakLimits break_limits(double increment, double noise, parameters) except *:
    """Return the limits of Eq. 5."""
    return BreakLimits(parameters.breakpoint_factor * fabs(increment), parameters.breakpoint_noise * noise,
                       parameters.max_gap)


cdef void sum_moments(Surfaces *surfaces) noexcept nogil:
    """Write the `Moments` of the points before each point, and of all."""
    cdef const double *x = surfaces.x
    cdef const double *y = surfaces.y
    cdef Moments sums = Moments(0.0, 0.0, 0.0, 0.0, 0.0)
    cdef Py_ssize_t k
    for k in range(surfaces.size):
        surfaces.moments[k] = sums
        sums.x, sums.y, sums.xx = sums.x + x[k], sums.y + y[k], sums.xx + x[k] * x[k]
        sums.xy, sums.yy = sums.xy + x[k] * y[k], sums.yy + y[k] * y[k]
    surfaces.moments[surfaces.size] = sums


def estimate_normals(const double complex[::1] points, const unsigned char[::1] breaks, double increment,
                     const double[::1] noise, parameters):
    """Estimate unit normals from the neighbours of each point on its surface.

    Normals face the sensor; their side follows from the order of the beams. A point with fewer than three neighbours on
    its surface, or whose neighbours lie on no line, gets no normal. The window of a point spans `NORMAL_REACH`, or
    `NORMAL_NOISE` times the noise where that is more, and at least `NORMAL_BEAMS` on each side: noise acts along the
    beams and tilts lines through points that lie close together.

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    breaks : (P - 1,) bool
        Result of `find_breaks`.
    increment : float
        Step from one beam to the next [rad].
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P,) complex
        0 for points without a normal.
    """
    cdef Py_ssize_t size = points.shape[0], k
    cdef double[::1] work = np.empty(room_of(size))
    cdef unsigned char[::1] broken = np.array(breaks, dtype=np.uint8)
    cdef NormalLimits limits = normal_limits(increment, parameters)
    cdef Surfaces surfaces = surfaces_in(&work[0], size)
    normals = np.empty((size, 2))
    cdef double[:, ::1] normal = normals
    if size:
        surfaces.breaks = &broken[0] if size > 1 else NULL
        take_points(points, &surfaces)
        for k in range(size - 1):
            surfaces.step[k] = distance(points[k + 1], points[k])
        sum_moments(&surfaces)
        fit_normals(&surfaces, &noise[0], &limits, &normal[0, 0])
    return normals.view(complex)[:, 0]


cdef NormalLimits normal_limits(double increment, parameters) except *:
    """Return the limits of the windows of normals."""
    return NormalLimits(NORMAL_REACH, NORMAL_NOISE, increment, NORMAL_BEAMS)


cdef void fit_normals(const Surfaces *surfaces, const double *noise, NormalLimits *limits,
                      double *normals) noexcept nogil:
    """Write the normal of each point, as `estimate_normals`, to ``(P, 2)``."""
    cdef Py_ssize_t size = surfaces.size
    cdef const double *x = surfaces.x
    cdef const double *y = surfaces.y
    cdef const unsigned char *breaks = surfaces.breaks
    cdef double *path = surfaces.work
    cdef Windows windows
    cdef Moments sums
    cdef Py_ssize_t k, at, start = 0, first = 0, end = 0, low = 0, high = 0, begin, stop
    cdef double reach
    measure_path(surfaces, path)
    while start < size:
        for at in range(BLOCK):
            k = min(start + at, size - 1)
            if k == end:
                first, end = k, k + 1
                while end < size and not breaks[end - 1]:
                    end += 1
            reach = max(limits.reach, limits.noise_factor * noise[k])
            while low < size and path[low] < path[k] - reach:
                low += 1
            while low > 0 and path[low - 1] >= path[k] - reach:
                low -= 1
            while high < size and path[high] <= path[k] + reach:
                high += 1
            while high > 0 and path[high - 1] > path[k] + reach:
                high -= 1
            begin, stop = max(min(low, k - limits.beams), first), min(max(high, k + limits.beams + 1), end)
            sums = difference(&surfaces.moments[stop], &surfaces.moments[begin])
            windows.count[at], windows.x[at], windows.y[at] = <double> (stop - begin), sums.x, sums.y
            windows.xx[at], windows.xy[at], windows.yy[at] = sums.xx, sums.xy, sums.yy
            windows.dx[at], windows.dy[at] = x[stop - 1] - x[begin], y[stop - 1] - y[begin]
        fit_windows(&windows, limits.increment)
        for at in range(min(BLOCK, size - start)):
            normals[2 * (start + at)], normals[2 * (start + at) + 1] = windows.nx[at], windows.ny[at]
        start += BLOCK


cdef void fit_windows(Windows *w, double increment) noexcept nogil:
    """Fit the normal of each window."""
    cdef Py_ssize_t k
    cdef double nx, ny
    cdef Line line
    cdef bint back, lies
    for k in range(BLOCK):
        line = fit_line(Moments(w.x[k], w.y[k], w.xx[k], w.xy[k], w.yy[k]), w.count[k])
        back = (w.dx[k] * line.c + w.dy[k] * line.s) * increment < 0.0
        lies = (w.count[k] >= MIN_NEIGHBOURS) & (line.residual <= MAX_RESIDUAL * line.spread)
        nx, ny = line.s if back else 0.0 - line.s, 0.0 - line.c if back else line.c
        w.nx[k], w.ny[k] = nx if lies else 0.0, ny if lies else 0.0


cdef void measure_path(const Surfaces *surfaces, double *path) noexcept nogil:
    """Write the distance along the surfaces up to each point [m], over three beams at a time where unbroken."""
    cdef const double *x = surfaces.x
    cdef const double *y = surfaces.y
    cdef const unsigned char *breaks = surfaces.breaks
    cdef Py_ssize_t size = surfaces.size, k
    cdef double length
    path[0] = 0.0
    for k in range(size - 1):
        length = 0.0
        if not breaks[k]:
            length = surfaces.step[k]
            if 0 < k < size - 2 and not (breaks[k - 1] or breaks[k + 1]):
                length = length_of(x[k + 2] - x[k - 1], y[k + 2] - y[k - 1]) / 3.0
        path[k + 1] = path[k] + length
