# SPDX-License-Identifier: Apache-2.0
"""What moves: points of a scan in space that key frames saw to be free (people, doors, other robots); and what may move."""
import cmath
import math

import numpy as np

from ...features.free_space import bins
from ...features.oriented_points import OrientedPoints, stride
from ...features.records import Features
from ...geometry.se2 import SE2
from ...parameters.tree import Parameters


class FreeSpaceProfiles:
    """The free space that key frames saw.

    Parameters
    ----------
    views : sequence of View
    origins, turns : (K, 1) complex arrays
        Where each was seen from in the odometry frame [m], and what turns places into its own.
    """

    def __init__(self, views, origins, turns):
        nearby = [view.nearby for view in views]
        self._origins, self._turns = origins, turns
        self._near = np.concatenate(nearby)
        self._size = np.array([[len(near)] for near in nearby])
        self._first = self._size.cumsum(axis=0) - self._size

    def dynamic_points(self, cloud: OrientedPoints, pose: SE2, margin):
        """Which points of a scan stand well in front of what a key frame saw in their direction.

        Of a run of neighbours of which a good part does, all move. Where that were most of the scan the pose is wrong, unless it is
        few points that do, as of somebody who stands by a long wall: then they move alone.

        Parameters
        ----------
        cloud : Cloud
            P points in beam order.
        pose : SE2
            Where the scan is expected, in the odometry frame.
        margin : float [m]
            So far in front, farther where points are noisy, and so far apart are neighbours of two runs.

        Returns
        -------
        (P,) bool array
        """
        places = cmath.exp(1j * pose.theta) * cloud.points + complex(pose.x, pose.y) - self._origins
        places *= self._turns
        near = self._near.take(self._first + bins(places, self._size))
        near -= np.abs(places)
        moving = (near > cloud.tolerance(margin)).any(axis=0)
        if not moving.any():
            return moving
        run = np.concatenate(([0], _cuts(cloud, margin).cumsum()))
        share = np.bincount(run, moving) / np.bincount(run)
        whole = moving | (share[run] > _GOOD_PART)
        if whole.mean() < _MOST:
            return whole
        return moving if moving.mean() < _FEW else np.zeros_like(moving)


def without_dynamic_points(features: Features, pose: SE2, window, parameters: Parameters) -> Features:
    """The scan without what moves, and with little of what may move, if it was taken from `pose`.

    Parameters
    ----------
    features : Features
    pose : SE2
        In the odometry frame.
    window : Window
        What key frames saw.
    """
    p = parameters.odometry
    walls = features.wall_points
    movable = detached_points(walls, p.movable_size, p.dynamic_margin, features.scan.geometry.closed)
    if p.dynamic_key_frames:
        moving = window.free_space_profiles(p.dynamic_key_frames).dynamic_points(features.oriented_points, pose, p.dynamic_margin)
        if moving.any():
            gone = moving[:len(walls)]
            movable = (movable | beside(walls, gone, p.dynamic_margin))[~gone]
            features = features.without(moving)
            walls = features.wall_points
    movable = movable.nonzero()[0]
    if len(movable) and information_ratio(walls, movable) < p.movable_information_ratio:
        movable = movable[:0]
    if features.poles:
        movable = np.concatenate((movable, np.arange(len(walls), len(features.oriented_points))))
    if not len(movable):
        return features
    things = features.oriented_points.select(movable)
    seen = window.confirmed(pose, things, p.static_baseline, parameters.refinement.score_scale, parameters.density.min_normal_cosine)
    return features.downweighted(movable, np.maximum(seen, movable_weights(things, p.movable_size, p.dynamic_margin, p.movable_weight)))


def beside(cloud: OrientedPoints, moving, margin):
    """Which points lie close to what moves: the rest of it, most likely, where it leans against a wall.

    Parameters
    ----------
    cloud : Cloud
        P points in beam order.
    moving : (P,) bool array
    margin : float [m]
        No farther than this from the last point that moves, or from the next one.

    Returns
    -------
    (P,) bool array
    """
    size, order = len(cloud), np.arange(len(cloud))
    last = np.maximum.accumulate(np.where(moving, order, -1))
    following = np.minimum.accumulate(np.where(moving, order, size)[::-1])[::-1]
    points = np.append(cloud.points, np.inf)
    return np.minimum(np.abs(points[last] - cloud.points), np.abs(points[following] - cloud.points)) <= margin


