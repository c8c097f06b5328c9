# SPDX-License-Identifier: Apache-2.0
"""Points looked up in a grid, against numpy."""
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from dbscan_reg_ros.places.surface_lookup import SurfaceLookup
from dbscan_reg_ros.robot.occupancy import FREE, OCCUPIED, UNKNOWN

RESOLUTION = 0.05


@pytest.fixture(scope='module')
def grid():
    """Values and distances of a grid of 5 by 4 m with walls, a box and a part that is not known."""
    values = np.full((80, 100), FREE, dtype=np.int8)
    values[[2, -3]], values[:, [2, -3]] = OCCUPIED, OCCUPIED
    values[30:45, 60:70] = OCCUPIED
    values[:20, 40:60] = UNKNOWN
    values[[0, -1]], values[:, [0, -1]] = UNKNOWN, UNKNOWN
    return values, (RESOLUTION * distance_transform_edt(values != OCCUPIED)).astype(np.float32)


def looked_up(values, points):
    rows, columns = (np.clip(np.floor(at / RESOLUTION).astype(int) + 1, 0, size - 1)
                     for at, size in zip(points.T[::-1], values.shape, strict=True))
    return values[rows, columns]


def nearest(distance, points):
    """Distances from the nearest surface, linear within each cell."""
    along_y, along_x = (looked_up(slope, points) for slope in np.gradient(distance, RESOLUTION))
    inside = (points / RESOLUTION % 1.0 - 0.5) * RESOLUTION
    return np.abs(looked_up(distance, points) + along_x * inside[:, 0] + along_y * inside[:, 1])


def placed(pose, points):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return pose[:2] + points @ np.array(((c, s), (-s, c)))


def test_counts_are_those_of_the_cells(grid):
    rng = np.random.default_rng(0)
    poses = np.column_stack((rng.uniform(1.5, 3.5, 30), rng.uniform(1.5, 2.5, 30), rng.uniform(-3.0, 3.0, 30)))
    hits, fronts, squares = (rng.uniform(-reach, reach, (200, 2)) for reach in (1.0, 4.0, 4.0))
    lookup = SurfaceLookup(*grid, RESOLUTION)
    for pose, counts in zip(poses, lookup.count(poses, hits, fronts, squares, 0.075), strict=True):
        at = placed(pose, hits)
        before, there, free = (looked_up(grid[0], placed(pose, points)) for points in (fronts, hits, squares))
        near = np.clip((0.075 - nearest(grid[1], at)) / RESOLUTION + 0.5, 0.0, 1.0)
        on, off = near * (before == FREE), (1.0 - near) * (there == FREE)
        assert counts[:3] == pytest.approx([on.sum(), off.sum(), (1.0 - on - off).sum()], abs=0.01)
        assert counts[3:].tolist() == [(free == FREE).sum(), (free == OCCUPIED).sum(), (free == UNKNOWN).sum()]


def test_points_of_two_walls_are_moved_onto_them(grid):
    along = np.linspace(0.5, 1.8, 40)
    walls = np.array([*((x, 3.825) for x in along), *((0.075, y + 1.5) for y in along)])
    walls += np.random.default_rng(0).normal(0.0, 0.02, walls.shape)
    middle = walls.mean(axis=0)
    poses = np.array([(*middle, 0.0), (middle[0] + 0.2, middle[1] - 0.15, 0.05)])
    normal, variance = SurfaceLookup(*grid, RESOLUTION).align(poses, walls - middle, np.geomspace(0.5, 0.1, 8))
    assert poses == pytest.approx(np.repeat([(*middle, 0.0)], 2, axis=0), abs=0.02)
    assert (np.linalg.eigvalsh(normal) > 1.0).all() and (variance < 0.04**2).all()


def test_points_along_one_wall_leave_the_motion_along_it_unknown(grid):
    points = np.column_stack((np.linspace(-0.6, 0.6, 40), np.random.default_rng(0).normal(0.0, 0.02, 40)))
    poses = np.array([(1.2, 3.7, 0.03)])
    normal, _ = SurfaceLookup(*grid, RESOLUTION).align(poses, points, np.geomspace(0.5, 0.1, 8))
    assert poses[0] == pytest.approx((1.2, 3.825, 0.0), abs=0.02)
    assert normal[0, 0, 0] < 0.1 < 5.0 < normal[0, 1, 1]
