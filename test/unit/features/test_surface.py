# SPDX-License-Identifier: Apache-2.0
"""What a scan knows of the space around it: surfaces by place, free space by bearing."""
import math
import tracemalloc

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dbscan_reg_ros.core.features.free_space import build_free_space_profile, in_front
from dbscan_reg_ros.core.features.likelihood_field import build_likelihood_field
from dbscan_reg_ros.core.features.oriented_points import (
    OrientedPoints,
    build_oriented_points,
    high_leverage,
    leverage,
    sample,
)
from dbscan_reg_ros.core.parameters.registration import DensityParameters

PARAMETERS = DensityParameters()


def drawn(count, seed=0):
    """Points in a rectangle of 6 m x 4 m, facing anywhere."""
    rng = np.random.default_rng(seed)
    return OrientedPoints(rng.uniform(-2.0, 4.0, count) + 1j * rng.uniform(-3.0, 1.0, count),
                 np.exp(1j * rng.uniform(-math.pi, math.pi, count)), np.arange(count))


@pytest.mark.parametrize('cells, cell, reach', [(800, 0.04, 0.4), (50, 6.8 / 50, 0.4), (1000, 0.01, 2.0)])
def test_the_point_that_the_grid_names_is_the_nearest_up_to_the_cells(cells, cell, reach):
    cloud = drawn(300)
    surface = build_likelihood_field(cloud, DensityParameters(max_cells=cells, cell_size=min(cell, 0.04), max_distance=reach))
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


def test_far_reaching_points_take_little_memory():
    tracemalloc.start()
    try:
        build_likelihood_field(drawn(300), DensityParameters(cell_size=0.01, max_cells=1000, max_distance=2.0))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100e6


def test_of_two_points_in_a_cell_the_one_nearer_to_its_centre_counts():
    """The grid is laid out from the point at 0: cells end at multiples of 0.04 m, one has its centre at 0.42 m."""
    for other, nearer in ((0.425 + 0.42j, False), (0.4395 + 0.4395j, True)):
        for pair in ([0.405 + 0.405j, other], [other, 0.405 + 0.405j]):
            points = np.array([0.0j, *pair])
            surface = build_likelihood_field(OrientedPoints(points, np.ones(3, dtype=complex), np.arange(3)), PARAMETERS)
            found = points[surface.nearest(np.array([0.42 + 0.42j]))[0]]
            assert (found == 0.405 + 0.405j) == nearer


def test_points_on_no_side_are_favoured():
    """Nearest points lie to all sides alike: were those towards the sensor preferred, every scan would seem to stay behind."""
    rng = np.random.default_rng(2)
    points, places = (rng.uniform(0.0, side, (count, 2)) @ (1.0, 1j) for side, count in ((2.0, 3000), (1.6, 100000)))
    places += 0.2 + 0.2j
    surface = build_likelihood_field(OrientedPoints(points, np.ones(3000, dtype=complex), np.arange(3000)), PARAMETERS)
    step = points[surface.nearest(places)] - places
    assert abs(step.mean()) < 0.002 < 0.02 < np.abs(step).mean()


def test_lines_are_known_by_normal_and_distance_and_the_last_point_is_none():
    surface = build_likelihood_field(OrientedPoints(np.array([3.0 + 4.0j]), np.array([-1.0j]), np.array([7])), PARAMETERS)
    assert surface.normals.tolist() == [1.0j, 0.0]
    assert surface.offsets.tolist() == [-4.0, 0.0]
    empty = build_likelihood_field(OrientedPoints(*np.empty((2, 0), dtype=complex), np.empty(0, dtype=int)), PARAMETERS)
    assert empty.nearest(np.array([0.0j, 5.0])).tolist() == [0, 0]


def test_points_without_a_normal_are_left_out_of_a_cloud():
    cloud = build_oriented_points(np.array([(1.0, 2.0), (3.0, 4.0)]), np.array([(0.0, 0.0), (0.0, 1.0)]), np.array([4, 6]))
    assert cloud.points.tolist() == [3.0 + 4.0j] and cloud.normals.tolist() == [1.0j] and cloud.beams.tolist() == [6]


@pytest.mark.parametrize('count, kept', [(10, range(10)), (9, range(0, 10, 2)), (5, range(0, 10, 2)), (4, range(0, 10, 3))])
def test_a_cloud_is_thinned_evenly_to_at_most_so_many(count, kept):
    points = np.arange(10.0) + 0j
    assert OrientedPoints(points, points, np.arange(len(points))).thinned(count).points.real.tolist() == list(kept)


def test_a_sample_is_thinned_but_for_points_that_face_where_few_do():
    """A corridor of 40 points, of which two face along it."""
    normals = np.tile([1j, -1j], 20)
    normals[[7, 22]] = 1.0, -1.0
    cloud = OrientedPoints(np.arange(40.0) + 0j, normals, np.arange(40))
    assert sample(cloud, 10).beams.tolist() == [0, 4, 7, 8, 12, 16, 20, 22, 24, 28, 32, 36]
    assert sample(cloud, 40) is cloud


