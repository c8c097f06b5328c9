# SPDX-License-Identifier: Apache-2.0
"""Ranges that a driver sends for a missing return, found scan by scan; the track is that of the same scans with inf."""
import dataclasses
import math

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Scan, ScanGeometry, open_recording
from dbscan_reg_ros.core.no_return import NoReturn
from dbscan_reg_ros.simulation import Lidar, follow, hall, simulate
from dbscan_reg_ros.simulation.lidar import PRESETS
from dbscan_reg_ros.simulation.worlds import World, corridor, rooms

ALL_ROUND = Lidar(720, -math.pi, math.radians(0.5), range_max=12.0)
HALL, CORRIDOR = hall(), corridor()


def drive(world, lidar, seconds=1.0, way=None):
    path = follow(world.tour[:3] if way is None else np.array(way), speed=0.8)
    return simulate(world, path, lidar, seed=1).scans[:round(seconds * lidar.rate)]


@pytest.mark.parametrize('code, changes', [
    (3.99, {'stated': (0.05, 4.0)}), (65.0, {'stated': (0.05, 100.0)}),
    (4.0, {'resolution': 0.01, 'stated': (0.05, 12.0)})])
def test_beams_with_the_code_have_no_return_from_the_first_scan_on(code, changes):
    scans = drive(HALL, dataclasses.replace(ALL_ROUND, range_max=4.0, no_return=code, **changes))
    found = NoReturn()
    for scan in scans:
        left = found.removed_from(scan)
        np.testing.assert_array_equal(left.valid, scan.valid & (scan.ranges != np.float32(code)))
    assert found.known == pytest.approx(code)


@pytest.mark.parametrize('lidar, code', [
    (dataclasses.replace(ALL_ROUND, dropouts=0.03), 11.99),
    (dataclasses.replace(PRESETS['hokuyo_utm30lx'], range_max=12.0, rate=10.0), 29.9)])
def test_a_code_of_few_beams_is_known_after_half_a_second(lidar, code):
    lidar, found = dataclasses.replace(lidar, no_return=code, stated=(0.05, 30.0)), NoReturn()
    for scan in drive(CORRIDOR, lidar, 1.0):
        left = found.removed_from(scan)
    assert (left.ranges != np.float32(code)).all() and found.known == pytest.approx(code)


def round_room(radius=5.0):
    angles = np.radians(np.arange(361))
    rim = radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return World(np.stack((rim[:-1], rim[1:]), axis=1), np.array([[-3.0, 0.0], [0.0, 1.0], [3.0, 0.0]]))


@pytest.mark.parametrize('world, changes', [
    (round_room(), {'resolution': 0.01}), (HALL, {'resolution': 0.1}),
    (rooms(), {'beams': 640, 'angle_min': -0.5, 'angle_increment': 1.0 / 639, 'resolution': 0.02})])
def test_walls_are_never_no_return(world, changes):
    """Without noise, as equal ranges are what a code is known by."""
    found = NoReturn()
    assert all(found.removed_from(scan) is scan for scan in drive(world, dataclasses.replace(
        ALL_ROUND, noise=0.0, **changes)))
    assert found.known is None


@pytest.mark.parametrize('noise', [0.0, 0.01])
def test_a_lidar_that_turns_on_the_spot_or_rests_keeps_the_end_of_a_corridor(noise):
    walls = [[[-9, -0.7], [9, -0.7]], [[-9, 0.7], [9, 0.7]], [[9, -0.7], [9, 0.7]], [[-9, -0.7], [-9, 0.7]]]
    world, found = World(np.array(walls, dtype=float), np.array([[-3.0, 0.0], [3.0, 0.0]])), NoReturn()
    lidar = dataclasses.replace(ALL_ROUND, noise=noise, resolution=0.05)
    for scan in drive(world, lidar, 6.0, [[0.0, 0.0], [0.3, 0.0], [0.0, 0.01]]):
        assert found.removed_from(scan) is scan
    for _ in range(20):
        assert found.removed_from(scan) is scan


def test_a_range_at_the_limit_is_no_return():
    geometry = ScanGeometry(0.0, 0.1, 3, 1.0, 4.0)
    assert Scan(0, [1.0, 3.99, 4.0], geometry).valid.tolist() == [True, True, False]


def poses(scans):
    odometry = Odometry()
    return np.array([odometry.process(scan).pose.as_array() for scan in scans])


@pytest.mark.filterwarnings('ignore:many beams:UserWarning')
@pytest.mark.parametrize('name', ['no_return_is_range_max', 'no_return_is_range_max.log'])
def test_a_drive_among_missing_returns_at_range_max_is_that_with_inf(cases, name):
    found, expected = (poses(open_recording(cases / 'no_return' / each).scans())
                       for each in (name, 'no_return_is_inf_control'))
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert np.hypot(*np.diff(found[:, :2], axis=0).T).sum() == pytest.approx(2.49, abs=0.02)


def test_a_hall_where_half_the_beams_have_a_code_is_driven_as_with_inf():
    code = 3.99
    lidar = dataclasses.replace(ALL_ROUND, range_max=4.0, stated=(0.05, 30.0))
    scans, control = (drive(HALL, dataclasses.replace(lidar, no_return=each), 4.0) for each in (code, math.inf))
    assert np.mean([scan.ranges == np.float32(code) for scan in scans]) > 0.4
    with pytest.warns(UserWarning, match=f'largest range, {code:g} m') as warned:
        found = poses(scans)
    assert len(warned) == 1
    np.testing.assert_array_equal(found, poses(control))
