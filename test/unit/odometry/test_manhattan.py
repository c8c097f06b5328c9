# SPDX-License-Identifier: Apache-2.0
"""The heading by the walls of a building."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.features.records import Segments
from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.odometry.models.manhattan import ManhattanHeading
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.parameters.odometry import ManhattanParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.simulation import LIDARS, follow, rooms, simulate

P = ManhattanParameters()
STEP = 0.3
"""Way between two looks [m]."""


def walls(*directions, length=3.0):
    """Segments in these directions [rad], of these lengths [m]."""
    directions, count = np.array(directions, dtype=float), len(directions)
    half = 0.5 * length * np.column_stack((np.cos(directions), np.sin(directions)))
    return Segments(-half, half, wrap(directions), np.full(count, length), np.full(count, 0.003), np.full(count, 0.01),
                    np.zeros((count, 2), dtype=int), np.zeros((count, 2), dtype=int))


def drive(way, faced, seed=0, frame=None, drift=P.heading_drift, parameters=P):
    """Errors of a heading [rad] with a random walk, before and after the correction by walls, every `STEP`.

    ``faced(distance)`` are the directions of the walls in sight, in the world.
    """
    frame, rng = frame or ManhattanHeading(), np.random.default_rng(seed)
    raw, corrected, errors = 0.0, 0.0, []
    for k in range(int(way / STEP)):
        off = rng.normal(0.0, drift * math.sqrt(STEP)) if k else 0.0
        raw, corrected = raw + off, corrected + off
        frame.propagate(SE2(STEP))
        turn, share = frame.observe(walls(*(faced(k * STEP) + rng.normal(0.0, 0.003, len(faced(k * STEP))))), corrected,
                                    parameters)
        assert 0.0 <= share <= 1.0
        corrected += turn
        errors.append((raw, corrected))
    return np.array(errors).T


def building(_):
    return np.radians((10.0, 10.0, 100.0))


def test_in_a_building_the_heading_no_longer_drifts():
    drives = [drive(2000.0, building, seed) for seed in range(2)]
    raw, corrected = np.degrees([[np.abs(errors[len(errors) // 2:]).mean() for errors in each] for each in drives]).T
    assert raw.mean() > 1.0
    assert corrected.mean() < 0.45
    assert corrected.max() < 0.9


def test_walls_that_are_off_for_a_while_turn_it_little():
    """A wing of 20 m whose walls are 1 deg from all others, after 100 m."""
    _, off = drive(160.0, lambda at: building(at) + math.radians(1.0) * (100.0 < at < 120.0), drift=0.0)
    assert np.degrees(np.abs(off)).max() < 0.35
    assert np.degrees(abs(off[-1])) < 0.15


@pytest.mark.parametrize('faced', [
    pytest.param(lambda at: np.radians([(37.0 * k + at * 5.0) % 180.0 for k in range(6)]), id='all ways'),
    pytest.param(lambda at: np.radians([at * 4.0]), id='a circular room'),
    pytest.param(lambda _: np.empty(0), id='no walls'),
])
def test_where_walls_share_no_direction_nothing_is_corrected(faced):
    raw, corrected = drive(100.0, faced)
    assert np.degrees(np.abs(raw - corrected)).max() < 0.35


def test_furniture_is_no_wall():
    frame = ManhattanHeading()
    for _ in range(100):
        frame.propagate(SE2(STEP))
        assert frame.observe(walls(0.3, length=0.5), 0.0, P) == (0.0, 1.0)


def test_a_wing_that_faces_otherwise_becomes_the_measure():
    """After 100 m everything faces 30 deg another way."""
    raw, corrected = np.degrees(drive(600.0, lambda at: building(at) + math.radians(30.0) * (at > 100.0), seed=3))
    wing = slice(int(200.0 / STEP), None)
    assert np.ptp(raw[wing]) > 1.0
    assert np.ptp(corrected[wing]) < 0.75 * np.ptp(raw[wing])
    assert np.abs(np.diff(corrected)).max() < 0.5


def test_scans_are_registered_as_if_no_heading_was_corrected():
    world = rooms(0)
    scans = simulate(world, follow(world.tour[:3]), LIDARS['rplidar_a'], seed=0).scans[:60]
    said = {}
    for drift in (0.0, 0.003):
        odometry = Odometry(Parameters().replace({'advanced.manhattan.heading_drift': drift}))
        said[drift] = [odometry.process(scan) for scan in scans]
    for left, corrected in zip(*said.values(), strict=True):
        assert (left.registration and left.registration.transform) == (corrected.registration
                                                                       and corrected.registration.transform)
        assert left.twist == pytest.approx(corrected.twist)
    off = [wrap(one.pose.theta - other.pose.theta) for one, other in zip(*said.values(), strict=True)]
    assert np.abs(off).max() > 1e-4
    assert np.abs(np.diff(off)).max() < math.radians(0.3)
    for before, now in zip(said[0.003], said[0.003][1:]):
        assert (before.pose @ now.increment).as_array() == pytest.approx(now.pose.as_array(), abs=1e-9)
    assert said[0.003][-1].covariance[2, 2] < said[0.0][-1].covariance[2, 2]
