# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Filter of the intervals between the stamps of one sensor."""
from statistics import median

cimport cython
from libc.math cimport fabs, rint, sqrt

from ...geometry.tolerance import TINY
from .stamps import GAP_RATIO, ScanInterval, ScanTiming, jump_of, seconds

from ...geometry.se2 cimport SE2
from .twist cimport Twist

cdef enum:
    # Number of intervals in the running median.
    MEDIAN_SIZE = 51

cdef:
    # A scan overlaps the next one if the interval is below this ratio of its duration; below 1 for jitter of stamps.
    double OVERLAP_RATIO = 0.9
    # Intervals shorter than this [s] are ignored: no lidar is that fast.
    double MIN_INTERVAL = 0.001
    # An interval up to this multiple of the median is plausible: it allows for one dropped scan and jitter.
    double MAX_RATIO = 2.05
    # Motion [m, rad] from which on a velocity is compared: less of it is noise.
    double LEAST_MOTION = 0.02
    # Fraction of the squared changes of the velocity that is kept from one comparison to the next.
    double KEPT = 0.9


cdef struct Alternative:
    # One choice of the intervals: time [s] since `compare_velocities`, velocity in it, and squared changes of such velocities.
    double since, changes
    Twist velocity


@cython.auto_pickle(True)
cdef class StampFilter:
    """Running median of the intervals between the stamps of one sensor.

    Attributes
    ----------
    duration : float [s]
        Duration of the last scan, as in `ScanTiming`.
    """

    cdef readonly double duration
    # The last stamp [ns]; None before the first.
    cdef object _last
    # The recent intervals [s] without jumps, the oldest one first.
    cdef double[MEDIAN_SIZE] _recent
    cdef Py_ssize_t _count
    # Those of them in ascending order that are no stamps that repeat or go back.
    cdef double[MEDIAN_SIZE] _positive
    cdef Py_ssize_t _positive_count
    # The recent intervals [s] with jumps.
    cdef list _between
    # Pose in the middle of the scan at `compare_velocities`; None after a jump.
    cdef SE2 _middle
    cdef Alternative _by_stamps, _evened

    def timing(self, scan, parameters, double since_last):
        """Return how long a `scan` takes, and store its duration as `duration`.

        The velocity that deskews it is known after a jump of the own stamps, too, if the time `since_last` [s] from the
        last scan of any sensor is at most `time.max_jump`.
        """
        cdef double most = parameters.time.max_jump, duration = scan.duration if parameters.odometry.deskew else 0.0
        self.duration = duration if duration < most else 0.0
        outdated = fabs(since_last) > most and self.jumps(scan.stamp, parameters.time)
        return ScanTiming(self.duration, self.ratio(self.duration), self.duration > 0.0 and not outdated)

    def next(self, stamp, double middle_offset, parameters, double scan_duration):
        """Add a stamp and determine the interval since the last one.

        A scan cannot begin before the previous one ends. If the stamps contradict this, they jitter: the interval is
        evened, as `_evened_interval`, unless the velocity changes less by the stamps.

        Parameters
        ----------
        stamp : int [ns]
        middle_offset : float [s]
            Time from the stamp to the middle of the scan.
        parameters : TimeParameters
        scan_duration : float [s]
            Time from the first beam to the last; 0 if all beams are measured at once.
        """
        cdef double elapsed, evened, usual
        cdef bint steady, jumps = self.jumps(stamp, parameters)
        last, self._last = self._last, stamp
        if last is None:
            self._between = []
            return ScanInterval(0.0, 0.0, middle_offset)
        elapsed = seconds(stamp - last)
        usual = median(self._between) if jumps and self._between else parameters.max_jump
        self._between.append(elapsed)
        del self._between[:-MEDIAN_SIZE]
        if jumps:
            self._middle = None
            missing = elapsed > <double> GAP_RATIO * usual
            return ScanInterval(self.typical, max(elapsed, 0.0), middle_offset, *jump_of(elapsed), missing)
        self._add(elapsed)
        evened = self._evened_interval(elapsed, scan_duration)
        self._by_stamps.since += elapsed
        self._evened.since += evened
        steady = (self._shortest() > max(self._typical() / <double> GAP_RATIO, OVERLAP_RATIO * scan_duration)
                  or (elapsed > 0.0 and self._by_stamps.changes < self._evened.changes))
        return ScanInterval(elapsed if steady else evened, max(elapsed, 0.0), middle_offset, steady=steady,
                            sigma=fabs(elapsed - evened) * self._doubt())

    cdef _add(self, double elapsed):
        """Add an interval [s] to the recent ones, in place of the oldest."""
        cdef Py_ssize_t k, at
        if self._count == MEDIAN_SIZE:
            if self._recent[0] > MIN_INTERVAL:
                at = self._number_below(self._recent[0])
                self._positive_count -= 1
                for k in range(at, self._positive_count):
                    self._positive[k] = self._positive[k + 1]
            self._count -= 1
            for k in range(self._count):
                self._recent[k] = self._recent[k + 1]
        self._recent[self._count] = elapsed
        self._count += 1
        if elapsed > MIN_INTERVAL:
            at = self._number_below(elapsed)
            for k in range(self._positive_count, at, -1):
                self._positive[k] = self._positive[k - 1]
            self._positive[at] = elapsed
            self._positive_count += 1

    cdef Py_ssize_t _number_below(self, double limit):
        """Return the number of `_positive` intervals below a `limit` [s]."""
        cdef Py_ssize_t k = 0
        while k < self._positive_count and self._positive[k] < limit:
            k += 1
        return k

    cdef double _shortest(self):
        """Return the shortest of the recent intervals [s]."""
        cdef double shortest = self._recent[0]
        cdef Py_ssize_t k
        for k in range(1, self._count):
            shortest = min(shortest, self._recent[k])
        return shortest

    def compare_velocities(self, SE2 middle):
        """Compare the velocities by the stamps with those by evened intervals, at the `middle` of a found scan.

        Scans that were dropped leave exact stamps at uneven intervals, stamps that jitter leave even intervals at
        inexact stamps. By the right intervals the velocity changes less.
        """
        cdef SE2 step
        if self._middle is not None:
            step = self._middle.inverse() @ middle
            if max(fabs(step.x), fabs(step.y), fabs(step.theta)) < LEAST_MOTION:
                return
            compare(&self._by_stamps, step)
            compare(&self._evened, step)
        self._middle, self._by_stamps.since, self._evened.since = middle, 0.0, 0.0

    cdef double _doubt(self):
        """Return the standard deviation of the choice between both intervals: at most 0.5."""
        cdef double ratio = (self._by_stamps.changes + <double> TINY) / (self._evened.changes + <double> TINY)
        return 1.0 / sqrt(ratio * ratio + 1.0 / (ratio * ratio) + 2.0)

    cdef double _evened_interval(self, double elapsed, double scan_duration):
        """Return the interval [s] if stamps jitter: `elapsed` [s] only where it is near the median.

        Where a scan takes a time, it is rounded to a whole multiple (at least 1) of the median interval between
        successive scans.
        """
        cdef double typical
        if not scan_duration:
            typical = self._typical()
            return elapsed if 0.5 * typical <= elapsed <= MAX_RATIO * typical else typical
        if not self._positive_count:
            return 0.0
        typical = 2.0 * max(self._positive[self._positive_count // 4], scan_duration)
        typical = self._median(self._number_below(typical))
        return typical * max(rint(elapsed / typical), 1.0)

    def jumps(self, stamp, parameters):
        """Whether a `stamp` [ns] differs from the last one by more than `time.max_jump`."""
        return self._last is not None and seconds(abs(stamp - self._last)) > parameters.max_jump

    cpdef double ratio(self, double scan_duration):
        """Return the ratio, at most 1, by which to reduce `scan_duration` [s] so that it fits the median interval."""
        cdef double typical = self._typical()
        return typical / scan_duration if 0.0 < typical < OVERLAP_RATIO * scan_duration else 1.0

    @property
    def typical(self):
        """The median interval [s]; 0 while none is known."""
        return self._typical()

    cdef double _typical(self):
        """Return `typical`."""
        return self._median(self._positive_count)

    cdef double _median(self, Py_ssize_t count):
        """Return the median of the first `count` of the `_positive` intervals [s]; 0 if there are none."""
        cdef Py_ssize_t middle = count // 2
        if count % 2 or not count:
            return self._positive[middle] if count else 0.0
        return (self._positive[middle - 1] + self._positive[middle]) / 2


cdef void compare(Alternative *intervals, SE2 step):
    """Add the change of the velocity by a `step` since `compare_velocities`."""
    cdef double time = max(intervals.since, MIN_INTERVAL)
    cdef Twist before = intervals.velocity, now = Twist(step.x / time, step.y / time, step.theta / time)
    cdef double x = now.x - before.x, y = now.y - before.y, turn = now.turn - before.turn
    intervals.changes = KEPT * intervals.changes + (x * x + y * y + turn * turn)
    intervals.velocity = now
