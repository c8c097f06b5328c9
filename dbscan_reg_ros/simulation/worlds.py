# SPDX-License-Identifier: Apache-2.0
"""Floor plans of walls, boxes, columns and people, each with a tour that a robot can drive."""
import dataclasses
import itertools
import math
from dataclasses import dataclass, field

import numpy as np

WALL = 0.15
DOOR = 1.0
RECESS = 0.1
CLEARANCE = 0.6
"""Furniture keeps this distance [m] from the tour."""
ASIDE, SLIM = 0.3, 0.18
"""Distance [m] of people from the tour, and radius [m] of a person, small enough for the doors on the tour."""
BOXES = 0.6
"""Fraction of the pieces of furniture that are boxes; the remaining ones are round bins."""


@dataclass(frozen=True, eq=False)
class Person:
    """A person: a circle of `radius` [m] that moves to and fro along `route` ``(K, 2)`` [m] at `speed` [m/s]."""

    route: np.ndarray
    speed: float = 1.2
    radius: float = 0.25

    def circle_at(self, time):
        """Return centre and radius (3,) [m] of the person's circle at `time` [s]."""
        route = np.asarray(self.route, dtype=float)
        way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))))
        walked = self.speed * time % (2.0 * way[-1])
        walked = min(walked, 2.0 * way[-1] - walked)
        return np.array([np.interp(walked, way, route[:, 0]), np.interp(walked, way, route[:, 1]), self.radius])


@dataclass(frozen=True, eq=False)
class World:
    """Everything that a beam can hit."""

    segments: np.ndarray
    """Start and end of each piece of wall ``(S, 2, 2)`` [m]."""
    tour: np.ndarray
    """Way points at a distance from all walls, columns and furniture ``(W, 2)`` [m]."""
    circles: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    """Centre and radius of each column ``(C, 3)`` [m]."""
    people: tuple = ()
    """tuple of Person"""

    def circles_at(self, time):
        """Return centre and radius (C + P, 3) [m] of all columns and people at `time` [s]."""
        return np.vstack((self.circles, *(person.circle_at(time) for person in self.people)))


def with_people(world, count, seed=0) -> World:
    """Return the world with `count` more people; each walks to and fro beside one leg of the tour."""
    rng = np.random.default_rng(seed)
    people = []
    for _ in range(count):
        leg = rng.integers(len(world.tour) - 1)
        start, end = world.tour[leg:leg + 2]
        along = (end - start) / max(math.dist(start, end), 1e-9)
        aside = rng.choice((-1.0, 1.0)) * ASIDE * np.array((-along[1], along[0]))
        people.append(Person(np.array([start, end]) + aside, rng.uniform(0.6, 1.4), SLIM))
    return dataclasses.replace(world, people=(*world.people, *people))


def rooms(seed=0, count=4) -> World:
    """Return a corridor with `count` furnished rooms (an even number) on either side, joined in pairs by a second door.

    The tour is made of loops: in by the door of one room, out by that of its neighbour, and back along the corridor.
    """
    rng = np.random.default_rng(seed)
    length, width = 5.5 * count, 2.2
    walls, boxes, bins, loops = [], [], [], []
    for side in (-1.0, 1.0):
        inner = side * (0.5 * width + 0.5 * WALL)
        outer = inner + side * rng.uniform(4.5, 6.0)
        shares = rng.uniform(0.8, 1.2, count)
        cuts = length * np.concatenate(([0.0], np.cumsum(shares) / shares.sum()))
        doors = rng.uniform(cuts[:-1] + 1.2, cuts[1:] - 1.2)
        middle = 0.5 * (inner + outer) + rng.uniform(-0.5, 0.5)
        walls += [wall((0.0, inner), (length, inner), doors), wall((0.0, outer), (length, outer))]
        walls += [wall((x, inner), (x, outer), [abs(middle - inner)] if k % 2 else ()) for k, x in enumerate(cuts)]
        loops += [[(a, 0.0), (a, middle), (b, middle), (b, 0.0)] for a, b in zip(doors[::2], doors[1::2], strict=True)]
        for left, right in itertools.pairwise(cuts):
            room_boxes, room_bins = furniture((left, right, *sorted((inner, outer))), rng)
            boxes += room_boxes
            bins += room_bins
    walls += [wall((x, -0.5 * width - WALL), (x, 0.5 * width + WALL)) for x in (0.0, length)]
    pairs = len(loops) // 2
    order = [loops[k + side] for k in range(pairs) for side in (0, pairs)]
    tour = np.array([(1.2, 0.0), *itertools.chain.from_iterable(order), (1.5, 0.0)])
    return furnished(walls, boxes, bins, tour)


def corridor(length=40.0, width=2.2, doors=8, seed=0) -> World:
    """Return a closed corridor along x with `doors` recesses in each side wall; with 0 it has no features."""
    rng = np.random.default_rng(seed)
    y = 0.5 * (width + WALL)
    walls = [wall((x, -y), (x, y)) for x in (0.0, length)]
    for side in (-y, y):
        places = (np.arange(doors) + rng.uniform(0.2, 0.8, doors)) * length / max(doors, 1)
        walls.append(wall((0.0, side), (length, side), places))
        if doors:
            back = side + math.copysign(RECESS, side)
            walls.append(wall((0.0, back), (length, back)))
    return furnished(walls, [], [], np.array([(1.5, 0.0), (length - 1.5, 0.0)]))


