# SPDX-License-Identifier: Apache-2.0
"""Occupancy grid of a drive as files of nav2_map_server: ``map.pgm`` and ``map.yaml``."""
import math

import numpy as np

from ..core.geometry.se2 import wrap
from ..recordings.files import replacing
from ..robot.occupancy import FREE, OCCUPIED, GridError, OccupancyCounts, OccupancyGrid, trace_rays

STEP, TURN = 0.1, math.radians(10.0)
"""A scan is used if the sensor has moved by one of these [m, rad] since the last one used; otherwise the scans of a
robot at rest would outvote all others."""
BLACK, GREY, WHITE = 0, 205, 254
"""Grey values of cells that are occupied, unknown and free, as map_saver of nav2 writes them."""
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""Thresholds of ``map.yaml``: grey 205 has the occupancy (255 - 205) / 255 = 0.1961, which must not be below
``free_thresh``, or map_server loads unknown cells as free."""


def write_occupancy_map(folder, placed, resolution):
    """Write ``map.pgm`` and ``map.yaml`` with cells of `resolution` [m] to `folder`.

    `placed` has the pose ``(3,)`` of the sensor and the returns ``(N, 2)`` of each scan, in the map frame [m, m, rad].
    Raises a GridError when the grid would have too many cells, or no scan has a return.
    """
    counts, last = OccupancyCounts(resolution), None
    for pose, points in placed:
        if last is not None and math.hypot(*(pose - last)[:2]) < STEP and abs(wrap(pose[2] - last[2])) < TURN:
            continue
        counts.add(trace_rays(points, pose[:2], resolution, math.inf))
        last = pose
    write_map(folder, counts.grid())


def write_map(folder, grid: OccupancyGrid):
    """Write a `grid` as ``map.pgm`` and ``map.yaml`` to `folder`; raise a GridError if it is empty."""
    values = grid.values
    if not values.size:
        raise GridError('no cell is known: expected scans with returns')
    image = np.full(values.shape, GREY, dtype=np.uint8)
    image[values == FREE], image[values == OCCUPIED] = WHITE, BLACK
    height, width = values.shape
    with replacing(folder / 'map.pgm', binary=True) as file:
        # The first row of the picture is that of the greatest y.
        file.write(b'P5\n%d %d\n255\n' % (width, height) + image[::-1].tobytes())
    x, y = grid.corner
    with replacing(folder / 'map.yaml') as file:
        file.write(f'image: map.pgm\nmode: trinary\nresolution: {grid.resolution:g}\norigin: [{x:.6f}, {y:.6f}, 0.0]\n'
                   f'negate: 0\noccupied_thresh: {OCCUPIED_THRESH}\nfree_thresh: {FREE_THRESH}\n')
