# SPDX-License-Identifier: Apache-2.0
"""The simulator: exact ranges, exact truth, the noise that was asked for."""
import dataclasses
import math

import numpy as np
import pytest

from dbscan_reg_ros import SE2, register
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.simulation import (
    LIDARS,
    PRESETS,
    Lidar,
    Person,
    WheelErrors,
    World,
    follow,
    hall,
    measure,
    rooms,
    simulate,
    wheel_odometry,
    yaw_rates,
)
from dbscan_reg_ros.simulation.raycasting import cast
from dbscan_reg_ros.simulation.worlds import box, clearance

NO_SEGMENTS = np.empty((0, 2, 2))


def exact(name):
    """A lidar that measures at once and without any error."""
    return dataclasses.replace(LIDARS[name], noise=0.0, noise_ratio=0.0, resolution=0.0, dropouts=0.0, duration=0.0)


def directions(angles):
    return np.stack((np.cos(angles), np.sin(angles)), axis=1)


def rng():
    return np.random.default_rng(0)


def on_surfaces(world, points):
    """Distance of each point from the world's walls and columns."""
    return np.abs(clearance(points, world.segments, world.circles))


def test_a_column_hides_what_is_behind_it_and_nothing_beside_it():
    wall = np.array([[(5.0, -5.0), (5.0, 5.0)]])
    column = np.array([(3.0, 0.0, 0.5)])
    edge = math.asin(0.5 / 3.0)
    ranges = cast(np.zeros((1, 2)), directions(np.array([0.0, edge - 1e-6, edge + 1e-6, math.pi])), wall, column)
    np.testing.assert_allclose(ranges[0], 2.5, atol=1e-12)
    np.testing.assert_allclose(ranges[1], 3.0 * math.cos(edge), atol=1e-2)
    np.testing.assert_allclose(ranges[2], 5.0 / math.cos(edge + 1e-6), atol=1e-9)
    assert ranges[3] == math.inf


@pytest.mark.parametrize('lidar', [Lidar(noise=0.0, mounting=SE2(0.2, -0.1, 0.7)), exact('rplidar_a')],
                         ids=['mounted', 'clockwise'])
def test_truth_lays_every_return_on_a_surface(lidar):
    world = rooms(1)
    result = simulate(world, follow(world.tour[:2]), lidar)
    assert len(result.scans) == len(result.truth) == len(result.stamps) > 20
    for scan, pose in zip(result.scans, result.truth, strict=True):
        assert on_surfaces(world, SE2.from_array(pose).apply(scan.points[scan.valid])).max() < 1e-5


def test_motion_within_a_scan_shows_in_the_ranges_and_is_undone_by_the_path():
    world = rooms(1)
    lidar = dataclasses.replace(exact('hokuyo_urg04lx'), duration=LIDARS['hokuyo_urg04lx'].duration)
    result = simulate(world, follow(world.tour[:2]), lidar)
    straight = 0.0
    for stamp, scan, pose in zip(result.stamps, result.scans, result.truth, strict=True):
        times = (stamp - result.stamps[0]) * 1e-9 + scan.time_increment * np.arange(lidar.beams)
        poses = result.path.poses_at(times)[scan.valid]
        points = scan.points[scan.valid]
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        world_points = poses[:, :2] + np.stack((c * points[:, 0] - s * points[:, 1],
                                                s * points[:, 0] + c * points[:, 1]), axis=1)
        assert on_surfaces(world, world_points).max() < 1e-4
        straight = max(straight, on_surfaces(world, SE2.from_array(pose).apply(points)).max())
    assert straight > 0.02


def test_noise_dropouts_and_outliers_are_those_asked_for():
    world = World(box(0.0, 0.0, 8.0, 8.0, 0.0), np.zeros((2, 2)))
    lidar = Lidar(beams=100_000, angle_increment=math.pi / 100_000, range_max=20.0, noise=0.02, dropouts=0.05,
                  outliers=0.1)
    truth = measure(world, [(0.0, 0.0, 0.0)], dataclasses.replace(lidar, noise=0.0, dropouts=0.0, outliers=0.0), rng())
    seen = measure(world, [(0.0, 0.0, 0.0)], lidar, rng())
    error = seen.ranges[seen.valid].astype(float) - truth.ranges[seen.valid]
    near = np.abs(error) < 0.1
    assert 1.0 - seen.valid.mean() == pytest.approx(0.05, abs=0.003)
    assert (~near).sum() / len(truth.ranges) == pytest.approx(0.1, abs=0.005)
    assert error[near].std() == pytest.approx(0.02, rel=0.05)
    assert error[near].mean() == pytest.approx(0.0, abs=5e-4)


