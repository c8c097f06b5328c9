# SPDX-License-Identifier: Apache-2.0
"""Free-space profile: nearest and farthest range at each bearing."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.features.tables import build_free_space_profile


def circle(ranges, known=slice(None)):
    """Points of 360 beams, one in the middle of each degree; those `known`."""
    angle = np.radians(np.arange(360) - 179.5)[known]
    return np.column_stack((np.cos(angle), np.sin(angle))) * np.broadcast_to(ranges, 360)[known, None]


def bins(*degrees):
    """Bins of 1 deg of these bearings [deg], from -180 deg on."""
    return np.floor(np.array(degrees) + 180.0).astype(int)


def test_a_profile_has_the_least_and_the_greatest_range_around_each_bearing():
    view = build_free_space_profile(circle(np.where(np.arange(360) < 180, 2.0, 3.0)), math.radians(1.0))
    assert len(view.near) == len(view.far) == 360
    places = bins(-90.5, -1.5, -0.5, 0.5, 1.5, 90.5, 179.5, -179.5)
    assert view.near[places] == pytest.approx([2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 2.0, 2.0])
    assert view.far[places] == pytest.approx([2.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0])


def test_one_beam_without_a_return_is_bridged_and_three_are_not():
    for missing, known in ((1, True), (3, False)):
        view = build_free_space_profile(circle(2.0, np.r_[0:180, 180 + missing:360]), math.radians(1.0))
        assert (view.near[bins(0.5)] > 0.0).all() == known, missing
        assert view.near[bins(-20.0, 20.0)] == pytest.approx(2.0)


@pytest.mark.parametrize('increment, count', [(0.5, 60), (math.radians(-2.0), 180), (1e-4, 2880)])
def test_the_resolution_of_a_profile_is_that_of_the_beams_within_limits(increment, count):
    assert len(build_free_space_profile(circle(2.0), increment).near) == count
