# SPDX-License-Identifier: Apache-2.0
"""Detection of dynamic points (people, doors, robots), which lie in free space of key frames, and movable objects."""
import math

import numpy as np
from numpy.typing import NDArray

from ...features.oriented_points import OrientedPoints
from ...features.records import Features
from ...geometry.se2 import SE2
from ...geometry.tolerance import TINY
from ...parameters.tree import Parameters
from .key_frame_window import KeyFrameWindow, confirm
from .stacked_lookup import FreeSpaceStack


def without_dynamic_points(features: Features, pose: SE2, window: KeyFrameWindow, parameters: Parameters,
                           sensor: str = '') -> Features:
    """Remove the dynamic points of a scan, and reduce the weights of movable objects.

    Movable objects and poles keep their weight if a key frame from another position contains them at the same place.

    Parameters
    ----------
    features : Features
    pose : SE2
        Pose of the scan in the odometry frame.
    window : KeyFrameWindow
    parameters : Parameters
    sensor : str
        Name of the sensor of the scan. Only its own key frames show free space: a lidar at another height sees over
        what this one sees.
    """
    p = parameters.odometry
    features, candidates = _remove_dynamic(features, pose, window.of_sensor(sensor), parameters)
    walls = features.wall_points
    movable = candidates.nonzero()[0]
    step = features.backend.step
    if len(movable) and step(information_ratio)(walls, movable) < p.movable_information_ratio:
        movable = movable[:0]
    if features.poles:
        movable = np.concatenate((movable, np.arange(len(walls), len(features.oriented_points))))
    if not len(movable):
        return features
    points = features.oriented_points.select(movable)
    confirmed = step(confirm)(window, pose, points, p.static_baseline, parameters.refinement.score_scale,
                              parameters.density.min_normal_cosine)
    return features.downweighted(movable, np.maximum(confirmed, p.movable_weight))


def _remove_dynamic(features: Features, pose: SE2, window: KeyFrameWindow,
                    parameters: Parameters) -> tuple[Features, NDArray[np.bool_]]:
    """Remove the dynamic points; also return which of the remaining wall points are movable."""
    p, walls = parameters.odometry, features.wall_points
    step, points = features.backend.step, features.oriented_points
    movable = step(detached_points)(walls, p.movable_size, p.dynamic_margin, features.scan.geometry.closed)
    if not p.dynamic_key_frames:
        return features, movable
    free_space, static = window.free_space(p.dynamic_key_frames), np.ones(len(points), dtype=bool)
    static[:len(walls)] = ~movable
    dynamic = step(dynamic_points)(points, pose, free_space, p.dynamic_margin, static)
    if not dynamic.any():
        return features, movable
    removed = dynamic[:len(walls)]
    movable = (movable | step(beside)(walls, removed, p.dynamic_margin))[~removed]
    return features.without(dynamic), movable


