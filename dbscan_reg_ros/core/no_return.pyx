# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, cdivision=True, initializedcheck=False
"""Detection of the range that a driver sends in place of a missing return."""
import numpy as np

from libc.math cimport INFINITY, sqrt

from .scan import Scan

from .geometry.ordering cimport order_statistic

cdef enum:
    FEWEST = 5
    # Fewest beams that share a range that can mean "no return".
    FEWEST_OTHERS = 8
    # Fewest different other ranges from which the resolution is estimated.
    RATIO = 4
    # A value is judged if it is shared by this many times as many beams as any other large range; a surface shares at
    # most 2.4 times as many.
    MANY = 5
    # Number of scans that must share a value, while their other ranges change, before it is known to mean "no return".
    MOST_VALUES = 16
    # Largest number of values that are remembered.

cdef double STRAY = 0.05
# Largest number of ranges beyond the shared one, as a fraction of the beams that share it.
cdef double EQUAL = 0.4, EQUAL_IMPOSSIBLE = 0.9
# The other ranges have changed if at most this fraction is exactly as in the last scan; the second one is for a value
# that no surface can give, as without noise the ranges to a wall alongside stay the same.


cdef class Evidence:
    """Evidence that a shared value is no return."""

    # Number of scans with this value, and of those in which the other ranges had changed.
    cdef readonly Py_ssize_t scans, changed
    # Whether the value is treated as no return.
    cdef readonly bint used


cdef class NoReturn:
    """Finds, scan by scan, ranges that mean "no return".

    A surface can share one exact range among a few beams only: those near its nearest point, within the resolution of
    the ranges. A smooth surface puts at most 1 / (sqrt(2) - 1) = 2.4 times as many beams into the last step of the
    resolution as into the one before. A largest range that more beams share is no return; so is one that stays the same
    while the other ranges change.

    Attributes
    ----------
    known : float or None
        Largest range that is known to mean "no return" [m].
    """

    cdef readonly object known
    # `Evidence` for each value [m].
    cdef dict _evidence
    # Ranges of the last scan; None before the first.
    cdef object _last

    def add(self, ranges, double range_max, double angle_increment):
        """Add a scan.

        Parameters
        ----------
        ranges : (N,) float [m]
        range_max : float [m]
            Largest range that the driver states; not positive or not finite: no limit.
        angle_increment : float [rad]

        Returns
        -------
        list of float
            Ranges that are to be used as no return in this scan [m].
        """
        ranges, last = np.asarray(ranges, dtype=np.float32), self._last
        self._last = ranges
        if last is None:
            self._evidence = {}
        shared = shared_range(ranges, range_max if range_max > 0.0 else INFINITY, angle_increment)
        if shared is not None:
            value, impossible = shared
            self._weigh(value, impossible, has_changed(last, ranges, value, impossible))
        return [value for value, each in self._evidence.items() if each.used]

    def removed_from(self, scan):
        """Add a scan; return it without the beams whose range means "no return"."""
        geometry = scan.geometry
        codes = [code for code in self.add(scan.ranges, geometry.range_max, geometry.angle_increment)
                 if code < geometry.range_max]
        if not codes:
            return scan
        ranges = np.where(np.isin(scan.ranges, np.array(codes, dtype=np.float32)), np.float32(np.inf), scan.ranges)
        return Scan(scan.stamp, ranges, geometry, scan.time_increment, scan.frame_id)

    cdef _weigh(self, double value, bint impossible, bint has_changed):
        """Add a scan that shares a `value` [m], which may be `impossible`; `has_changed`: its other ranges have."""
        cdef Evidence each
        cdef bint first
        if len(self._evidence) >= MOST_VALUES and value not in self._evidence:
            self._evidence = {value: each for value, each in self._evidence.items() if each.changed >= MANY}
        first = not self._evidence
        each = self._evidence.setdefault(value, Evidence())
        each.scans += 1
        each.changed += has_changed
        each.used = each.used or each.changed >= MANY or (impossible and (first or each.scans > 1))
        if each.changed >= MANY:
            self.known = max(value, self.known or 0.0)


cdef bint has_changed(last, ranges, double shared, bint impossible):
    """Whether enough of the ranges that are not `shared` differ from those of the last scan, by motion or by noise."""
    if last is None or len(last) != len(ranges):
        return last is not None
    value = np.float32(shared)
    others = np.isfinite(ranges) & (ranges != value) & (last != value)
    equal = EQUAL_IMPOSSIBLE if impossible else EQUAL
    return (np.count_nonzero(ranges[others] == last[others]) <= equal * np.count_nonzero(others))


cdef shared_range(const float[:] ranges, double range_max, double angle_increment):
    """Return the largest range [m] that several beams of a scan share exactly; None if chance may do it.

    With it is returned whether no surface in front of the sensor can give this range to that many beams.

    The allowed number of beams follows from the other ranges of the scan: the most beams that share another large
    range, and the resolution, which for triangulating sensors grows with the square of the range.
    """
    values = with_repeated_end(ranges, range_max)
    if values is None:
        return None
    distinct, counts = np.unique(values, return_counts=True)
    beyond = len(values) - np.cumsum(counts)
    shared = np.flatnonzero((counts >= FEWEST) & (beyond <= STRAY * counts))
    if not len(shared):
        return None
    last = shared[-1]
    value, count = float(distinct[last]), int(counts[last])
    others, counts = np.delete(distinct, last), np.delete(counts, last)
    if len(others) < FEWEST_OTHERS:
        return None
    if count < RATIO * counts[others >= 0.5 * value].max(initial=1):
        return None
    far = others[others >= 0.5 * others[-FEWEST_OTHERS]]
    resolution = float(np.quantile(np.diff(far) * (value / far[1:])**2, 0.1))
    width = sqrt(8.0 * resolution / value)
    return value, count * abs(angle_increment) >= RATIO * width


cdef with_repeated_end(const float[:] ranges, float range_max):
    """Return the ranges of all returns in ascending order; None if fewer than `FEWEST` of the farthest are equal."""
    cdef double[::1] found = np.empty(ranges.shape[0])
    cdef Py_ssize_t k, first, count = 0
    with nogil:
        for k in range(ranges.shape[0]):
            if 0.0 < ranges[k] <= range_max and ranges[k] < INFINITY:
                found[count] = ranges[k]
                count += 1
        if count < FEWEST:
            with gil:
                return None
        first = max(count - <Py_ssize_t> (STRAY * count) - FEWEST, 0)
        order_statistic(&found[0], count, first)
    np.asarray(found[first:count]).sort()
    for k in range(first, count - FEWEST + 1):
        if found[k] == found[k + FEWEST - 1]:
            return np.sort(found[:count])
    return None
