# SPDX-License-Identifier: Apache-2.0
"""Office floors of 60 x 40 m, and routes through them."""
import dataclasses
import itertools
import math

import numpy as np

from dbscan_reg_ros.simulation import World
from dbscan_reg_ros.simulation.worlds import box, clearance, furnished, furniture, wall

LENGTH, DEPTH, WIDTH = 60.0, 40.0, 2.2
"""Length and depth of a floor, and width of its corridors [m]."""
CLEAR = 0.5
"""Distance [m] of moved furniture from the tour."""
LARGEST = 1.6
"""Length [m] of the largest piece of furniture."""
PILASTER = 0.2
"""How far [m] pilasters stand out of the walls of the corridors."""
AISLES = -10.0, 10.0
"""y of the two long corridors; two short ones join their ends."""


def floor(seed, rooms=7, alike=False) -> World:
    """Return a floor of two corridors with `rooms` on either side of each; neighbouring rooms differ in size.

    The tour visits every room of the first corridor, then those of the second. If they are `alike`, only the ends of
    the two corridors differ, where others join them.
    """
    rng = np.random.default_rng(seed)
    walls = [wall((x, -0.5 * DEPTH), (x, 0.5 * DEPTH)) for x in (0.0, LENGTH)]
    walls += [wall((0.0, y), (LENGTH, y)) for y in (-0.5 * DEPTH, 0.5 * DEPTH)]
    left, right = WIDTH, LENGTH - WIDTH
    boxes, bins, visits = [], [], {}
    for aisle in AISLES:
        rng = np.random.default_rng(seed) if alike else rng
        for side in (-1.0, 1.0):
            inner, outer = aisle + 0.5 * side * WIDTH, aisle + side * 10.0
            shares = rng.uniform(0.6, 1.4, rooms)
            cuts = left + (right - left) * np.concatenate(([0.0], np.cumsum(shares) / shares.sum()))
            doors = rng.uniform(cuts[:-1] + 1.0, cuts[1:] - 1.0)
            walls.append(wall((left, inner), (right, inner), doors - left))
            walls += [wall((x, inner), (x, outer)) for x in cuts]
            if outer == 0.0 and side > 0.0:
                walls.append(wall((left, outer), (right, outer)))
            boxes += [box(x, inner - 0.5 * side * PILASTER, 0.4, PILASTER, 0.0) for x in rng.uniform(left, right, 12)
                      if np.abs(x - doors).min() > 1.0]
            for low, high, door in zip(cuts[:-1], cuts[1:], doors, strict=True):
                room_boxes, room_bins = furniture((low, high, *sorted((inner, outer))), rng, count=8)
                boxes += room_boxes
                bins += room_bins
                depth = rng.uniform(2.5, 6.0)
                visits.setdefault(aisle, []).append((door, inner + side * depth))
    middle, end = 0.5 * WIDTH, LENGTH - 0.5 * WIDTH
    there, back = (_along(aisle, visits[aisle]) for aisle in AISLES)
    tour = np.array([(middle, AISLES[0]), *there, (end, AISLES[0]), (end, AISLES[1]), *back[::-1], (middle, AISLES[1]),
                     (middle, AISLES[0] + 1.0)])
    return furnished(walls, boxes, bins, tour)


def _along(aisle, rooms):
    """Return the way points of a drive along a corridor into each room and out again."""
    points = []
    for x, y in sorted(rooms):
        points += [(x, aisle), (x, y), (x, aisle + 0.05)]
    return points


def moved(world, share, seed) -> World:
    """Return the world with this `share` of its round columns and boxes moved by up to a metre, clear of the tour."""
    rng = np.random.default_rng(seed)
    segments, circles, none = world.segments.copy(), world.circles.copy(), np.empty((0, 2, 2))
    way = np.concatenate([np.linspace(a, b, 2 + int(math.dist(a, b) / 0.2)) for a, b in itertools.pairwise(world.tour)])
    size = np.hypot(*(segments[:, 1] - segments[:, 0]).T).reshape(-1, 4).round(6)
    for number in np.flatnonzero((size.max(axis=1) <= LARGEST) & (size.min(axis=1) > PILASTER)):
        piece = segments[4 * number:4 * number + 4] + rng.uniform(-1.0, 1.0, 2)
        if rng.random() < share and clearance(way, piece, np.empty((0, 3))).min() > CLEAR:
            segments[4 * number:4 * number + 4] = piece
    for number, circle in enumerate(circles):
        column = circle + np.append(rng.uniform(-1.0, 1.0, 2), 0.0)
        if rng.random() < share and clearance(way, none, column[None]).min() > CLEAR:
            circles[number] = column
    return dataclasses.replace(world, segments=segments, circles=circles)


def route(world, seed, length=14.0) -> np.ndarray:
    """Return a route of at least `length` [m] along a part of the tour, in the other direction and a little aside."""
    rng = np.random.default_rng(seed)
    way, start = world.tour[::-1], rng.integers(len(world.tour) - 4)
    points = [way[start] + rng.uniform(0.2, 0.8) * (way[start + 1] - way[start])]
    for point in way[start + 1:]:
        points.append(point + rng.uniform(-0.25, 0.25, 2))
        if sum(math.dist(a, b) for a, b in itertools.pairwise(points)) > length:
            break
    return np.array(points)


def comes_to_an_end(way, metres) -> bool:
    """Return whether a route (N, 2) comes to where the corridors are joined within so many metres."""
    outside = (way[:, 0] < WIDTH) | (way[:, 0] > LENGTH - WIDTH)
    return bool(outside[np.append(0.0, np.hypot(*np.diff(way, axis=0).T).cumsum()) <= metres].any())
