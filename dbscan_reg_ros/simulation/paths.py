# SPDX-License-Identifier: Apache-2.0
"""Smooth robot paths through way points: rounded corners, limited speed, turns on the spot, pauses."""
import itertools
import math
from dataclasses import dataclass

import numpy as np

from ..core.geometry.se2 import wrap

STEP = 0.01
"""Distance [m] and time [s] between successive points of a path."""
SHARPEST = math.radians(120.0)
"""The robot rotates on the spot where its heading changes by more than this [rad]."""
STRAIGHT = 1e-6
"""Corners with a change of heading up to this [rad] are not rounded."""


@dataclass(frozen=True, eq=False)
class Path:
    """Pose of a robot over time, interpolated linearly between K points."""

    times: np.ndarray
    """Times of the points, increasing from 0 ``(K,)`` [s]."""
    poses: np.ndarray
    """Poses of the points ``(K, 3)``: x, y [m], theta [rad], not wrapped."""

    @property
    def duration(self):
        """Time of the last point [s]."""
        return float(self.times[-1])

    @property
    def length(self):
        """Distance driven over all points [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())

    def until(self, seconds) -> 'Path':
        """Return the part of the path before the time `seconds` [s]; all of it if it is shorter."""
        if seconds >= self.duration:
            return self
        before = self.times < seconds
        end = [np.interp(seconds, self.times, column) for column in self.poses.T]
        return Path(np.append(self.times[before], seconds), np.vstack((self.poses[before], end)))

    def poses_at(self, times):
        """Return the poses (N, 3) at `times` (N,) [s]; headings are in [-pi, pi)."""
        x, y, theta = (np.interp(times, self.times, column) for column in self.poses.T)
        return np.stack((x, y, wrap(theta)), axis=1)


def follow(way_points, speed=0.8, acceleration=0.5, turn_rate=0.9, radius=0.4, pauses=None) -> Path:
    """Return the path through way points of a robot whose heading is its direction of motion.

    Parameters
    ----------
    way_points : (W, 2) float [m]
        At least two way points; successive ones must differ.
    speed, acceleration, turn_rate : float
        Upper limits [m/s], [m/s^2], [rad/s].
    radius : float
        Radius of the rounded corners [m]; smaller where the way points are close together.
    pauses : dict, optional
        Index of a way point -> time of standstill there [s].
    """
    way_points = np.asarray(way_points, dtype=float)
    pauses = pauses or {}
    steps = np.diff(way_points, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    stops = [k for k in range(1, len(steps)) if k in pauses or abs(wrap(headings[k] - headings[k - 1])) > SHARPEST]
    pieces = [_stand(way_points[0], headings[0], pauses.get(0, 0.0))]
    for first, last in itertools.pairwise([0, *stops, len(steps)]):
        pieces.append(_turn(pieces[-1][1][-1], headings[first], turn_rate))
        pieces.append(_drive(way_points[first:last + 1], pieces[-1][1][-1, 2], speed, acceleration, turn_rate, radius))
        pieces.append(_stand(way_points[last], pieces[-1][1][-1, 2], pauses.get(last, 0.0)))
    return _joined(pieces)


def _stand(point, heading, seconds):
    return np.array([0.0, seconds]), np.array([(*point, heading)] * 2)


def _turn(pose, heading, turn_rate):
    """Return a rotation on the spot with limited angular acceleration."""
    angle = wrap(heading - pose[2])
    seconds = 1.5 * abs(angle) / turn_rate
    times = np.linspace(0.0, seconds, 2 + int(seconds / STEP))
    share = times / seconds if seconds else times
    turned = angle * share**2 * (3.0 - 2.0 * share)
    return times, np.column_stack((np.tile(pose[:2], (len(times), 1)), pose[2] + turned))


def _drive(points, heading, speed, acceleration, turn_rate, radius):
    """Return the times and poses of a drive along straight lines and arcs, from standstill to standstill."""
    lengths, turns = _rounded(points, radius)
    knots = np.concatenate(([0.0], np.cumsum(lengths)))
    way = np.linspace(0.0, knots[-1], 2 + int(knots[-1] / STEP))
    step = way[1]
    heading_at = np.concatenate(([heading], heading + np.cumsum(turns)))
    between = np.interp(way[:-1] + 0.5 * step, knots, heading_at)
    moves = step * np.stack((np.cos(between), np.sin(between)), axis=1)
    positions = points[0] + np.concatenate((np.zeros((1, 2)), np.cumsum(moves, axis=0)))
    positions += (way / way[-1])[:, None] * (points[-1] - positions[-1])
    bend = np.abs(np.gradient(np.interp(way, knots, heading_at), way))
    squared = np.minimum(speed, turn_rate / np.maximum(bend, 1e-9))**2
    squared[[0, -1]] = 0.0
    gain = 2.0 * acceleration * way
    squared = np.minimum.accumulate(squared - gain) + gain
    squared = np.minimum.accumulate((squared + gain)[::-1])[::-1] - gain
    velocity = np.sqrt(np.maximum(squared, 0.0))
    times = np.concatenate(([0.0], np.cumsum(2.0 * step / (velocity[:-1] + velocity[1:]))))
    return times, np.column_stack((positions, np.interp(way, knots, heading_at)))


def _rounded(points, radius):
    """Return length [m] and rotation [rad] of each piece of a path that alternates between lines and arcs."""
    steps = np.diff(points, axis=0)
    straight = np.hypot(*steps.T)
    turns = wrap(np.diff(np.arctan2(steps[:, 1], steps[:, 0])))
    tangent = np.minimum(radius * np.tan(0.5 * np.abs(turns)), 0.45 * np.minimum(straight[:-1], straight[1:]))
    bend = np.abs(turns) > STRAIGHT
    arc = np.where(bend, tangent * np.abs(turns) / np.tan(0.5 * np.where(bend, np.abs(turns), 1.0)), 0.0)
    straight[:-1] -= np.where(bend, tangent, 0.0)
    straight[1:] -= np.where(bend, tangent, 0.0)
    pieces = np.zeros((2 * len(straight) - 1, 2))
    pieces[::2, 0] = straight
    pieces[1::2, 0] = arc
    pieces[1::2, 1] = turns
    return pieces.T


def _joined(pieces):
    times, poses, now = [0.0], [pieces[0][1][0]], 0.0
    for piece_times, piece_poses in pieces:
        times.extend(now + piece_times[1:])
        poses.extend(piece_poses[1:])
        now = times[-1]
    times = np.array(times)
    new = np.concatenate(([True], np.diff(times) > 0.0))
    return Path(times[new], np.array(poses)[new])
