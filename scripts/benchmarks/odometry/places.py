# SPDX-License-Identifier: Apache-2.0
"""Worlds of the courses that the simulation of the package does not have: chairs, trunks, crooked walls."""
import itertools
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import as_vectors
from dbscan_reg_ros.simulation import World
from dbscan_reg_ros.simulation.worlds import box, clearance, furnished, sides

CHAIRS_CLEAR, TRUNKS_CLEAR = 0.4, 0.8
"""Distance [m] from the path that chairs and trunks keep."""


def hall_of_chairs(seed, chairs=50) -> World:
    """12 m long and 9 m wide, with so many chairs that keep 0.4 m clear of its middle."""
    rng = np.random.default_rng(seed)
    low, high = (1.5, 1.0), (10.5, 8.0)
    seats, turn = rng.uniform(low, high, (chairs, 2)), rng.uniform(0.0, 2.0 * math.pi, chairs)
    feet = 0.28 * np.exp(1j * (turn[:, None] + math.pi * np.array((0.25, 0.75, 1.25, 1.75))))
    legs = as_vectors((seats @ (1.0, 1j))[:, None] + feet).reshape(-1, 2)
    legs = legs[np.abs(legs[:, 1] - 4.5) > CHAIRS_CLEAR]
    corners = np.array([(0.0, 0.0), (12.0, 0.0), (12.0, 9.0), (0.0, 9.0)])
    return World(sides(corners), np.array([(1.0, 4.5), (11.0, 4.5)]), np.column_stack((legs, np.full(len(legs), 0.02))))


def wood(seed, trunks=120) -> World:
    """40 m long and wide, with so many trunks that keep 0.8 m clear of the tour."""
    rng = np.random.default_rng(seed)
    tour = np.array([(5.0, 5.0), (35.0, 5.0), (35.0, 20.0), (5.0, 20.0), (5.0, 35.0), (35.0, 35.0)])
    circles = np.column_stack((rng.uniform(0.0, 40.0, (trunks, 2)), rng.uniform(0.06, 0.35, trunks)))
    way = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(tour)])
    none = np.empty((0, 2, 2))
    clear = [clearance(way, none, circle[None]).min() > TRUNKS_CLEAR for circle in circles]
    return World(none, tour, circles[clear])


def crooked(seed, walls=9, boxes=14) -> World:
    """Return a room without right angles, walls 6 to 12 m away, and boxes at any angle clear of the tour."""
    rng = np.random.default_rng(seed)
    bearings = np.linspace(0.0, 2.0 * math.pi, walls, endpoint=False) + rng.uniform(-0.2, 0.2, walls)
    around = np.column_stack((np.cos(bearings), np.sin(bearings)))
    corners, tour = around * rng.uniform(6.0, 12.0, (walls, 1)), 3.5 * np.vstack((around, around[:1]))
    things = [box(*rng.uniform(-9.0, 9.0, 2), rng.uniform(0.3, 1.2), rng.uniform(0.2, 0.8), rng.uniform(0.0, 3.0))
              for _ in range(boxes)]
    return furnished([sides(corners)], things, [], tour)