def dynamic_points(points: OrientedPoints, pose: SE2, free_space: FreeSpaceStack, margin: float,
                   static: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Determine which points of a scan are dynamic.

    Points in free space are dynamic, and so are all points of a group of neighbouring points if many of them lie in
    free space. If too many of the static points would then be dynamic, only the points in free space are (a person
    beside a long wall). If these are too many as well, the pose is wrong, and no point is dynamic. Movable objects in
    free space do not show that the pose is wrong: many people may walk around the sensor.

    Parameters
    ----------
    points : OrientedPoints
        P points in beam order.
    pose : SE2
        Predicted pose of the scan in the odometry frame.
    free_space : FreeSpaceStack
    margin : float [m]
        A point is in free space if it lies at least this far in front of the returns of a key frame. Neighbouring
        points farther apart than this belong to different groups.
    static : (P,) bool
        Points that do not belong to movable objects. If there are none, all points count as static.

    Returns
    -------
    (P,) bool
    """
    in_free_space = free_space.contains(points, pose, margin)
    if not in_free_space.any():
        return in_free_space
    run = _run_of_point(points, margin)
    ratio = np.bincount(run, in_free_space) / np.bincount(run)
    dynamic = in_free_space | (ratio[run] > _MIN_RUN_RATIO)
    judged = static if static.any() else np.ones_like(static)
    if dynamic[judged].mean() < _MAX_SCAN_RATIO:
        return dynamic
    return in_free_space if in_free_space[judged].mean() < _MAX_FREE_SPACE_RATIO else np.zeros_like(in_free_space)


def beside(points: OrientedPoints, dynamic: NDArray[np.bool_], margin: float) -> NDArray[np.bool_]:
    """Determine which points lie close to dynamic points; most likely they belong to the same object beside a wall.

    Parameters
    ----------
    points : OrientedPoints
        P points in beam order.
    dynamic : (P,) bool
    margin : float [m]
        Largest distance of such a point from the last dynamic point before it, or from the first one after it, in
        beam order.

    Returns
    -------
    (P,) bool
    """
    size, order = len(points), np.arange(len(points))
    last = np.maximum.accumulate(np.where(dynamic, order, -1))
    following = np.minimum.accumulate(np.where(dynamic, order, size)[::-1])[::-1]
    padded = np.append(points.points, np.inf)
    before, after = np.abs(padded[last] - points.points), np.abs(padded[following] - points.points)
    near: NDArray[np.bool_] = np.minimum(before, after) <= margin
    return near


def detached_points(points: OrientedPoints, size: float, margin: float, closed: bool) -> NDArray[np.bool_]:
    """Determine which points belong to small detached objects: both neighbouring points are farther away, or missing.

    Parameters
    ----------
    points : OrientedPoints
        P points in beam order.
    size : float [m]
        Only objects smaller than this are detected.
    margin : float [m]
        Least difference in range between the object and the points on both sides. Neighbouring points farther apart
        than this belong to different objects.
    closed : bool
        Whether the beams cover the full circle, so that the first beam is a neighbour of the last beam.

    Returns
    -------
    (P,) bool
    """
    position = points.points
    if not len(position):
        return np.zeros(0, dtype=bool)
    cut, shift = _cuts(points, margin).nonzero()[0] + 1, 0
    if closed and len(cut) and abs(position[0] - position[-1]) <= margin:
        shift = cut[0]
        position, cut = np.roll(position, -shift), cut[1:] - shift
    edge = np.concatenate(([0], cut, [len(position)]))
    first, radius = edge[:-1], np.abs(position)
    start, end = radius[first], radius[edge[1:] - 1]
    before, after = np.concatenate((end[-1:], end[:-1])), np.concatenate((start[1:], start[:1]))
    if not closed:
        before[0] = after[-1] = np.inf
    width, height = (np.maximum.reduceat(part, first) - np.minimum.reduceat(part, first)
                     for part in (position.real, position.imag))
    is_small = (np.hypot(width, height) < size) & (before > start + margin) & (after > end + margin)
    mask = is_small.repeat(edge[1:] - first)
    return np.roll(mask, shift) if shift else mask


def information_ratio(points: OrientedPoints, chosen: NDArray[np.intp]) -> float:
    """Return the fraction of the information about the translation that the `chosen` points (indices) provide.

    Returns
    -------
    float
        Largest fraction over all directions of the translation, from 0 to 1: the largest generalised eigenvalue.
    """
    (xx, xy, yy), (part_xx, part_xy, part_yy) = _information(points.normals), _information(points.normals.take(chosen))
    determinant = max(xx * yy - xy * xy, TINY)
    half_trace = 0.5 * (xx * part_yy - 2.0 * xy * part_xy + yy * part_xx) / determinant
    product = (part_xx * part_yy - part_xy * part_xy) / determinant
    return half_trace + math.sqrt(max(half_trace * half_trace - product, 0.0))


def _information(normals: NDArray[np.complex128]) -> tuple[float, float, float]:
    """Return the information (xx, xy, yy) that points with these `normals` provide about the translation."""
    x, y = normals.real, normals.imag
    return float(x @ x), float(x @ y), float(y @ y)


def _cuts(points: OrientedPoints, margin: float) -> NDArray[np.bool_]:
    """Return ``(P - 1,)``: whether a point and the next one are more than the `margin` [m] apart."""
    cuts: NDArray[np.bool_] = np.abs(points.points[1:] - points.points[:-1]) > margin
    return cuts


def _run_of_point(points: OrientedPoints, margin: float) -> NDArray[np.intp]:
    """Return ``(P,)``: index of the group of each point; neighbours in one group are at most `margin` [m] apart."""
    return np.concatenate(([0], _cuts(points, margin).cumsum()))


_MIN_RUN_RATIO = 0.3
"""If more than this fraction of a group of neighbouring points lie in free space, all its points are dynamic."""
_MAX_SCAN_RATIO = 0.4
"""If at least this fraction of the static points of a scan would be dynamic, only points in free space are."""
_MAX_FREE_SPACE_RATIO = 0.2
"""If at least this fraction of the static points lie in free space, the pose is wrong and no point is dynamic."""
