"""Odometry by ours, by its rivals and by the baselines: ``process(scan, motion) -> Step``."""
import math
from dataclasses import dataclass

import numpy as np

from ..core.errors import ScanError
from ..core.odometry import Odometry
from ..core.parameters import Parameters
from ..core.records import Prior, Status
from ..core.se2 import SE2
from ..node.parameters import NodePriorParameters
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
    free_direction : float or None
        Along which the translation is not determined [rad], in the frame of the first scan.
    """

    pose: SE2
    status: Status = Status.OK
    free_direction: float | None = None


class Ours:
    """The package's own `Odometry`."""

    def __init__(self, parameters):
        self._odometry = Odometry(parameters)
        self._pose = SE2()

    def process(self, scan, motion=None) -> Step:
        """`motion` is what is believed of the motion since the last scan, a `Prior`."""
        try:
            update = self._odometry.process(scan, motion)
        except ScanError:
            return Step(self._pose, Status.FAILED)
        self._pose = update.pose
        free = update.registration and update.registration.free_direction
        return Step(update.pose, update.status, None if free is None else update.reference_pose.theta + free)


class KeyFrames:
    """Any `Method` against the last key frame, from a guess at constant velocity (a step like the last one)."""

    def __init__(self, method):
        self._method = method
        self._key = self._key_pose = None
        self._pose = self._last_step = SE2()

    def process(self, scan, motion=None) -> Step:
        prepared = self._method.prepare(scan)
        if self._key is None:
            self._key, self._key_pose = prepared, self._pose
            return Step(self._pose)
        step = motion.transform if motion else self._last_step
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

    def process(self, scan, motion=None) -> Step:
        self._pipeline.register_frame(lifted(scan, [0.0]), np.empty(0))
        return Step(planar(self._pipeline.last_pose))


class Still:
    """Says that nothing ever moves."""

    def process(self, scan, motion=None) -> Step:
        return Step(SE2())


def tracker(name):
    """A fresh tracker by the name of its method.

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


def wheel_prior(motion) -> Prior:
    """What the node takes wheels to say that tell it of a `motion` (an `SE2`)."""
    return Prior(motion, np.diag(NodePriorParameters().told_spread(motion)) ** 2)

