# SPDX-License-Identifier: Apache-2.0
"""Loop closing after a drive: correct the trajectory where the sensor returned to a place.

The odometry uses only its key-frame window, because its pose must not jump. A map that is drawn after the drive may be
corrected as a whole.
"""
from typing import NamedTuple

import numpy as np

from ..core.features.records import Features
from ..core.geometry.se2 import SE2, turned, wrap
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..core.registration.status import demoted_if_poor
from ..evaluation.metrics import path_lengths
from ..recordings.poses import compose, relative

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
ROBUST = 3.0
"""Scale of the robust kernel of the pose graph, in standard deviations of a residual."""
ROUNDS, CONVERGED = 20, 1e-6
"""Largest number of Gauss-Newton iterations, and the step [m, rad] below which the iterations end."""


class Stop(NamedTuple):
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


class Loops:
    """Collect the key frames of a drive; `close` corrects the poses."""

    def __init__(self):
        self._frames = []
        # Whether all scans since the last key frame were registered.
        self._known = True

    def add(self, update):
        """Process the `OdometryUpdate` of the next scan: store its features if the scan is a key frame."""
        if self._frames and update.reference_number == self._frames[-1].number:
            self._frames[-1] = self._frames[-1]._replace(features=update.reference)
        self._known &= update.registration is not None and not update.restarted
        if update.reference_changed:
            covariance = (update.registration.covariance + np.diag(STEP_SPREAD) ** 2 if self._known
                          else np.diag(UNKNOWN_SPREAD) ** 2)
            self._frames.append(Stop(update.number, update.features, covariance))
            self._known = True

    def close(self, poses, parameters, yaw=0.0):
        """Correct the poses so that they agree with the odometry and all loops.

        Parameters
        ----------
        poses : (N, 3) array
            Poses of the sensor at every scan that was used [m, m, rad].
        parameters : Parameters
            Parameters of the registration.
        yaw : float
            Angle [rad] by which `sensor_mounting.turned` rotated the scans before the odometry.

        Returns
        -------
        poses : (N, 3) array
            Corrected poses; the first pose is unchanged.
        loops : (L, 2) int array
            Numbers of the two scans of each loop.
        """
        return self.correct(poses, list(self.find(poses, parameters, yaw)), yaw)

    def correct(self, poses, found, yaw=0.0):
        """Correct the poses by the loops in `found`, a list of `Loop`; the rest is as in `close`."""
        if not found:
            return poses, np.empty((0, 2), dtype=int)
        numbers = self.numbers
        pairs, motions, covariances = (np.array(part) for part in zip(*found))
        steps = np.column_stack((np.arange(len(numbers) - 1), np.arange(1, len(numbers))))
        before = poses[numbers]
        after = agree(before, np.vstack((steps, pairs)),
                      np.vstack((relative(before[:-1], before[1:]), motions)),
                      np.concatenate(([turned(frame.covariance, -yaw) for frame in self._frames[1:]], covariances)))
        return _carried(poses, numbers, after), numbers[pairs]

    @property
    def numbers(self):
        """(K,) int number of the scan of each key frame."""
        return np.array([frame.number for frame in self._frames], dtype=int)

    def find(self, poses, parameters, yaw=0.0):
        """Yield each `Loop` of a drive; the parameters are those of `close`."""
        turn, places, way = SE2(theta=yaw), poses[self.numbers], path_lengths(poses)[self.numbers]
        for late, frame in enumerate(self._frames):
            apart = np.hypot(*(places[:late, :2] - places[late, :2]).T)
            since = way[late] - way[:late]
            apart[(since < AWAY) | (apart > NEAR + DRIFT * since)] = np.inf
            for early in np.argsort(apart, kind='stable')[:TRIED]:
                if not np.isfinite(apart[early]):
                    break
                found = demoted_if_poor(register(self._frames[early].features, frame.features, parameters),
                                        parameters.decision)
                if found.status is not Status.OK:
                    continue
                motion = (turn.inverse() @ found.transform @ turn).as_array()
                off = relative(relative(places[early][None], places[late][None]), motion[None])[0]
                if np.hypot(*off[:2]) <= NEAR + DRIFT * since[early] and abs(off[2]) <= TURNED:
                    yield Loop((early, late), motion, turned(found.covariance + np.diag(STEP_SPREAD) ** 2, -yaw))
                    break


def agree(poses, pairs, motions, covariances):
    """Optimise a pose graph by robust Gauss-Newton (Lu and Milios 1997).

    Parameters
    ----------
    poses : (K, 3) array [m, m, rad]
        Initial values; the first pose is fixed.
    pairs : (E, 2) int array
    motions : (E, 3) array
        Measured motion of each pair: the second pose in the frame of the first pose.
    covariances : (E, 3, 3) array
        Covariances of the motions, in the frame of the second pose.

    Returns
    -------
    (K, 3) array
    """
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import spsolve

    poses = poses.copy()
    first, second = pairs.T
    covariances = np.array([turned(c, theta) for c, theta in zip(covariances, motions[:, 2], strict=True)])
    root = np.linalg.inv(np.linalg.cholesky(covariances))
    rows = np.arange(3 * len(pairs)).reshape(-1, 3, 1)
    rows = np.broadcast_to(rows, (len(pairs), 3, 6))
    columns = np.broadcast_to(np.concatenate((3 * first[:, None] + np.arange(3), 3 * second[:, None] + np.arange(3)),
                                             axis=1)[:, None], rows.shape)
    held = diags(np.concatenate(([1e9] * 3, [1e-9] * (3 * len(poses) - 3))))
    for _ in range(ROUNDS):
        now = relative(poses[first], poses[second])
        error = now - motions
        error[:, 2] = wrap(error[:, 2])
        error = np.einsum('eij,ej->ei', root, error)
        weight = 1.0 / np.sqrt(1.0 + (error ** 2).sum(axis=1, keepdims=True) / ROBUST ** 2)
        c, s = np.cos(poses[first, 2]), np.sin(poses[first, 2])
        zero, one = np.zeros(len(pairs)), np.ones(len(pairs))
        jacobian = np.array([[-c, -s, now[:, 1], c, s, zero], [s, -c, -now[:, 0], -s, c, zero],
                             [zero, zero, -one, zero, zero, one]]).transpose(2, 0, 1)
        jacobian = weight[:, :, None] * (root @ jacobian)
        matrix = coo_matrix((jacobian.ravel(), (rows.ravel(), columns.ravel()))).tocsc()
        step = spsolve((matrix.T @ matrix + held).tocsc(), -(matrix.T @ (weight * error).ravel())).reshape(-1, 3)
        poses += step
        if np.abs(step).max() < CONVERGED:
            break
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def _carried(poses, numbers, after):
    """Correct all poses: interpolate between the corrections of the previous and the next key frame."""
    each = np.arange(len(poses))
    last = np.clip(np.searchsorted(numbers, each, 'right') - 1, 0, len(numbers) - 1)
    following = np.minimum(last + 1, len(numbers) - 1)
    share = np.clip((each - numbers[last]) / np.maximum(numbers[following] - numbers[last], 1), 0.0, 1.0)[:, None]
    by_last, by_following = (compose(after[k], relative(poses[numbers[k]], poses)) for k in (last, following))
    gap = by_following - by_last
    gap[:, 2] = wrap(gap[:, 2])
    moved = by_last + share * gap
    moved[:, 2] = wrap(moved[:, 2])
    return moved
