# SPDX-License-Identifier: Apache-2.0
"""Occupancy grids, against a walk along each ray in small steps."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.robot.occupancy import (
    FREE,
    HIT,
    LARGEST,
    NOT_SEEN,
    OCCUPIED,
    PASSED,
    UNKNOWN,
    GridError,
    OccupancyCounts,
    Patch,
    trace_rays,
)

RESOLUTION = 0.1


def cell(x, y):
    return math.floor(x / RESOLUTION), math.floor(y / RESOLUTION)


def states_of(patch):
    """(x, y) of a cell -> its state, of the cells that were seen."""
    return {(int(x + patch.corner[0]), int(y + patch.corner[1])): int(patch.states[y, x])
            for y, x in zip(*np.nonzero(patch.states), strict=True)}


def crossed(cells, start, end):
    """Which cells ``(N, 2)`` the line from `start` to `end` crosses: it is in both of their slabs at the same time."""
    with np.errstate(divide='ignore', invalid='ignore'):
        times = (np.stack((cells, cells + 1)) * RESOLUTION - start) / (end - start)
    enter, leave = times.min(axis=0).max(axis=1), times.max(axis=0).min(axis=1)
    return np.maximum(enter, 0.0) <= np.minimum(leave, 1.0) + 1e-9


@pytest.mark.parametrize('seed', range(3))
def test_cells_are_passed_up_to_the_return_and_hit_there(seed):
    rng = np.random.default_rng(seed)
    sensor, reach = rng.uniform(-3.0, 3.0, 2), 5.0
    points = sensor + rng.normal(scale=3.0, size=(40, 2))
    states = states_of(trace_rays(np.vstack((points, [(np.nan, 0.0), (np.inf, 1.0)])), sensor, RESOLUTION, reach))
    cells, hits = np.array(list(states)), set()
    on_rays = np.zeros(len(cells), dtype=bool)
    for point in points:
        length = math.hypot(*(point - sensor))
        end = sensor + (point - sensor) * min(reach / length, 1.0)
        on_ray = crossed(cells, sensor, end)
        on_rays |= on_ray
        if length <= reach:
            hits.add(cell(*point))
        # A cell in each column, or in each row, on the way.
        axis = int(np.abs(end - sensor).argmax())
        first, last = sorted((cell(*sensor)[axis], cell(*end)[axis]))
        assert set(range(first + 1, last)) <= set(cells[on_ray, axis].tolist())
    assert {c for c, state in states.items() if state == HIT} == hits
    assert on_rays.all() and cell(*sensor) in states


@pytest.mark.parametrize('seed', range(3))
def test_cells_are_occupied_if_enough_scans_hit_them(seed):
    rng = np.random.default_rng(seed)
    counts, passed, hit = OccupancyCounts(RESOLUTION), {}, {}
    for _ in range(20):
        corner, shape = rng.integers(-30, 30, 2), rng.integers(1, 12, 2)
        states = rng.choice([NOT_SEEN, PASSED, HIT], shape, p=(0.2, 0.6, 0.2)).astype(np.uint8)
        counts.add(Patch(corner, states))
        for y in range(shape[0]):
            for x in range(shape[1]):
                key = int(x + corner[0]), int(y + corner[1])
                passed[key] = passed.get(key, 0) + int(states[y, x] == PASSED)
                hit[key] = hit.get(key, 0) + int(states[y, x] == HIT)
    grid = counts.grid()
    found = {}
    for y, row in enumerate(grid.values.tolist()):
        for x, value in enumerate(row):
            found[round(grid.corner[0] / RESOLUTION) + x, round(grid.corner[1] / RESOLUTION) + y] = value
    assert {value for key, value in found.items() if not passed.get(key, 0) + hit.get(key, 0)} <= {UNKNOWN}
    for key in passed:
        seen = passed[key] + hit[key]
        expected = UNKNOWN if not seen else OCCUPIED if hit[key] and hit[key] >= 0.25 * seen else FREE
        assert found.get(key, UNKNOWN) == expected
    assert all((grid.values != UNKNOWN).any(axis=axis)[end] for axis in (0, 1) for end in (0, -1))


def test_a_grid_that_is_too_large_is_refused():
    counts = OccupancyCounts(RESOLUTION)
    counts.add(Patch(np.array((0, 0)), np.ones((1, 1), dtype=np.uint8)))
    with pytest.raises(GridError, match='use a larger resolution'):
        counts.add(Patch(np.array((LARGEST, 0)), np.ones((1, 1), dtype=np.uint8)))