def hall(seed=0, length=26.0, depth=18.0) -> World:
    """Return a hall with two rows of columns, pilasters on its walls and clutter; the tour weaves between columns."""
    rng = np.random.default_rng(seed)
    corners = np.array([(0.0, 0.0), (length, 0.0), (length, depth), (0.0, depth)])
    walls = [wall(a, b) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    walls += [box(x, rng.choice((0.0, depth)), 0.4, 0.6, 0.0) for x in rng.uniform(1.0, length - 1.0, 6)]
    walls += [box(rng.choice((0.0, length)), y, 0.6, 0.4, 0.0) for y in rng.uniform(1.0, depth - 1.0, 4)]
    columns = [(x, y) for x in np.linspace(4.0, length - 4.0, 5) for y in (depth / 3.0, 2.0 * depth / 3.0)]
    boxes, bins = furniture((0.0, length, 0.0, depth), rng, count=14)
    bins += [(x, y, rng.uniform(0.2, 0.35)) for x, y in columns[::2]]
    boxes += [box(x, y, 0.5, 0.5, 0.0) for x, y in columns[1::2]]
    near, far = 2.2, depth - 2.2
    tour = np.array([(2.0, near), (length - 2.2, near), (length - 2.2, 0.5 * depth), (2.2, 0.5 * depth), (2.2, far),
                     (length - 2.2, far), (length - 2.2, 0.5 * depth), (0.5 * length, 0.5 * depth),
                     (0.5 * length, near), (2.0, near)])
    return furnished(walls, boxes, bins, tour)


def wall(start, end, openings=(), opening=DOOR, thickness=WALL):
    """Return the segments of a straight wall with gaps `opening` wide at distances `openings` from its start [m]."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = math.dist(start, end)
    forward = (end - start) / length
    angle = math.atan2(forward[1], forward[0])
    edges = [-0.5 * thickness]
    for place in sorted(openings):
        edges += [place - 0.5 * opening, place + 0.5 * opening]
    edges.append(length + 0.5 * thickness)
    return np.concatenate([box(*(start + 0.5 * (a + b) * forward), b - a, thickness, angle)
                           for a, b in zip(edges[::2], edges[1::2], strict=True)])


def box(x, y, length, width, angle):
    """Return the sides (4, 2, 2) of a rectangle with the centre (x, y) [m] and its length along `angle` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    corners = 0.5 * np.array([(-length, -width), (length, -width), (length, width), (-length, width)])
    corners = corners @ np.array([(c, s), (-s, c)]) + (x, y)
    return sides(corners)


def sides(corners):
    """Return the sides (N, 2, 2) of the polygon with these `corners` (N, 2) [m]."""
    return np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)


def furniture(bounds, rng, count=7):
    """Return random boxes, a list of (4, 2, 2), and bins, a list of (x, y, radius), within `bounds` [m]."""
    left, right, bottom, top = bounds
    boxes, bins = [], []
    for _ in range(count):
        x, y = rng.uniform(left + 0.5, right - 0.5), rng.uniform(bottom + 0.5, top - 0.5)
        if rng.random() < BOXES:
            angle = rng.choice((0.0, rng.uniform(0.0, math.pi)))
            boxes.append(box(x, y, rng.uniform(0.5, 1.6), rng.uniform(0.3, 0.8), angle))
        else:
            bins.append((x, y, rng.uniform(0.08, 0.25)))
    return boxes, bins


def clearance(points, segments, circles):
    """Return the distance (N,) [m] of each of the `points` (N, 2) from the nearest surface; negative in a circle."""
    edges = segments[:, 1] - segments[:, 0]
    offsets = points[:, None] - segments[:, 0]
    along = np.clip((offsets * edges).sum(axis=-1) / (edges**2).sum(axis=-1), 0.0, 1.0)
    to_segments = np.linalg.norm(offsets - along[..., None] * edges, axis=-1).min(axis=1, initial=np.inf)
    to_circles = np.linalg.norm(points[:, None] - circles[:, :2], axis=-1) - circles[:, 2]
    return np.minimum(to_segments, to_circles.min(axis=1, initial=np.inf))


def furnished(walls, boxes, bins, tour):
    """Return the world of all walls, and of the boxes and bins that are at least `CLEARANCE` away from the tour."""
    way = np.concatenate([np.linspace(a, b, 2 + int(math.dist(a, b) / 0.1)) for a, b in itertools.pairwise(tour)])
    bins = np.array(bins, dtype=float).reshape(-1, 3)
    none = np.empty((0, 3))
    boxes = [part for part in boxes if clearance(way, part, none).min() > CLEARANCE]
    far = [clearance(way, np.empty((0, 2, 2)), circle[None]).min() > CLEARANCE for circle in bins]
    return World(np.concatenate(walls + boxes), tour, bins[np.array(far, dtype=bool)])
