# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
from ...geometry.se2 cimport SE2


cdef class ScanMiddle:
    # Pose of the first sensor in the middle of this scan, in the odometry frame.
    cdef SE2 pose
    # Time [s] from the middle of this scan to the stamp of the last scan of any sensor.
    cdef double time
    # Whether a direction of the translation was degenerate for this scan.
    cdef bint degenerate
    # Number of scans of all sensors, up to this scan, that constrained every direction.
    cdef Py_ssize_t constrained_count


cdef class ScanMiddles:
    # `ScanMiddle` of each sensor by its name.
    cdef dict scans
    cdef add(self, sensor, SE2 pose, double time, bint degenerate, Py_ssize_t constrained_count)
    cdef elapse(self, double interval)
    cdef move(self, SE2 correction)
    cdef ScanMiddle before(self, sensor)
