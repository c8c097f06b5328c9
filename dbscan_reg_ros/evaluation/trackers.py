# SPDX-License-Identifier: Apache-2.0
"""Odometries of this package, of other packages and of the baselines, with one interface.

A tracker has the method ``process(scan, external=None) -> Step``.
``external(predicted)`` returns the external prior of the motion since the last scan, as a `Prior`; `predicted` is the
`Prior` of the motion model (constant velocity). If `external` is None, there is no external prior.
"""
import dataclasses
import inspect
import math
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TypeAlias

import numpy as np

from ..core.errors import ScanError
from ..core.geometry.se2 import SE2
from ..core.odometry.pipeline import Odometry
from ..core.parameters.tree import Parameters
from ..core.registration.records import Prior, Status
from ..core.scan import Scan
from ..recordings.poses import relative
from ..robot.parameter_groups import NodePriorParameters
from .baselines import Result
from .method_names import KEY_FRAME_DEGREES, KEY_FRAME_DISTANCE
from .methods import BenchmarkError, Method, kiss_config, lifted, method, planar

External: TypeAlias = Callable[[Prior], Prior] | None
"""From the prior of the motion model to an external prior."""
KEY_FRAME_ANGLE = math.radians(KEY_FRAME_DEGREES)
GYROSCOPE_SCALE, GYROSCOPE_NOISE = 1.01, 0.003
"""Errors of the simulated gyroscope: scale, and standard deviation of each rotation [rad]."""


@dataclass(frozen=True)
class Step:
    """Result of a tracker for one scan.

    Attributes
    ----------
    registration, contradicted : None
        Always None, because trackers do not report single registrations, and nothing that contradicts them.
    """

    pose: SE2
    """Pose of the sensor in the frame of the first scan."""
    status: Status = Status.OK
    degenerate_direction: float | None = None
    """Direction in which the translation is not observable [rad], in the frame of the first scan."""
    covariance: np.ndarray | None = None
    """Covariance of `pose`, in the frame of the first scan ``(3, 3)``."""
    twist: np.ndarray | None = None
    twist_covariance: np.ndarray | None = None
    """(3,) float, (3, 3) float: velocity in the frame of the sensor [m/s, m/s, rad/s], and its covariance; None without
    a result for the scan."""
    interval: float = 0.0
    """Filtered time since the last scan, if it is known [s]."""
    registration: None = None
    restarted: bool = False
    """Always False, because trackers do not restart."""
    contradicted: None = None
    contradicted_by: float = 0.0
    contradiction: str = ''


class Ours:
    """The package's own `Odometry`."""

    def __init__(self, parameters, comparisons=None):
        self._odometry = Odometry(parameters, comparisons)
        self._last = Step(SE2(), covariance=np.zeros((3, 3)))

    def process(self, scan: Scan, external: External = None) -> Step:
        """Return the odometry's update as a `Step`; a scan that cannot be used gives FAILED and the last pose."""
        try:
            update = self._odometry.process(scan, external and external(self._odometry.predict_motion(scan.stamp)))
        except ScanError:
            return dataclasses.replace(self._last, status=Status.FAILED, degenerate_direction=None,
                                       twist=None, twist_covariance=None)
        free = update.registration and update.registration.degenerate_direction
        free = None if free is None else update.reference_pose.theta + free
        self._last = Step(update.pose, update.status, free, update.covariance, update.twist,
                          update.twist_covariance, update.interval)
        return self._last


class KeyFrames:
    """Odometry that registers each scan to the last key frame with any `Method`, from a constant-velocity guess."""

    def __init__(self, method: Method):
        self._method = method
        self._key = None
        self._pose = self._last_step = self._key_pose = SE2()

    def process(self, scan: Scan, external: External = None) -> Step:
        """Align the scan to the last key frame; the guess is the external prior, or else the last motion repeated."""
        prepared = self._method.prepare(scan)
        if self._key is None:
            self._key, self._key_pose = prepared, self._pose
            return Step(self._pose)
        step = self._last_step
        if external:
            step = external(Prior(step, np.eye(3))).transform
        result = self._method.align(self._key, prepared, self._key_pose.inverse() @ self._pose @ step)
        pose = self._key_pose @ result.transform
        self._last_step = self._pose.inverse() @ pose
        self._pose = pose
        if math.hypot(result.transform.x, result.transform.y) > KEY_FRAME_DISTANCE \
                or abs(result.transform.theta) > KEY_FRAME_ANGLE:
            self._key, self._key_pose = prepared, pose
        return Step(pose, result.status)


