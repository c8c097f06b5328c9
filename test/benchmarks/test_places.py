# SPDX-License-Identifier: Apache-2.0
"""The measures of starts in a map, and the floors and routes on which they are taken."""
import itertools
import math

import numpy as np
import pytest
from benchmarks.places.floors import floor, route
from benchmarks.places.places import kidnapped_summary, outside_summary, summary
from benchmarks.places.starts import Outcome

from dbscan_reg_ros.places.localizer import State
from dbscan_reg_ros.simulation.worlds import clearance

SEARCHING, LOCALISED, OUTSIDE = State.SEARCHING, State.LOCALISED, State.NOT_IN_MAP


def outcome(states, errors, sigma=0.1, step=1.0):
    errors = np.column_stack((errors, np.zeros(len(errors))))
    return Outcome(states, step * np.arange(len(states)), errors, np.full(len(states), sigma))


def test_a_start_is_right_if_it_is_found_in_time_and_never_wrong():
    starts = [outcome([SEARCHING, LOCALISED, LOCALISED], (np.nan, 0.1, 0.2)),
              outcome([SEARCHING, LOCALISED, LOCALISED], (np.nan, 0.1, 0.5)),
              outcome([SEARCHING, SEARCHING, LOCALISED], (np.nan, np.nan, 0.1), step=2.0)]
    found = summary(starts)
    assert (found['starts_count'], found['wrong_count']) == (3, 1)
    assert found['right'] == pytest.approx(1.0 / 3.0)
    assert found['mean_m'] == pytest.approx(0.2) and found['median_way_m'] == pytest.approx(1.0)


def test_a_start_outside_counts_as_claimed_if_it_was_ever_localised():
    found = outside_summary([outcome([SEARCHING, OUTSIDE], (np.nan, np.nan)),
                             outcome([OUTSIDE, LOCALISED], (np.nan, np.inf))])
    assert (found['starts_count'], found['claimed_count'], found['said_outside']) == (2, 1, 1.0)


def test_a_carried_robot_is_wrong_only_while_it_is_sure():
    states = [LOCALISED, LOCALISED, LOCALISED, SEARCHING, LOCALISED]
    errors = (0.1, 20.0, 20.0, 20.0, 0.1)
    assert kidnapped_summary([outcome(states, errors)], [1], 5.0) == pytest.approx(
        {'starts_count': 1, 'again': 1.0, 'wrong_s': 0.6})
    assert kidnapped_summary([outcome(states, errors, 3.0, 2.0)], [1], 5.0) == pytest.approx(
        {'starts_count': 1, 'again': 0.0, 'wrong_s': 0.0})


def test_routes_lead_through_free_space_of_a_floor_that_fits_its_size():
    world = floor(3)
    assert np.ptp(world.segments.reshape(-1, 2), axis=0) == pytest.approx((60.0, 40.0), abs=0.3)
    for number in range(5):
        way = route(world, number)
        assert np.hypot(*np.diff(way, axis=0).T).sum() >= 14.0 or math.dist(way[-1], world.tour[0]) < 1.0
        points = np.vstack([np.linspace(a, b, 50) for a, b in itertools.pairwise(way)])
        assert clearance(points, world.segments, world.circles).min() > 0.05
