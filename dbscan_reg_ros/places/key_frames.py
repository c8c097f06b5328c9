# SPDX-License-Identifier: Apache-2.0
"""The key frames of a drive, and the loops among them: places that the sensor saw before."""
from typing import NamedTuple

import numpy as np

from ..core.features.records import Features
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..core.registration.status import demoted_if_poor
from ..evaluation.metrics import path_lengths
from ..recordings.poses import relative
from .pose_graph import Constraints, PoseGraph, optimise

AWAY = 10.0
"""Two scans close a loop only if the sensor has driven at least this distance [m] between them."""
NEAR, DRIFT = 1.0, 0.01
"""Two scans close a loop only if their distance is at most this [m], plus this fraction of the distance driven."""
TURNED = 0.35
"""A loop that corrects the heading by more than this [rad] is rejected."""
TRIED = 3
"""Largest number of earlier key frames, nearest first, to which each key frame is registered."""
STEP_SPREAD = np.array((0.005, 0.005, 0.002))
"""Standard deviation [m, m, rad] added to the registration covariance of a motion between key frames."""
UNKNOWN_SPREAD = np.array((1.0, 1.0, 1.0))
"""Standard deviation [m, m, rad] of a motion between key frames if a scan between them was not registered."""


class KeyFrame(NamedTuple):
    """A key frame of the drive.

    `number` is the number of its scan among the scans used; `covariance` (3, 3) is that of the motion since the
    previous key frame, in the frame of this key frame.
    """

    number: int
    features: Features
    covariance: np.ndarray


class Loop(NamedTuple):
    """A place seen again.

    `pair` are the numbers of two key frames, the earlier first; `motion` (3,) is the pose of the later one in the frame
    of the earlier, and `covariance` (3, 3) belongs to it, in the frame of the later one.
    """

    pair: tuple[int, int]
    motion: np.ndarray
    covariance: np.ndarray


class KeyFrames:
    """Collect the key frames of a drive, and find its loops. Poses are those of the `Odometry`."""

    def __init__(self):
        self.frames = []
        # Whether all scans since the last key frame were registered.
        self._known = True

    def add(self, update):
        """Process the `OdometryUpdate` of the next scan: store its features if the scan is a key frame."""
        if self.frames and update.reference_number == self.frames[-1].number:
            self.frames[-1] = self.frames[-1]._replace(features=update.reference)
        self._known &= update.registration is not None and not update.restarted
        if update.reference_changed:
            covariance = (update.registration.covariance + np.diag(STEP_SPREAD) ** 2 if self._known
                          else np.diag(UNKNOWN_SPREAD) ** 2)
            self.frames.append(KeyFrame(update.number, update.features, covariance))
            self._known = True

    @property
    def numbers(self):
        """(K,) int number of the scan of each key frame."""
        return np.array([frame.number for frame in self.frames], dtype=int)

    def find_loops(self, poses, parameters):
        """Yield each `Loop` of the drive.

        Parameters
        ----------
        poses : (N, 3) array
            Poses of the `Odometry` at every scan that was used [m, m, rad].
        parameters : Parameters
            Parameters of the registration.
        """
        places, way = poses[self.numbers], path_lengths(poses)[self.numbers]
        for late, frame in enumerate(self.frames):
            apart = np.hypot(*(places[:late, :2] - places[late, :2]).T)
            since = way[late] - way[:late]
            apart[(since < AWAY) | (apart > NEAR + DRIFT * since)] = np.inf
            for early in np.argsort(apart, kind='stable')[:TRIED]:
                if not np.isfinite(apart[early]):
                    break
                found = demoted_if_poor(register(self.frames[early].features, frame.features, parameters),
                                        parameters.decision)
                if found.status is not Status.OK:
                    continue
                motion = found.transform.as_array()
                off = relative(relative(places[early][None], places[late][None]), motion[None])[0]
                if np.hypot(*off[:2]) <= NEAR + DRIFT * since[early] and abs(off[2]) <= TURNED:
                    yield Loop((early, late), motion, found.covariance + np.diag(STEP_SPREAD) ** 2)
                    break

    def graph(self, poses, parameters) -> PoseGraph:
        """Return the pose graph of the key frames, optimised with all loops; the parameters are as in `find_loops`."""
        found, before = list(self.find_loops(poses, parameters)), poses[self.numbers]
        steps = np.column_stack((np.arange(len(before) - 1), np.arange(1, len(before))))
        covariances = np.array([*(frame.covariance for frame in self.frames[1:]), *(loop.covariance for loop in found)])
        constraints = Constraints(np.array([*steps, *(loop.pair for loop in found)], dtype=int).reshape(-1, 2),
                                  np.vstack((relative(before[:-1], before[1:]), *(loop.motion for loop in found))),
                                  covariances.reshape(-1, 3, 3))
        return PoseGraph(optimise(before, constraints) if found else before, constraints)
