# SPDX-License-Identifier: Apache-2.0
"""Returns from the robot itself, in simulated drives."""
import dataclasses
import itertools
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.robot.own_body import BodySector, OwnBody
from dbscan_reg_ros.simulation import Lidar, corridor, follow, rooms, simulate

LIDAR = Lidar(360, -math.pi, math.radians(1.0), rate=5.0, outliers=0.01)
BODY = math.radians(100.0), math.radians(120.0), 0.3
BEHIND = (math.radians(-180.0), math.radians(-176.0), 0.5), (math.radians(175.0), math.radians(180.0), 0.5)


def searched(simulation, upto=math.inf):
    """The sectors found, and after which distance [m]."""
    body, driven, found = OwnBody(), 0.0, math.inf
    for number, (scan, pose) in enumerate(zip(simulation.scans, simulation.truth, strict=True)):
        body.add(scan, SE2.from_array(pose))
        if number:
            driven += float(np.hypot(*(pose - simulation.truth[number - 1])[:2]))
        if body.sectors:
            found = min(found, driven)
        if driven > upto:
            break
    return body.sectors, found


@pytest.fixture(scope='module', params=range(2))
def drive(request):
    world = rooms(seed=request.param)
    return world, follow(world.tour[:6], speed=1.5)


def test_the_body_is_found_within_10_m_and_nothing_else(drive):
    sectors, driven = searched(simulate(*drive, dataclasses.replace(LIDAR, body=(BODY,))))
    assert driven < 10.0
    sector, = sectors
    assert BODY[0] - 0.11 < sector.first <= BODY[0] and BODY[1] <= sector.last < BODY[1] + 0.11
    assert sector.range == pytest.approx(0.3, abs=0.03)


def test_a_body_behind_the_lidar_is_one_sector(drive):
    (sector,), _ = searched(simulate(*drive, dataclasses.replace(LIDAR, body=BEHIND)))
    assert math.degrees(sector.first) % 360.0 == pytest.approx(173.0, abs=2.1)
    assert math.degrees(sector.last - sector.first) == pytest.approx(13.0, abs=4.0)


def test_nothing_is_found_without_a_body(drive):
    assert searched(simulate(*drive, LIDAR)) == ([], math.inf)


def test_walls_along_the_path_are_no_body_before_the_robot_turns():
    world = corridor(seed=1)
    sectors, _ = searched(simulate(world, follow(world.tour, speed=2.0), LIDAR), upto=20.0)
    assert not sectors


@pytest.mark.parametrize('seed', range(2))
def test_walls_along_the_path_are_no_body_if_the_scans_of_rotations_are_missing(seed):
    world = corridor(seed=seed)
    simulation = simulate(world, follow([*world.tour, *world.tour[::-1]], speed=2.0), LIDAR, seed=seed)
    turning = np.abs(np.diff(simulation.truth[:, 2], prepend=simulation.truth[0, 2])) > 0.05
    body, sectors = OwnBody(), []
    for scan, pose in zip(itertools.compress(simulation.scans, ~turning), simulation.truth[~turning], strict=True):
        body.add(scan, SE2.from_array(pose))
        sectors += body.sectors
    assert turning.any() and not sectors


def test_a_masked_body_is_not_found_any_more(drive):
    simulation = simulate(*drive, dataclasses.replace(LIDAR, body=(BODY,)))
    bearings = LIDAR.geometry.bearings
    inside = (bearings >= BODY[0]) & (bearings <= BODY[1])
    body, counts = OwnBody(), []
    for hidden in (np.zeros_like(inside), inside):
        for scan, pose in zip(simulation.scans, simulation.truth, strict=True):
            masked = np.where(hidden, np.float32(np.nan), scan.ranges)
            body.add(Scan(scan.stamp, masked, scan.geometry), SE2.from_array(pose))
        counts.append(len(body.sectors))
        body.restart()
    assert counts == [1, 0]


@pytest.mark.parametrize('upside_down, first, last', [(False, -2.5, -2.0), (True, 2.0, 2.5)])
def test_sectors_are_given_in_the_frame_of_the_lidar(upside_down, first, last):
    sector = BodySector(0.5, 1.0, 0.3).in_lidar(Mounting(SE2(theta=3.0), upside_down))
    assert sector[:2] == pytest.approx((first, last))
