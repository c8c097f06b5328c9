# SPDX-License-Identifier: Apache-2.0
"""Likelihood field: the nearest oriented point of each cell."""
import math
import tracemalloc

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dbscan_reg_ros.core.features import tables
from dbscan_reg_ros.core.features.oriented_points import OrientedPoints
from dbscan_reg_ros.core.features.tables import build_likelihood_field
from dbscan_reg_ros.core.parameters.registration import DensityParameters

PARAMETERS = DensityParameters()


def drawn(count, seed=0):
    """Points in a rectangle of 6 m x 4 m, facing anywhere."""
    rng = np.random.default_rng(seed)
    return OrientedPoints(rng.uniform(-2.0, 4.0, count) + 1j * rng.uniform(-3.0, 1.0, count),
                 np.exp(1j * rng.uniform(-math.pi, math.pi, count)), np.arange(count))


@pytest.mark.parametrize('cells, cell, reach', [(800, 0.04, 0.4), (50, 6.8 / 50, 0.4), (1000, 0.01, 2.0)])
def test_the_point_that_the_grid_names_is_the_nearest_up_to_the_cells(cells, cell, reach, monkeypatch):
    monkeypatch.setattr(tables, 'MAX_CELLS', cells)
    cloud = drawn(300)
    surface = build_likelihood_field(cloud, DensityParameters(cell_size=min(cell, 0.04), max_distance=reach))
    assert surface.cell == pytest.approx(cell, rel=0.01)
    rng = np.random.default_rng(1)
    places = rng.uniform(-2.0 - reach, 4.0 + reach, 5000) + 1j * rng.uniform(-3.0 - reach, 1.0 + reach, 5000)
    distance, _ = cKDTree(np.column_stack((cloud.points.real, cloud.points.imag))).query(
        np.column_stack((places.real, places.imag)))
    found = surface.nearest(places)
    diagonal = math.sqrt(2.0) * surface.cell
    assert (found[distance < reach - diagonal] < 300).all()
    assert (found[distance > reach + diagonal] == 300).all()
    near = found < 300
    assert (np.abs(places[near] - cloud.points[found[near]]) <= distance[near] + 2.0 * diagonal).all()
    assert surface.nearest(np.array([100.0, -100.0, 100j, -100j])).tolist() == [300] * 4


def test_far_reaching_points_take_little_memory(monkeypatch):
    monkeypatch.setattr(tables, 'MAX_CELLS', 1000)
    tracemalloc.start()
    try:
        build_likelihood_field(drawn(300), DensityParameters(cell_size=0.01, max_distance=2.0))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100e6


def test_of_two_points_in_a_cell_the_one_nearer_to_its_centre_counts():
    """The grid is laid out from the lowest point: cells end at multiples of 0.04 m, one has its centre at 0.42 m."""
    for other, nearer in ((0.425 + 0.42j, False), (0.4395 + 0.4395j, True)):
        for pair in ([0.405 + 0.405j, other], [other, 0.405 + 0.405j]):
            points = np.array([0.381966 * 0.04 * (1.0 + 1.0j), *pair])
            surface = build_likelihood_field(OrientedPoints(points, np.ones(3, dtype=complex), np.arange(3)),
                                             PARAMETERS)
            found = points[surface.nearest(np.array([0.42 + 0.42j]))[0]]
            assert (found == 0.405 + 0.405j) == nearer


def test_points_on_no_side_are_favoured():
    """Nearest points lie to all sides alike.

    Were those towards the sensor preferred, every scan would seem to stay behind.
    """
    rng = np.random.default_rng(2)
    points, places = (rng.uniform(0.0, side, (count, 2)) @ (1.0, 1j) for side, count in ((2.0, 3000), (1.6, 100000)))
    places += 0.2 + 0.2j
    surface = build_likelihood_field(OrientedPoints(points, np.ones(3000, dtype=complex), np.arange(3000)), PARAMETERS)
    step = points[surface.nearest(places)] - places
    assert abs(step.mean()) < 0.002 < 0.02 < np.abs(step).mean()