def test_ranges_beyond_the_limits_are_missing_and_others_are_rounded():
    world = World(box(0.0, 0.0, 8.0, 2.0, 0.0), np.zeros((2, 2)))
    lidar = Lidar(noise=0.0, range_min=1.1, range_max=3.0, resolution=0.05)
    ranges = measure(world, [(0.0, 0.0, 0.0)], lidar, rng()).ranges
    returned = np.isfinite(ranges)
    assert 0 < returned.sum() < len(ranges)
    assert ranges[returned].min() >= np.float32(1.1) and ranges[returned].max() <= 3.0
    np.testing.assert_allclose(ranges[returned] / 0.05, np.round(ranges[returned] / 0.05), atol=1e-4)


def test_the_same_seed_gives_the_same_scans_and_another_seed_other_noise():
    world = hall(0)
    path = follow(world.tour[:2]).until(2.0)
    first, again, other = (simulate(world, path, seed=seed) for seed in (5, 5, 6))
    for a, b in zip(first.scans, again.scans, strict=True):
        np.testing.assert_array_equal(a.ranges, b.ranges)
    assert not np.array_equal(first.scans[0].ranges, other.scans[0].ranges)
    assert np.array_equal(rooms(4).segments, rooms(4).segments)
    assert not np.array_equal(rooms(4).segments, rooms(5).segments)


def test_a_path_keeps_its_limits_and_looks_where_it_drives():
    path = follow([(0, 0), (4, 0), (4, 3), (0, 3), (4, 3)], speed=0.7, acceleration=0.4, turn_rate=0.8)
    steps, between = np.diff(path.poses, axis=0), np.diff(path.times)
    speed = np.hypot(*steps[:, :2].T) / between
    moving = speed > 1e-3
    assert speed.max() <= 0.7 + 1e-6
    assert np.abs(steps[:, 2] / between).max() <= 0.8 * 1.05
    assert speed[0] < 0.1 and speed[-1] < 0.1
    np.testing.assert_allclose(np.cos(np.arctan2(steps[moving, 1], steps[moving, 0]) - path.poses[:-1][moving, 2]), 1.0,
                               atol=1e-3)
    np.testing.assert_allclose(path.poses_at([path.duration])[0, :2], (4.0, 3.0), atol=1e-3)
    assert 13.0 < path.length < 15.0


@pytest.mark.parametrize(('make', 'name'), [
    (rooms, 'hokuyo_utm30lx'), (rooms, 'rplidar_a'), (hall, 'sick_lms5xx'),
])
def test_registration_of_scans_without_noise_is_exact(make, name):
    """Off by less than 0.1 mm and 0.006 deg between places 0.3 s apart on the tour."""
    world, lidar = make(seed=1), exact(name)
    path = follow(world.tour)
    for time in rng().uniform(0.0, path.duration - 1.0, 20):
        first, second = path.poses_at([time, time + 0.3])
        found = register(*(extract_features(measure(world, [pose], lidar, rng())) for pose in (first, second)))
        error = (SE2.from_array(first).inverse() @ SE2.from_array(second)).inverse() @ found.transform
        assert math.hypot(error.x, error.y) < 1e-4 and abs(error.theta) < 1e-4


def test_a_person_walks_to_and_fro():
    person = Person([(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)], speed=1.0, radius=0.3)
    walked = np.array([person.circle_at(time) for time in (0.0, 2.0, 3.5, 4.5, 7.0, 8.0)])
    np.testing.assert_allclose(walked[:, :2], [(0, 0), (2, 0), (3, 0.5), (3, 0.5), (1, 0), (0, 0)], atol=1e-12)
    world = World(NO_SEGMENTS, np.zeros((2, 2)), people=(person,))
    still = Lidar(beams=1, angle_min=0.0, noise=0.0, range_min=0.0)
    assert measure(world, [(-1.0, 0.0, 0.0)], still, rng(), time=2.0).ranges[0] == pytest.approx(2.7)