class Kiss:
    """Odometry of KISS-ICP, with the local map and the adaptive threshold of KISS-ICP."""

    def __init__(self):
        from kiss_icp.kiss_icp import KissICP
        self._pipeline = KissICP(kiss_config())

    def process(self, scan: Scan, external: External = None) -> Step:
        """Register the scan to the map, without the external prior; a scan without returns gives FAILED."""
        if not scan.valid.any():
            return Step(planar(self._pipeline.last_pose), Status.FAILED)
        self._pipeline.register_frame(lifted(scan, [0.0]), np.empty(0))
        return Step(planar(self._pipeline.last_pose))


class Still:
    """Odometry that reports no motion: any useful method must have smaller errors."""

    def process(self, scan: Scan, external: External = None) -> Step:
        """Return the pose of the first scan for every scan."""
        return Step(SE2())


def tracker(name: str) -> 'Ours | KeyFrames | Kiss | Still':
    """Return a new tracker for the method `name`.

    ``module:function`` is a method of the user's own, imported from the current folder as well: ``function(reference,
    current, guess)`` returns the pose, an `SE2`, of the `Scan` `current` in the frame of the `Scan` `reference`, the
    last key frame. The `SE2` `guess` is the expected result: the motion from the key frame to the last scan, followed
    by the last motion between two scans repeated. ``module:Class`` names a tracker class, made without arguments:
    ``process(scan)`` returns a `Step`. Raises a BenchmarkError when the method is unknown, its package is not
    installed, or there is no such module or function.
    """
    if ':' in name:
        return _own_tracker(name)
    registration = method(name)
    if name == 'dbscan':
        return Ours(Parameters())
    if name == 'kiss-icp':
        return Kiss()
    if name == 'identity':
        return Still()
    return KeyFrames(registration)


def _own_tracker(name):
    """Return a tracker of the user's own, from ``module:function``."""
    module, _, attribute = name.partition(':')
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        own = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise BenchmarkError(f'method {name}: {error}; expected MODULE:FUNCTION, in the current folder or '
                             'installed, MODULE without .py') from error
    if inspect.isclass(own):
        return own()

    def align(reference, current, guess=None):
        try:
            pose = own(reference, current, guess or SE2())
        except Exception as error:
            raise BenchmarkError(f'method {name}: {type(error).__name__}: {error}; it was called with two scans '
                                 '(Scan), reference and current, and a guess (SE2) (-v shows where)') from error
        if not isinstance(pose, SE2):
            raise BenchmarkError(f'method {name}: returned {pose!r:.60}; expected the pose of the scan `current` as an '
                                 'SE2(x, y, theta) [m, m, rad]')
        return Result(pose, Status.OK)

    return KeyFrames(Method(name, lambda scan: scan, align))


def no_prior(course) -> list:
    """Return no prior for any scan."""
    return [None] * len(course.scans)


def wheels(course) -> list:
    """Return the priors that the node computes from the course's wheel odometry."""
    def prior(motion):
        return lambda predicted: Prior(motion, np.diag(SPREAD(motion)) ** 2)
    if course.wheels is None:
        return no_prior(course)
    return [None, *(prior(SE2.from_array(motion)) for motion in relative(course.wheels[:-1], course.wheels[1:]))]


def gyroscope(course, seed=0) -> list:
    """Return the priors of a gyroscope: true rotations with a scale error of 1 % and noise of 3 mrad."""
    def prior(rotation):
        return lambda predicted: predicted.with_rotation(rotation, SPREAD(SE2(0.0, 0.0, rotation))[2])
    rotations = relative(course.reference[:-1], course.reference[1:])[:, 2]
    noise = np.random.default_rng(seed).normal(0.0, GYROSCOPE_NOISE, len(rotations))
    return [None, *map(prior, (GYROSCOPE_SCALE * rotations + noise).tolist())]


SPREAD = NodePriorParameters().wheel_sigma
PRIORS = {'none': no_prior, 'wheel': wheels, 'imu': gyroscope}
"""Name -> ``priors(course)``, which returns the argument `external` of `process` for each scan."""
