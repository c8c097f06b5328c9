# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True
"""Scans of several sensors: the last one of each, and the intervals between them."""
from .stamps import ScanInterval, jump_of, seconds

from ...geometry.se2 cimport SE2

cdef:
    # A scan may be older than the last one by this time [s]: slow lidars send a scan so long after its first beam.
    double MAX_LATE = 0.25
    # Time [s] since the last scan of a sensor up to which the velocity is computed from it.
    double MAX_OWN_TIME = 0.5
    # Time [s] from which on a velocity is computed between scans of different sensors.
    double MIN_TIME = 0.2


cdef class ScanMiddle:
    """The last scan of one sensor."""


cdef class ScanMiddles:
    """The last scan of each sensor that was registered successfully; empty if the position is unknown."""

    def __init__(self):
        self.scans = {}

    cdef add(self, sensor, SE2 pose, double time, bint degenerate, Py_ssize_t constrained_count):
        """Store the last scan of a `sensor`."""
        cdef ScanMiddle scan = ScanMiddle.__new__(ScanMiddle)
        scan.pose, scan.time, scan.degenerate, scan.constrained_count = pose, time, degenerate, constrained_count
        self.scans[sensor] = scan

    cdef elapse(self, double interval):
        """Add an `interval` [s] to the age of each scan."""
        cdef ScanMiddle scan
        for scan in self.scans.values():
            scan.time += interval

    cdef move(self, SE2 correction):
        """Move all poses by a `correction` of the odometry frame."""
        cdef ScanMiddle scan
        for scan in self.scans.values():
            scan.pose = correction @ scan.pose

    cdef ScanMiddle before(self, sensor):
        """Return the scan from which the velocity of a scan of a `sensor` is computed; None if it is to be kept.

        Over a long time the mean velocity is not the present one; over a short time an error of the mounting dominates.
        """
        cdef ScanMiddle own = self.scans.get(sensor), latest = None, scan
        for scan in self.scans.values():
            if latest is None or scan.time < latest.time:
                latest = scan
        if own is latest or (own is not None and own.time <= MAX_OWN_TIME):
            return own
        return latest if latest.time >= MIN_TIME else None


cdef class ScanOrder:
    """Stamps of the scans of all sensors, in the order in which they are used."""

    # Name of the sensor of the last scan, and its stamp [ns]; None before the first scan.
    cdef tuple _last
    # Whether scans of several sensors were used.
    cdef bint _several

    def lateness(self, sensor, stamp, parameters):
        """Return by how much [s] a scan is older than the last scan of another sensor; 0 if tolerable or a jump."""
        if self._last is None or self._last[0] == sensor:
            return 0.0
        late = seconds(self._last[1] - stamp)
        return late if MAX_LATE < late <= parameters.max_jump else 0.0

    def time_since_last(self, stamp):
        """Return the time [s] from the last scan of any sensor to a `stamp` [ns]."""
        return 0.0 if self._last is None else seconds(stamp - self._last[1])

    def since_last(self, sensor, stamp, own, stamps, parameters):
        """Add a scan of a `sensor`, and return the interval since the last scan of any sensor.

        Parameters
        ----------
        sensor : str
        stamp : int [ns]
        own : ScanInterval
            Interval since the last scan of the same sensor.
        stamps : StampFilter
            Filter of the stamps of this sensor.
        parameters : TimeParameters

        Returns
        -------
        ScanInterval
            `own` if the last scan was of the same sensor, by the stamps once scans of several sensors were used: of one
            sensor alone they are too irregular then to tell jitter from dropped scans. Otherwise the difference of the
            stamps. It is negative if the new scan is older than the last one: then the state is predicted back to the
            stamp of the new scan.
        """
        last, self._last = self._last, (sensor, stamp)
        if last is None or last[0] == sensor:
            by_stamps = self._several and own.jump is None and own.elapsed > 0.0
            return own._replace(length=own.elapsed, steady=True, sigma=0.0) if by_stamps else own
        self._several = True
        elapsed = seconds(stamp - last[1])
        if abs(elapsed) > parameters.max_jump:
            return ScanInterval(stamps.typical, max(elapsed, 0.0), own.middle_offset, *jump_of(elapsed),
                                own.missing or not own.elapsed)
        interval = own._replace(length=elapsed, elapsed=elapsed, jump=None, reason='', of_others=True)
        typical = stamps.typical
        late = typical and interval._replace(length=typical).gap
        return interval._replace(length=typical) if late else interval