def detached_points(cloud: OrientedPoints, size, margin, closed):
    """Which points belong to small things that stand free: with deeper space on both sides, or the end of the scan.

    Parameters
    ----------
    cloud : Cloud
        P points in beam order.
    size : float [m]
        Things are smaller than this.
    margin : float [m]
        So much deeper, and so far apart are neighbours of two things.
    closed : bool
        The beams go all the way round: the first follows the last.

    Returns
    -------
    (P,) bool array
    """
    points = cloud.points
    if not len(points):
        return np.zeros(0, dtype=bool)
    cut, shift = _cuts(cloud, margin).nonzero()[0] + 1, 0
    if closed and len(cut) and abs(points[0] - points[-1]) <= margin:
        shift = cut[0]
        points, cut = np.roll(points, -shift), cut[1:] - shift
    edge = np.concatenate(([0], cut, [len(points)]))
    first, radius = edge[:-1], np.abs(points)
    start, end = radius[first], radius[edge[1:] - 1]
    before, after = np.concatenate((end[-1:], end[:-1])), np.concatenate((start[1:], start[:1]))
    if not closed:
        before[0] = after[-1] = np.inf
    x, y = (np.maximum.reduceat(part, first) - np.minimum.reduceat(part, first) for part in (points.real, points.imag))
    free = (np.hypot(x, y) < size) & (before > start + margin) & (after > end + margin)
    found = free.repeat(edge[1:] - first)
    return np.roll(found, shift) if shift else found


def movable_weights(cloud: OrientedPoints, size, margin, least):
    """What the points of things that may move count, as there are more of them elsewhere.

    One thing that goes along with the sensor makes it seem to stand; several, each in a place of its own, do not move as one.
    A thing counts in full where those that are not beside it weigh four times as much, and the `least` below twice as much.

    Parameters
    ----------
    cloud : Cloud
        P points of such things.
    size : float [m]
        Things no farther apart than this may be one.
    margin : float [m]
        As in `detached_points`.
    least : float

    Returns
    -------
    (P,) array
        From `least` to 1.
    """
    thing = np.concatenate(([0], _cuts(cloud, margin).cumsum()))
    each = cloud.weighted(np.ones(len(cloud)))
    weight, centre = np.bincount(thing, each), np.bincount(thing, cloud.points.real) + 1j * np.bincount(thing, cloud.points.imag)
    centre /= np.bincount(thing)
    some = slice(None, None, stride(len(centre), _THINGS))
    party = (np.abs(centre[:, None] - centre[some]) <= size) @ weight[some]
    return np.clip(0.5 * (weight[some].sum() - party) / np.maximum(party, 1e-9) - 1.0, least, 1.0)[thing]


def information_ratio(cloud: OrientedPoints, chosen):
    """What share of all that holds the translation those points have that `chosen`, indices, picks: that of the direction in
    which it is greatest, from 0 to 1.
    """
    (xx, xy, yy), (part_xx, part_xy, part_yy) = _information(cloud.normals), _information(cloud.normals.take(chosen))
    determinant = max(xx * yy - xy * xy, 1e-9)
    both = (xx * part_yy - 2.0 * xy * part_xy + yy * part_xx) / determinant
    product = (part_xx * part_yy - part_xy * part_xy) / determinant
    return 0.5 * (both + math.sqrt(max(both * both - 4.0 * product, 0.0)))


def _information(normals):
    x, y = normals.real, normals.imag
    return float(x @ x), float(x @ y), float(y @ y)


def _cuts(cloud, margin):
    """``(P - 1,)`` bool: where a point and the next belong to two things."""
    return np.abs(cloud.points[1:] - cloud.points[:-1]) > margin


_THINGS = 100
"""Where there are more things that may move, every so-manieth stands for all."""
_GOOD_PART = 0.3
"""Of a run, so that all of it moves."""
_MOST = 0.4
"""Of a scan: where as much seems to move, the pose is wrong."""
_FEW = 0.2
"""Of a scan: so few may be all that moves of a longer run."""
