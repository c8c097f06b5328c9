# SPDX-License-Identifier: Apache-2.0
"""The range value that means "no return", found from the readings."""

import numpy as np
import pytest

from dbscan_reg_ros.recordings.carmen.survey import NoReturn
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate


def limit_of(scans):
    found = NoReturn()
    for ranges in scans:
        found.add(np.asarray(ranges, dtype=float))
    return found.limit()


@pytest.fixture(scope='module')
def drive():
    world = rooms(seed=1)
    return simulate(world, follow(world.tour[:4], speed=1.0), Lidar(beams=180, range_max=40.0, dropouts=0.05),
                    seed=1).scans


@pytest.mark.parametrize('codes', [(32.767, 32.763, 32.759), (81.83, 81.91), (8.0,)])
def test_a_frequent_isolated_value_beyond_jumps_is_no_return(drive, codes):
    rng, scans, missing = np.random.default_rng(1), [], 0
    for scan in drive:
        ranges = np.array(scan.ranges, dtype=float)
        lost = ~(ranges < 0.9 * min(codes))
        ranges[lost] = rng.choice(codes, lost.sum())
        missing += lost.sum()
        scans.append(ranges)
    limit = limit_of(scans)
    assert 0.998 * min(codes) <= limit <= min(codes)
    assert sum((ranges >= limit).sum() for ranges in scans) == missing


def test_walls_are_never_no_return(drive):
    assert limit_of([np.where(np.isfinite(scan.ranges), scan.ranges, 0.0) for scan in drive]) is None


@pytest.mark.parametrize('longest', [3.0, 4.0, 5.0])
def test_a_sensor_that_saturates_on_walls_keeps_them(longest):
    """A hall without gaps whose walls reach the longest range that the sensor gives."""
    bearings = np.radians(np.arange(-90, 90))
    walls = [np.minimum(distance / np.maximum(np.cos(bearings), 1e-3), longest) for distance in np.linspace(2.5, 2.9,
                                                                                                            30)]
    assert limit_of(walls) is None


def test_a_wall_far_away_that_is_seen_through_a_door_is_a_wall():
    rng = np.random.default_rng(2)
    scans = []
    for distance in np.linspace(12.0, 9.0, 60):
        ranges = np.full(180, 2.0)
        ranges[85:95] = distance + rng.normal(0.0, 0.01, 10)
        scans.append(ranges)
    assert limit_of(scans) is None


def test_fewer_than_twenty_readings_decide_nothing():
    ranges = np.full(40, 2.0)
    ranges[::2] = 8.0
    assert limit_of([ranges[:38]]) is None and limit_of([ranges]) == pytest.approx(7.992)


def test_a_value_that_is_rarer_than_the_ranges_just_below_it_is_no_code():
    """A wall of slightly different ranges, and a few isolated ones that are 1 % longer."""
    ranges = np.linspace(7.93, 7.95, 180)
    ranges[::9] = 8.0
    lost = np.where(np.arange(180) % 9 == 0, 8.0, 2.0)
    assert limit_of([ranges, lost, lost]) is None and limit_of([lost, lost, lost]) == pytest.approx(7.992)
