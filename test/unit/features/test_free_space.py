# SPDX-License-Identifier: Apache-2.0
"""Free-space profile: nearest and farthest range at each bearing."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.features.free_space import in_front
from dbscan_reg_ros.core.features.tables import build_free_space_profile


def circle(ranges, known=slice(None)):
    """Points of 360 beams, one in the middle of each degree; those `known`."""
    angle = np.radians(np.arange(360) - 179.5)[known]
    return np.column_stack((np.cos(angle), np.sin(angle))) * np.broadcast_to(ranges, 360)[known, None]


def at(degrees, radius=1.0):
    return radius * np.exp(1j * np.radians(np.asarray(degrees, dtype=float)))


def test_a_profile_has_the_least_and_the_greatest_range_around_each_bearing():
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
def test_the_resolution_of_a_profile_is_that_of_the_beams_within_limits(increment, bins):
    assert len(build_free_space_profile(circle(2.0), increment).near) == bins


def test_free_space_is_what_lies_in_front_by_more_than_the_tolerance():
    assert in_front(np.array([1.0, 1.7, 1.775, 1.85, 3.0]), np.full(5, 2.0),
                    0.15) == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])
    view = build_free_space_profile(circle(2.0, np.r_[0:200, 230:360]), math.radians(1.0))
    places = np.array([at(10.0, 1.775), at(35.0, 1.0), at(-120.0, 1.0)])
    assert view.violation(places, 0.15) == pytest.approx([0.5, 0.0, 1.0])
