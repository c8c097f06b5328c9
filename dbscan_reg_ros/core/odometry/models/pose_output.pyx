# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True
"""Published poses: with the Manhattan heading correction and the zero-velocity update."""
import numpy as np

from libc.math cimport INFINITY

from ...geometry.symmetric_matrix import mahalanobis

from ...geometry.plane cimport wrap
from ...geometry.se2 cimport SE2, motion

cdef:
    # Rest is not detected from poses with a larger standard deviation [m], [rad].
    double MAX_SIGMA = 0.02
    # Number of scans in the running mean.
    Py_ssize_t MAX_COUNT = 50
    # The sensor is at rest if its pose stays within the gate for this time [s]: even slow motion leaves the gate.
    double MIN_REST_TIME = 1.0


cdef class ZeroVelocityUpdate:
    """Zero-velocity update (ZUPT): the pose of a sensor at rest is the mean over its scans.

    Parameters
    ----------
    pose : SE2
        First pose of the sensor, which is assumed to be at rest.
    """

    cdef SE2 _mean
    cdef Py_ssize_t _count
    cdef double _rest_time

    def __init__(self, SE2 pose):
        self._mean, self._count, self._rest_time = pose, 1, INFINITY

    cpdef SE2 update(self, SE2 pose, const double[:, :] covariance, double interval, double gate):
        """Average the pose of a scan with the poses of earlier scans, if the sensor is at rest.

        Parameters
        ----------
        pose : SE2
            Pose of the scan.
        covariance : (3, 3) float
            Covariance of `pose` in the frame of the sensor [m, m, rad].
        interval : float [s]
            Time since the last scan.
        gate : float
            If the Mahalanobis distance of `pose` from the mean exceeds this, the sensor has moved.

        Returns
        -------
        SE2
            The mean pose since the sensor came to rest, if it has been at rest for more than 1 s; otherwise `pose`.
        """
        cdef SE2 mean = self._mean, offset = mean.inverse() @ pose
        cdef double gain
        # A direction that is hardly constrained proves no rest: the pose of a moving sensor stays within its gate.
        if covariance[0, 0] + covariance[1, 1] + covariance[2, 2] > MAX_SIGMA * MAX_SIGMA:
            variance, axes = np.linalg.eigh(covariance)
            covariance = axes * np.minimum(variance, MAX_SIGMA * MAX_SIGMA) @ axes.T
        if mahalanobis((offset.x, offset.y, offset.theta), covariance) > gate * gate:
            self._mean, self._count, self._rest_time = pose, 1, 0.0
            return pose
        self._count, self._rest_time = min(self._count + 1, MAX_COUNT), self._rest_time + interval
        gain = 1.0 / self._count
        self._mean = motion(mean.x + gain * (pose.x - mean.x), mean.y + gain * (pose.y - mean.y),
                            wrap(mean.theta + gain * wrap(pose.theta - mean.theta)))
        return self._mean if self._rest_time > MIN_REST_TIME else pose


cdef class PoseOutput:
    """Converts the poses of registered scans to published poses.

    The heading correction is applied to the published poses only; scans are registered without it.

    Parameters
    ----------
    pose : SE2
        First pose of the sensor.
    number : int
        Number of the next scan.

    Attributes
    ----------
    number : int
        Number of the next scan: the number of scans published before it; a reset does not set it back to 0.
    """

    cdef readonly Py_ssize_t number
    cdef SE2 _correction, _published
    cdef ZeroVelocityUpdate _zero_velocity

    def __init__(self, SE2 pose, Py_ssize_t number):
        self._correction, self._published, self.number = SE2(), pose, number
        self.restart(pose)

    cpdef restart(self, SE2 pose):
        """Restart the zero-velocity update at `pose`."""
        self._zero_velocity = ZeroVelocityUpdate(pose)

    cpdef SE2 corrected(self, SE2 pose):
        """Transform a `pose` into the published odometry frame."""
        return self._correction @ pose

    def rotate_heading(self, SE2 pose, double rotation):
        """Add a `rotation` [rad] about the sensor at `pose` to the heading correction."""
        cdef SE2 published = self.corrected(pose)
        self._correction = motion(published.x, published.y, published.theta + rotation) @ pose.inverse()

    def averaged(self, SE2 pose, covariance, double interval, double gate):
        """Apply `ZeroVelocityUpdate.update`."""
        return self._zero_velocity.update(pose, covariance, interval, gate)

    def publish(self, SE2 pose):
        """Return the published pose for `pose`, and the increment in the frame of the previously published pose."""
        cdef SE2 before = self._published
        self.number += 1
        self._published = self.corrected(pose)
        return self._published, before.inverse() @ self._published
