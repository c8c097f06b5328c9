# SPDX-License-Identifier: Apache-2.0
"""Scans and segments of walls that are known exactly."""
import dataclasses
import math

import numpy as np

from dbscan_reg_ros.core.features.records import EndKind, Segments
from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.simulation.raycasting import cast

DEGREE = math.radians(1.0)
FULL = ScanGeometry(-math.pi, DEGREE, 360)
HALF = ScanGeometry(-0.5 * math.pi, DEGREE, 180)
L_ROOM = np.array([(-2.0, -1.5), (4.0, -1.5), (4.0, 1.0), (1.5, 1.0), (1.5, 3.0), (-2.0, 3.0)])
"""Corners of a room [m], all of which are seen from its origin."""
FOUR_WALLS = ([(0.0, -2.0), (6.0, -2.0)], [(6.0, -2.0), (6.0, 1.0)], [(5.0, 2.0), (2.0, 3.5)],
              [(-1.0, 2.5), (-3.0, 0.5)])
"""First and last point [m] of walls of four directions."""


def outline(corners):
    """Walls (S, 2, 2) from corner to corner, round and back."""
    corners = np.asarray(corners, dtype=float)
    return np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)


def seen(bearings, *walls):
    """Points (N, 2) where beams meet the first of the lines ``n . p = d``."""
    directions = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
    ranges = np.full(len(bearings), np.inf)
    for normal, distance in walls:
        ranges = np.minimum(ranges, distance / np.maximum(directions @ np.array(normal), 1e-9))
    return ranges[:, None] * directions


def wall():
    """A straight wall 2 m ahead, of 21 beams."""
    return seen(0.02 * np.arange(-10, 11), ((1.0, 0.0), 2.0))


def corner(vertex=10.0):
    """21 beams into a square corner that lies at beam `vertex`, counted in fractions of a beam."""
    half = math.sqrt(0.5)
    return seen(0.02 * (np.arange(21) - vertex), ((half, half), 2.0), ((half, -half), 2.0))


def pushed(points, errors):
    """The points with beams that are too long, by errors [m]: number of a beam -> error."""
    points = points.copy()
    for beam, error in errors.items():
        points[beam] *= 1.0 + error / np.hypot(*points[beam])
    return points


def look(walls, pose=SE2(), geometry=FULL, noise=0.0, seed=0) -> Scan:
    """What a lidar at `pose` measures of walls (S, 2, 2) [m]."""
    angles = geometry.bearings + pose.theta
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    ranges = cast(np.array([[pose.x, pose.y]]), directions, np.asarray(walls, dtype=float), np.empty((0, 3)))
    return Scan(0, ranges + np.random.default_rng(seed).normal(0.0, noise, len(ranges)), geometry)


def with_person(scan, bearing):
    """The scan with a person a metre ahead of the sensor, and which beams hit them."""
    body = np.array([(math.cos(bearing), math.sin(bearing), 0.25)])
    ranges = cast(np.zeros((1, 2)), scan.geometry.directions, np.empty((0, 2, 2)), body)
    hidden = ranges < scan.ranges
    return dataclasses.replace(scan, ranges=np.where(hidden, ranges, scan.ranges)), hidden


def room_log(path, count):
    """A CARMEN log of a stationary sensor in a room of 7 m by 5 m."""
    x, y = (np.array(f(np.radians(np.arange(-90, 90)))) for f in (np.cos, np.sin))
    with np.errstate(divide='ignore'):
        ranges = np.minimum(np.where(x > 0, 4.0, 3.0) / np.abs(x), np.where(y > 0, 2.0, 3.0) / np.abs(y))
    words = ' '.join(f'{r:.3f}' for r in ranges)
    path.write_text(''.join(f'FLASER 180 {words} 0 0 0 0 0 0 {10 + 0.1 * k:.1f} host {0.1 * k:.1f}\n'
                            for k in range(count)))
    return path


def segments_between(*ends, kind=EndKind.OCCLUSION, sigma=1e-3):
    """Segments between the given pairs of points [m], with the standard deviation `sigma` [m, rad]."""
    ends = np.asarray(ends, dtype=float).reshape(-1, 2, 2)
    along, spread = ends[:, 1] - ends[:, 0], np.full(len(ends), sigma)
    return Segments(ends[:, 0], ends[:, 1], np.arctan2(along[:, 1], along[:, 0]), np.hypot(*along.T), spread, spread,
                    np.full((len(ends), 2), kind, dtype=int), np.zeros((len(ends), 2), dtype=int))


def moved(segments, motion):
    """The segments as seen after `motion`."""
    back = motion.inverse()
    return Segments(back.apply(segments.start), back.apply(segments.end), wrap(segments.direction - motion.theta),
                    segments.length, segments.sigma_direction, segments.sigma_offset, segments.kinds, segments.beams)
