# SPDX-License-Identifier: Apache-2.0
"""Odometry by ours, by its rivals and by the baselines: ``process(scan, told) -> Step``.

``told(expected)`` is the `Prior` of the motion since the last scan that somebody tells, where `expected` is the `Prior`
of a motion that goes on as before.
"""
import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ..core.errors import ScanError
from ..core.geometry.se2 import SE2
from ..core.odometry.pipeline import Odometry
from ..core.parameters.tree import Parameters
from ..core.registration.records import Prior, Status
from ..recordings.poses import relative
from ..robot.parameters import NodePriorParameters
from .methods import kiss_config, lifted, method, planar

KEY_FRAME_DISTANCE = 0.3
KEY_FRAME_ANGLE = math.radians(15.0)


@dataclass(frozen=True)
class Step:
    """What a tracker says of one scan.

    Attributes
    ----------
    pose : SE2
        Of the sensor in the frame of the first scan.
    status : Status
    degenerate_direction : float or None
        Along which the translation is not determined [rad], in the frame of the first scan.
    covariance : (3, 3) float or None
        Of `pose`, in the frame of the first scan.
    registration : None
        It says nothing of single registrations.
    restarted : bool
        It never starts again by itself.
    """

    pose: SE2
    status: Status = Status.OK
    degenerate_direction: float | None = None
    covariance: np.ndarray | None = None
    registration: None = None
    restarted: bool = False


class Ours:
    """The package's own `Odometry`."""

    def __init__(self, parameters):
        self._odometry = Odometry(parameters)
        self._last = Step(SE2(), covariance=np.zeros((3, 3)))

    def process(self, scan, told=None) -> Step:
        try:
            update = self._odometry.process(scan, told and told(self._odometry.predict_motion(scan.stamp)))
        except ScanError:
            return dataclasses.replace(self._last, status=Status.FAILED, degenerate_direction=None)
        free = update.registration and update.registration.degenerate_direction
        free = None if free is None else update.reference_pose.theta + free
        self._last = Step(update.pose, update.status, free, update.covariance)
        return self._last


class KeyFrames:
    """Any `Method` against the last key frame, from a guess at constant velocity (a step like the last one)."""

    def __init__(self, method):
        self._method = method
        self._key = self._key_pose = None
        self._pose = self._last_step = SE2()

    def process(self, scan, told=None) -> Step:
        prepared = self._method.prepare(scan)
        if self._key is None:
            self._key, self._key_pose = prepared, self._pose
            return Step(self._pose)
        step = told(Prior(self._last_step, np.zeros((3, 3)))).transform if told else self._last_step
        result = self._method.align(self._key, prepared, self._key_pose.inverse() @ self._pose @ step)
        pose = self._key_pose @ result.transform
        self._last_step = self._pose.inverse() @ pose
        self._pose = pose
        if math.hypot(result.transform.x, result.transform.y) > KEY_FRAME_DISTANCE \
                or abs(result.transform.theta) > KEY_FRAME_ANGLE:
            self._key, self._key_pose = prepared, pose
        return Step(pose, result.status)


class Kiss:
    """KISS-ICP's own pipeline, with its map and its threshold."""

    def __init__(self):
        from kiss_icp.kiss_icp import KissICP
        self._pipeline = KissICP(kiss_config())

    def process(self, scan, told=None) -> Step:
        if not scan.valid.any():
            return Step(planar(self._pipeline.last_pose), Status.FAILED)
        self._pipeline.register_frame(lifted(scan, [0.0]), np.empty(0))
        return Step(planar(self._pipeline.last_pose))


class Still:
    """Says that nothing ever moves."""

    def process(self, scan, told=None) -> Step:
        return Step(SE2())


def tracker(name):
    """Return a fresh tracker by the name of its method.

    Raises
    ------
    BenchmarkError
        As `methods.method` does.
    """
    registration = method(name)
    if name == 'dbscan':
        return Ours(Parameters())
    if name == 'kiss-icp':
        return Kiss()
    if name == 'identity':
        return Still()
    return KeyFrames(registration)


def nobody(course) -> list:
    """Return no prior for any scan."""
    return [None] * len(course.scans)


def wheels(course) -> list:
    """Return the priors that the node makes of the course's wheel odometry."""
    def told(motion):
        return lambda expected: Prior(motion, np.diag(SPREAD(motion)) ** 2)
    if course.wheels is None:
        return nobody(course)
    return [None, *(told(SE2.from_array(motion)) for motion in relative(course.wheels[:-1], course.wheels[1:]))]


def gyroscope(course, seed=0) -> list:
    """Return the priors of a gyroscope: true rotations with a scale error of 1 % and noise of 3 mrad."""
    def told(turn):
        return lambda expected: expected.with_rotation(turn, SPREAD(SE2(0.0, 0.0, turn))[2])
    turns = relative(course.reference[:-1], course.reference[1:])[:, 2]
    return [None, *map(told, (1.01 * turns + np.random.default_rng(seed).normal(0.0, 0.003, len(turns))).tolist())]


SPREAD = NodePriorParameters().wheel_sigma
PRIORS = {'none': nobody, 'wheel': wheels, 'imu': gyroscope}
"""Name -> ``priors(course)``: what is told of each scan's motion."""