def test_perfect_wheels_follow_the_path():
    path = follow(rooms(1).tour)
    stamps, poses = wheel_odometry(path, WheelErrors((1.0, 1.0), (0.0, 0.0)), rate=100.0)
    truth = path.poses_at((stamps - stamps[0]) * 1e-9)
    start = SE2.from_array(truth[0])
    np.testing.assert_allclose(start.apply(poses[:, :2]), truth[:, :2], atol=0.01)
    np.testing.assert_allclose(np.cos(poses[:, 2] + start.theta - truth[:, 2]), 1.0, atol=1e-9)


def test_wheels_that_slip_and_a_wrong_scale_show_in_the_distance():
    path = follow([(0.0, 0.0), (20.0, 0.0)], speed=1.0)

    def driven(**errors):
        return wheel_odometry(path, WheelErrors(noise=(0.0, 0.0), **errors))[1][-1, 0]

    assert driven(scale=(1.0, 1.0)) == pytest.approx(20.0, abs=0.01)
    assert driven(scale=(1.05, 1.0)) == pytest.approx(21.0, abs=0.01)
    assert driven(scale=(1.0, 1.0), slips=[(5.0, 8.0, 2.0)]) == pytest.approx(23.0, abs=0.05)
    assert driven(scale=(1.0, 1.0), slips=[(5.0, 8.0, 0.0)]) == pytest.approx(17.0, abs=0.05)


def test_a_gyroscope_integrates_to_the_rotation_and_its_bias():
    path = follow(rooms(1).tour)
    stamps, rates = yaw_rates(path, rate=200.0, bias=0.01, noise=0.005)
    turned = path.poses[-1, 2] - path.poses[0, 2]
    assert rates.sum() / 200.0 == pytest.approx(turned + 0.01 * path.duration, abs=0.02)
    assert np.diff(stamps).min() == np.diff(stamps).max() == 5_000_000
    still = follow([(0, 0), (1, 0)], pauses={0: 100.0})
    _, rates = yaw_rates(still, bias=0.0, noise=0.005)
    assert rates[:9000].std() == pytest.approx(0.005, rel=0.05)


def test_a_lidar_sends_missing_returns_limits_and_beams_as_its_driver_does():
    world = World(box(0.0, 0.0, 6.0, 4.0, 0.0), np.array([(0.0, 0.0), (1.0, 0.0)]))
    lidar = dataclasses.replace(exact('hokuyo_urg04lx'), no_return=0.0, stated=(0.01, 50.0), beams_vary=7,
                                range_max=2.5)
    scans = simulate(world, follow(world.tour, pauses={0: 2.0}), lidar).scans
    counts = {scan.geometry.size for scan in scans}
    assert counts <= set(range(675, 690)) and len(counts) > 5
    for scan in scans:
        assert (scan.geometry.range_min, scan.geometry.range_max) == pytest.approx((0.01, 50.0))
        # The field of view is the same whatever the number of beams.
        assert scan.geometry.size * scan.geometry.angle_increment == pytest.approx(682 * lidar.angle_increment)
        assert (scan.ranges[~scan.valid] == 0.0).all() and scan.ranges.max() <= 2.5
        assert 0.2 < scan.valid.mean() < 0.9
    many = simulate(world, follow(world.tour), dataclasses.replace(PRESETS['omron_os32c'], dropouts=0.2)).scans
    assert np.mean([scan.ranges == 50.0 for scan in many]) == pytest.approx(0.2, abs=0.01)
    assert all((scan.valid == (scan.ranges < 50.0)).all() for scan in many)


def test_reversed_beams_are_measured_from_the_last_to_the_first():
    world = World(box(0.0, 0.0, 6.0, 4.0, 0.0), np.array([(-1.0, 0.0), (1.0, 0.0)]))
    path = follow(world.tour, speed=1.0)
    clockwise = Lidar(361, math.pi, -math.radians(1.0), rate=5.0, duration=0.2, noise=0.0)
    sent = dataclasses.replace(clockwise, angle_min=-math.pi, angle_increment=math.radians(1.0), reversed=True)
    for ours, other in zip(simulate(world, path, sent).scans, simulate(world, path, clockwise).scans, strict=True):
        np.testing.assert_allclose(ours.ranges, other.ranges[::-1], atol=1e-5)
        assert ours.time_increment == other.time_increment > 0.0