@pytest.mark.parametrize('balance', [0.001, 1.0])
def test_leverage_is_that_of_a_ridge_regression(balance):
    cloud = drawn(40)
    normals = np.column_stack((cloud.normals.real, cloud.normals.imag))
    hat = normals @ np.linalg.inv(normals.T @ normals / 40 + balance * np.eye(2)) @ normals.T
    assert leverage(cloud, balance) == pytest.approx(np.diag(hat) / np.trace(hat))


def test_where_nothing_counts_there_is_no_leverage():
    cloud = drawn(20)
    cloud = OrientedPoints(cloud.points, cloud.normals, cloud.beams, np.zeros(20))
    assert not leverage(cloud, 1.0).any()


@pytest.mark.parametrize('share', [0.05, 0.2, 0.3, 0.5])
def test_high_leverage_is_more_than_twice_the_mean_of_the_hat_matrix(share):
    rng = np.random.default_rng(5)
    angle = np.where(rng.random(200) < share, 0.0, 0.5 * np.pi) + np.pi * rng.integers(0, 2, 200) + rng.normal(0.3, 0.1, 200)
    normals = np.column_stack((np.cos(angle), np.sin(angle)))
    hat = normals @ np.linalg.inv(normals.T @ normals) @ normals.T
    expected = np.diag(hat) > 2.0 * np.trace(hat) / 200
    assert np.array_equal(high_leverage(np.exp(1j * angle)), expected) and expected.any() == (share < 0.25)


def test_no_leverage_is_high_where_all_face_alike():
    assert not high_leverage(np.exp(1j * np.array([0.3, 0.3, 0.3 + np.pi]))).any() and not high_leverage(np.empty(0, complex)).any()


def circle(ranges, known=slice(None)):
    """Points of 360 beams, one in the middle of each degree; those `known`."""
    angle = np.radians(np.arange(360) - 179.5)[known]
    return np.column_stack((np.cos(angle), np.sin(angle))) * np.broadcast_to(ranges, 360)[known, None]


def at(degrees, radius=1.0):
    return radius * np.exp(1j * np.radians(np.asarray(degrees, dtype=float)))


def test_a_view_knows_the_least_and_the_greatest_range_around_each_bearing():
    view = build_free_space_profile(circle(np.where(np.arange(360) < 180, 2.0, 3.0)), math.radians(1.0))
    assert len(view.near) == len(view.far) == 360
    bins = view.bins(at([-90.5, -1.5, -0.5, 0.5, 1.5, 90.5, 179.5, -179.5]))
    assert bins.tolist() == [89, 178, 179, 180, 181, 270, 359, 0]
    assert view.near[bins] == pytest.approx([2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 2.0, 2.0])
    assert view.far[bins] == pytest.approx([2.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    assert view.bins(np.array([-1.0 + 0.0j, complex(-1.0, -0.0)])).tolist() == [359, 0]


def test_one_beam_without_a_return_is_bridged_and_three_are_not():
    for missing, known in ((1, True), (3, False)):
        view = build_free_space_profile(circle(2.0, np.r_[0:180, 180 + missing:360]), math.radians(1.0))
        assert (view.near[view.bins(at(0.5))] > 0.0) == known, missing
        assert view.near[view.bins(at([-20.0, 20.0]))] == pytest.approx(2.0)


@pytest.mark.parametrize('increment, bins', [(0.5, 60), (math.radians(-2.0), 180), (1e-4, 2880)])
def test_a_view_is_as_fine_as_the_beams_within_limits(increment, bins):
    assert len(build_free_space_profile(circle(2.0), increment).near) == bins


def test_free_space_is_what_lies_in_front_by_more_than_the_tolerance():
    assert in_front(np.array([1.0, 1.7, 1.775, 1.85, 3.0]), np.full(5, 2.0), 0.15) == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])
    view = build_free_space_profile(circle(2.0, np.r_[0:200, 230:360]), math.radians(1.0))
    places = np.array([at(10.0, 1.775), at(35.0, 1.0), at(-120.0, 1.0)])
    assert view.violation(places, 0.15) == pytest.approx([0.5, 0.0, 1.0])


def test_nothing_is_near_beyond_the_grid_wherever_it_begins():
    for x in np.arange(-2.0, 2.0, 0.01):
        surface = build_likelihood_field(OrientedPoints(np.array([x, x + 1.0 + 1.0j]), np.ones(2, complex), np.arange(2)), DensityParameters())
        beyond = np.array([x - 50.0, x + 51.0 + 1.0j, x - 50.0j, x + 1.0 + 51.0j])
        assert (surface.nearest(beyond) == 2).all()
