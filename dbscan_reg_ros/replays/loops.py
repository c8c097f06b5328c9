# SPDX-License-Identifier: Apache-2.0
"""Poses of a whole drive that agree wherever the sensor came back to a place.

The odometry looks no farther back than its window, and must not: its pose may not leap. A map that is drawn when all is
over may be bent until the places seen twice lie on one another.
"""
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import spsolve

from ..core.features.records import Features
from ..core.geometry.se2 import SE2, turned, wrap
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..evaluation.metrics import path_lengths
from ..recordings.poses import compose, relative

AWAY = 10.0
"""A place is seen again when the sensor has gone at least this far [m] in between,"""
NEAR, DRIFT = 1.0, 0.01
"""and is back as near as this [m], and this share of the way in between."""
TURNED = 0.35
"""A loop that turns the drive by more than this [rad] is not believed."""
TRIED = 3
"""Key frames, nearest first, that each is registered to."""
OVERLAP = 0.5
"""Least share of the returns that must lie on the earlier scan's surfaces."""
STEP_SPREAD = np.array((0.005, 0.005, 0.002))
"""Of a motion between key frames [m, m, rad], beside what the registration says: errors that neighbours share."""
UNKNOWN_SPREAD = np.array((1.0, 1.0, 1.0))
"""Of a motion over a scan that was not found."""
ROBUST = 3.0
"""A relation so many standard deviations off counts half."""
ROUNDS = 20


class Stop(NamedTuple):
    """A key frame on the way.

    `number` is that of its scan among those used, `covariance` (3, 3) that of its motion since the last, in its own frame.
    """

    number: int
    features: Features
    covariance: np.ndarray


class Loops:
    """Collects the key frames of a drive; `close` makes the poses agree."""

    def __init__(self):
        self._frames = []
        # Whether all scans since the last key frame tell of the motion.
        self._known = True

    def add(self, update):
        """Take note of the `OdometryUpdate` of the next scan."""
        if self._frames and update.reference_number == self._frames[-1].number:
            self._frames[-1] = self._frames[-1]._replace(features=update.reference)
        self._known &= update.registration is not None and not update.restarted
        if update.reference_changed:
            covariance = update.registration.covariance + np.diag(STEP_SPREAD) ** 2 if self._known else np.diag(UNKNOWN_SPREAD) ** 2
            self._frames.append(Stop(update.number, update.features, covariance))
            self._known = True

    def close(self, poses, parameters, yaw=0.0):
        """Poses that suit the odometry and every place that was seen again.

        Parameters
        ----------
        poses : (N, 3) array
            Of the sensor at every scan that was used [m, m, rad].
        parameters : Parameters
            Of the registration.
        yaw : float
            The scans are turned by so much [rad] against the poses, as `sensor_mounting.turned` makes them.

        Returns
        -------
        poses : (N, 3) array
            The first stays where it is.
        loops : (L, 2) int array
            Which scans were laid on which.
        """
        numbers = np.array([frame.number for frame in self._frames], dtype=int)
        found = list(self._loops(poses, path_lengths(poses)[numbers], parameters, yaw))
        if not found:
            return poses, np.empty((0, 2), dtype=int)
        pairs, motions, covariances = (np.array(part) for part in zip(*found))
        steps = np.column_stack((np.arange(len(numbers) - 1), np.arange(1, len(numbers))))
        before = poses[numbers]
        after = agree(before, np.vstack((steps, pairs)),
                      np.vstack((relative(before[:-1], before[1:]), motions)),
                      np.concatenate(([turned(frame.covariance, -yaw) for frame in self._frames[1:]], covariances)))
        return _carried(poses, numbers, after), numbers[pairs]

    def _loops(self, poses, way, parameters, yaw):
        """(pair of key frames, motion between them, its covariance) wherever a place is seen again."""
        turn, places = SE2(theta=yaw), poses[[frame.number for frame in self._frames]]
        for late, frame in enumerate(self._frames):
            apart = np.hypot(*(places[:late, :2] - places[late, :2]).T)
            since = way[late] - way[:late]
            apart[(since < AWAY) | (apart > NEAR + DRIFT * since)] = np.inf
            for early in np.argsort(apart, kind='stable')[:TRIED]:
                if not np.isfinite(apart[early]):
                    break
                found = register(self._frames[early].features, frame.features, parameters)
                if found.status is not Status.OK or found.overlap < OVERLAP:
                    continue
                motion = (turn.inverse() @ found.transform @ turn).as_array()
                off = relative(relative(places[early][None], places[late][None]), motion[None])[0]
                if np.hypot(*off[:2]) <= NEAR + DRIFT * since[early] and abs(off[2]) <= TURNED:
                    yield (early, late), motion, turned(found.covariance + np.diag(STEP_SPREAD) ** 2, -yaw)
                    break


def agree(poses, pairs, motions, covariances):
    """Poses that suit relations between them: robust Gauss-Newton on the graph (Lu and Milios 1997).

    Parameters
    ----------
    poses : (K, 3) array [m, m, rad]
        Where to start; the first stays.
    pairs : (E, 2) int array
    motions : (E, 3) array
        The second pose of each pair in the frame of the first.
    covariances : (E, 3, 3) array
        Of the motions, in the frame of the second pose.

    Returns
    -------
    (K, 3) array
    """
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
        if np.abs(step).max() < 1e-6:
            break
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def _carried(poses, numbers, after):
    """All poses, each moved as the key frames before and behind it are, by its place between them."""
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
