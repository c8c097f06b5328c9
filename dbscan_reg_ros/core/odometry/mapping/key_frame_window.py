# SPDX-License-Identifier: Apache-2.0
"""The window: the last key frames, each with its own surface, and the alignment of a scan with all of them at once."""
import cmath
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...features.oriented_points import high_leverage
from ...features.records import Features
from ...geometry.robust_kernel import kernel
from ...geometry.se2 import SE2, wrap
from ...geometry.symmetric_matrix import solve_one
from ...registration.point_to_line import linear_residuals, normal_equations, origins
from .dynamic_points import FreeSpaceProfiles
from .local_map import seen_around


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """A scan that others are registered to.

    Attributes
    ----------
    features : Features
    pose : SE2
        In the odometry frame.
    known : bool
        Whether it is known in every direction where it lies among the others.
    number : int
        `OdometryUpdate.number` of its scan: the same when the features of the scan are made anew.
    """

    features: Features
    pose: SE2
    known: bool = True
    number: int = 0


class LikelihoodFieldStack:
    """Several surfaces behind one another: row k of a table of places is looked up in surface k.

    Parameters
    ----------
    surfaces : sequence of Surface
    origins, turns : (K, 1) complex arrays
        Where each lies in the odometry frame [m], and what turns places into its own.

    Attributes
    ----------
    normals, offsets, along, extents : (N,) arrays
        Of all surfaces, as in `LikelihoodField`.
    """

    def __init__(self, surfaces, origins, turns):
        self._scale = turns / np.array([[s.cell] for s in surfaces])
        self._corner = origins * self._scale + np.array([[s.origin / s.cell] for s in surfaces])
        self._last = np.array([s.shape for s in surfaces]).T[:, :, None] - 1
        # The tables are large: they stay where they are.
        self._tables = [s.index for s in surfaces]
        size = np.array([len(s.normals) for s in surfaces])
        self._none, self._first = size[:, None] - 1, np.cumsum(size) - size
        self.normals, self.offsets, self.along, self.extents = (
            np.concatenate([getattr(s, name) for s in surfaces]) for name in ('normals', 'offsets', 'along', 'extents'))

    def nearest(self, places):
        """The points nearest to those of the `places` ``(K, P)`` (complex, [m], odometry frame) that have one, M of them.

        Returns
        -------
        at, row : (M,) int arrays
            Index of the place in the flattened table, and its row.
        nearest : (M,) int array
            Index of the point.
        """
        cells = places * self._scale
        cells -= self._corner
        cells, column = cells.real.astype(np.intp), cells.imag.astype(np.intp)
        for part, last in zip((cells, column), self._last):
            np.maximum(part, 0, out=part)
            np.minimum(part, last, out=part)
        cells *= self._last[1] + 1
        cells += column
        found = np.concatenate([table[cell] for table, cell in zip(self._tables, cells)]).reshape(cells.shape)
        at = (found != self._none).ravel().nonzero()[0]
        row = at // found.shape[1]
        return at, row, found.take(at) + self._first.take(row)


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Points of a scan and the lines of the key frames that they lie on, M pairs of them.

    Attributes
    ----------
    pose : SE2
        Where the scan was when they were looked for, in the odometry frame.
    size : int
        Points of the scan.
    index : (M,) int
        The point of each pair.
    arms : (M,) complex [m]
        Turned points.
    rows : (4, M) float
        `alignment.linear_residuals` at the pose, the rotation about the sensor.
    worth : (M,) float or None
        What each point counts, from 0 to 1; None: all the same.
    """

    pose: SE2
    size: int
    index: np.ndarray
    rotated_points: np.ndarray
    rows: np.ndarray
    weights: np.ndarray | None = None

    def match(self, step, scale):
        """Errors [m] and weights ``(M,)`` after a `step` ``(4,)`` from the pose, as for `alignment.linear_residuals`.

        Every point counts at most once, however many lines it lies on.
        """
        error = step @ self.rows
        weight = kernel(error, scale)
        weight /= np.maximum(np.bincount(self.index, weight, self.size), 1.0).take(self.index)
        return error, weight if self.weights is None else weight * self.weights

    def equations(self, step, scale):
        """``(4, 4)``, as `alignment.normal_equations`, at the pose, with the weights after a `step`."""
        return normal_equations(self.rows, self.match(step, scale)[1])

    def moved(self, other: SE2):
        """How far [m] the points have come, on average, when the scan is at another pose."""
        x, y, theta = _apart(self.pose, other)
        ways = np.abs(complex(x, y) + (cmath.exp(1j * theta) - 1.0) * self.rotated_points)
        return float(ways.sum()) / max(len(ways), 1)

    def step(self, other: SE2):
        """The step ``(4,)`` from the pose to another [m, m, rad, 1]."""
        return np.array((*_apart(self.pose, other), 1.0))


def _apart(one, other):
    return other.x - one.x, other.y - one.y, wrap(other.theta - one.theta)


class KeyFrameWindow:
    """Key frames, latest last, and their surfaces; immutable.

    Parameters
    ----------
    frames : sequence of KeyFrame
    """

    def __init__(self, frames):
        self.frames = tuple(frames)
        poses = np.array([(frame.pose.x, frame.pose.y, frame.pose.theta) for frame in self.frames])
        self._origins, self._turns = origins(poses), np.exp(-1j * poses[:, 2:])
        self._stack = LikelihoodFieldStack([frame.features.likelihood_field for frame in self.frames], self._origins, self._turns)
        self._sights = {}

    @property
    def latest(self):
        return self.frames[-1]

    @cached_property
    def local_map(self) -> Features:
        """What the latest saw, and what older ones whose places are known did around it."""
        latest = self.latest
        older = [frame for frame in self.frames[:-1] if frame.known]
        if not older:
            return latest.features
        return replace(latest.features, map_points=seen_around(older, latest, latest.features.density))

    def with_frame(self, frame, size, latest=True):
        """A window of at most `size` key frames with one more, the `latest` or the one before it."""
        at = len(self.frames) - (not latest)
        return KeyFrameWindow((*self.frames[:at], frame, *self.frames[at:])[-size:])

    def free_space_profiles(self, count) -> FreeSpaceProfiles:
        """Of the latest so many key frames."""
        if count not in self._sights:
            views = [frame.features.free_space for frame in self.frames[-count:]]
            self._sights = {count: FreeSpaceProfiles(views, self._origins[-count:], self._turns[-count:])}
        return self._sights[count]

    def correspondences(self, pose: SE2, cloud, density) -> Correspondences:
        """The lines of all key frames that the points of a scan at `pose` lie on.

        Points of high leverage are looked up in every key frame. The others, where a scan has many, are dealt to the key
        frames in turn, each of them to several.
        """
        dealt = _dealt(high_leverage(cloud.normals), cloud.beams, len(self.frames), density.max_points // _HANDS)
        _, index, rotated_points, normals, error = self._lines(pose, cloud, dealt, density.min_normal_cosine)
        weights = None if cloud.weights is None else cloud.weights.take(index)
        return Correspondences(pose, len(cloud), index, rotated_points, linear_residuals(error, normals, rotated_points), weights)

    def confirmed(self, pose: SE2, cloud, distance, scale, facing):
        """How well points of a scan at `pose` stand where a key frame saw them from more than `distance` [m] away.

        Parameters
        ----------
        scale : float [m]
            Of the kernel of their distances from its lines.
        facing : float
            As in `alignment.fit`.

        Returns
        -------
        (P,) array
            From 0 to 1.
        """
        found = np.zeros(len(cloud))
        away = np.abs(self._origins[:, 0] - complex(pose.x, pose.y)) > distance
        if away.any():
            everywhere = np.tile(np.arange(len(cloud)), (len(self.frames), 1))
            row, index, _, _, error = self._lines(pose, cloud, everywhere, facing)
            np.maximum.at(found, index, kernel(error, scale) * away.take(row))
        return found

    def _lines(self, pose, cloud, dealt, facing):
        """Lines of the key frames that the points ``dealt[k]`` of a scan at `pose` may lie on, M pairs of them.

        Returns
        -------
        row, index : (M,) int arrays
            Key frame and point.
        arms, normals : (M,) complex arrays
            Turned points [m], and conjugated normals of the lines, times the cloud's `inverse_noise`.
        error : (M,) array
            Signed distance [m], times the same.
        """
        turn, origin = cmath.exp(1j * pose.theta), complex(pose.x, pose.y)
        rotated_points = turn * cloud.points
        at, row, nearest = self._stack.nearest((rotated_points + origin).take(dealt))
        index = dealt.take(at)
        normals = self._stack.normals.take(nearest) * self._turns.take(row)
        rotated_points = rotated_points.take(index)
        apart = normals * (rotated_points + (origin - self._origins.take(row)))
        error, beside = apart.real - self._stack.offsets.take(nearest), apart.imag - self._stack.along.take(nearest)
        kept = (normals * (turn * cloud.normals).take(index)).real > facing
        kept &= np.abs(beside) <= self._stack.extents.take(nearest)
        row, index, rotated_points, normals, error = row[kept], index[kept], rotated_points[kept], normals[kept], error[kept]
        if cloud.inverse_noise is not None:
            inverse_noise = cloud.inverse_noise.take(index)
            normals, error = normals * inverse_noise, error * inverse_noise
        return row, index, rotated_points, normals, error


_FRAMES_A_POINT = 3
"""Every point is looked up in at least so many key frames."""
_HANDS = 3
"""A key frame looks up at most `density.max_points` over this of the points that are dealt."""


def _dealt(everywhere, beams, frames, most):
    """``(frames, N)`` indices of the points that are looked up in each key frame: those `everywhere`, a mask, picks, and
    about so many of the others.

    By their beams, so that one point more or less does not change the partners of all others. Short hands are filled up.
    """
    always, others = everywhere.nonzero()[0], (~everywhere).nonzero()[0]
    hands = max(min(frames // _FRAMES_A_POINT, -(-len(others) // most)), 1)
    turn = beams.take(others) % hands
    hand = [others[turn == k] for k in range(hands)]
    size = max(map(len, hand))
    full = np.array([np.resize(each if len(each) else others, size) for each in hand])
    dealt = np.empty((frames, len(always) + size), dtype=np.intp)
    dealt[:, :len(always)] = always
    dealt[:, len(always):] = full[np.arange(frames) % hands]
    return dealt


def align(correspondences: Correspondences, start: SE2, expected: SE2, strength, scales, damping) -> SE2:
    """The pose of a scan after robust point-to-line iterations against all key frames, one for each of the `scales` [m].

    Parameters
    ----------
    partners : Partners
        Of the scan at a pose nearby.
    start : SE2
        The pose to start from.
    expected : SE2
        The pose that a prior asks for.
    strength : (3, 3) array
        The prior's information in the odometry frame, in units of a point's.
    """
    pose, step = correspondences.pose, correspondences.step(start)
    pull = strength @ _apart(expected, pose)
    for scale in scales:
        equations = correspondences.equations(step, scale)
        equations[:3, :3] += strength
        equations[:3, 3] += pull
        step[:3] = -solve_one(equations, damping)
    x, y, theta, _ = step.tolist()
    return SE2(pose.x + x, pose.y + y, wrap(pose.theta + theta))
