# SPDX-License-Identifier: Apache-2.0
"""A robot in a map: signatures, grids, and what the localiser says."""
import dataclasses
import itertools
import math

import numpy as np
import pytest

from dbscan_reg_ros import SE2, Odometry, Parameters, Scan, ScanGeometry
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import lever_arm, wrap
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.places.evidence import log_odds_alone
from dbscan_reg_ros.places.grid import Grid
from dbscan_reg_ros.places.localizer import Localizer, State
from dbscan_reg_ros.places.matching import FROM_AFAR, Drive, Matcher, Stop
from dbscan_reg_ros.places.signatures import BEARINGS, Signatures
from dbscan_reg_ros.robot.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyCounts, trace_rays
from dbscan_reg_ros.simulation import Lidar, follow, hall, rooms, simulate
from dbscan_reg_ros.simulation.raycasting import cast

HEADINGS = 2.0 * np.pi / BEARINGS * np.arange(BEARINGS) - np.pi
RESOLUTION = 0.05


def grid_of(world, turn=0.0):
    """The grid of what a lidar sees along the tour of a world, as a map whose origin is turned."""
    counts, angles = OccupancyCounts(RESOLUTION), np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    for start, end in itertools.pairwise(world.tour):
        for point in np.linspace(start, end, 2 + int(np.hypot(*(end - start)) / 0.5)):
            distance = cast(point[None], directions, world.segments, world.circles)
            counts.add(trace_rays(point + (distance + 0.02)[:, None] * directions, point, RESOLUTION, 30.0))
    grid = counts.grid()
    return Grid(grid.values, SE2(theta=turn) @ SE2(*grid.corner), RESOLUTION)


@pytest.fixture(scope='module')
def room():
    """A grid of 10 by 6 m with a wall around it and a box, in a frame that is turned."""
    values = np.full((120, 200), FREE, dtype=np.int8)
    values[[0, -1]], values[:, [0, -1]] = OCCUPIED, OCCUPIED
    values[40:60, 100:110] = OCCUPIED
    return Grid(values, SE2(3.0, -2.0, 0.5), RESOLUTION)


def test_rays_end_at_surfaces_of_a_grid_in_its_own_frame(room):
    origin = room.origin @ SE2(2.0, 2.5, 0.0)
    ranges = room.cast(origin.as_array()[None], np.array((0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)))[0]
    assert ranges == pytest.approx((3.0, 3.45, 1.95, 2.45), abs=0.06)


def test_rays_into_the_unknown_and_long_rays_have_no_return(room):
    holed = room.values[1:-1, 1:-1].copy()
    holed[:, 150:] = UNKNOWN
    grid = Grid(holed, SE2(), RESOLUTION)
    ranges = grid.cast(np.array([[2.0, 4.5, 0.0]]), np.array((0.0, math.pi)), 5.0)[0]
    assert math.isinf(ranges[0]) and ranges[1] == pytest.approx(1.95, abs=0.06)
    assert math.isinf(grid.cast(np.array([[2.0, 4.5, 0.0]]), np.array([math.pi]), 1.0)[0, 0])


def test_views_stand_in_free_space(room):
    poses = room.free_poses(0.5)
    assert len(poses) == pytest.approx(20 * 12, rel=0.2)
    assert room.distance.ravel()[room.cells(poses[:, :2])].min() >= 0.25


def test_the_view_at_any_heading_is_among_the_most_similar(room):
    poses = room.free_poses(0.5)
    signatures = Signatures(room.cast(poses, HEADINGS))
    for number in range(0, len(poses), 37):
        turn = 24 * 2.0 * np.pi / BEARINGS
        bearings = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
        ranges = room.cast(poses[number:number + 1] + np.array((0.0, 0.0, turn)), bearings)[0]
        similarity = signatures.compare(ranges, bearings)
        view, heading = np.divmod(np.argsort(-similarity, axis=None)[:20], BEARINGS)
        near = np.hypot(*(poses[view] - poses[number])[:, :2].T) <= 0.75
        assert (near & (np.abs(wrap(heading * 2.0 * np.pi / BEARINGS - turn)) < 0.15)).any()


def seen(grid, pose, bearings):
    """The features of a scan from a pose in a grid."""
    geometry = ScanGeometry(float(bearings[0]), float(bearings[1] - bearings[0]), len(bearings), 0.0, 30.0)
    return extract_features(Scan(0, grid.cast(pose[None], bearings)[0], geometry))


def test_a_wall_that_is_known_from_both_sides_is_seen_at_any_slant():
    """The cells inside the wall are unknown, as no scan sees them."""
    values = np.full((60, 200), FREE, dtype=np.int8)
    values[[0, 1, -2, -1]], values[:, [0, -1]] = OCCUPIED, OCCUPIED
    values[28:33], values[29:32] = OCCUPIED, UNKNOWN
    corridor = Grid(values, SE2(), RESOLUTION)
    pose = np.array((2.0, 0.7, 0.0))
    drive = Drive.of([Stop.of(SE2(), seen(corridor, pose, np.linspace(-0.5 * np.pi, 0.5 * np.pi, 361)))])
    assert Matcher(corridor).count(pose[None], drive)[0, 0] >= 0.98 * len(drive.hits)


def test_a_drive_is_moved_to_where_it_was_seen(room):
    pose = (room.origin @ SE2(3.0, 2.0, 0.3)).as_array()
    bearings = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    drive = Drive.of([Stop.of(SE2(), seen(room, pose, bearings))])
    matcher = Matcher(room)
    aligned = matcher.align(pose[None] + ((0.2, -0.15, 0.04), (0.0, 0.0, 0.0)), drive.hits, scales=FROM_AFAR)
    assert aligned.poses == pytest.approx(np.repeat(pose[None], 2, axis=0), abs=0.04)
    right, far = matcher.count(np.vstack((pose, pose + np.array((1.5, 0.7, 0.5)))), drive)
    assert right[0] == len(drive.hits) and right[3] >= 0.99 * len(drive.free)
    assert log_odds_alone(right[None])[0] > 0.0 > log_odds_alone(far[None])[0]


def driven(world, points, seed=3):
    drive = simulate(world, follow(points, speed=0.8), Lidar(rate=4.0), seed=seed)
    odometry = Odometry(Parameters())
    return drive.truth, [odometry.process(scan) for scan in drive.scans]


@pytest.fixture(scope='module')
def floor():
    return rooms(seed=2)


def test_a_start_anywhere_is_found_and_followed(floor):
    """Backwards through the tour, in a map whose frame is turned against the world."""
    localizer = Localizer(grid_of(floor, 0.7))
    truth, updates = driven(floor, floor.tour[6:2:-1])
    found = [localizer.process(update) for update in updates]
    first = next(number for number, each in enumerate(found) if each.state is State.LOCALISED)
    assert np.hypot(*np.diff(truth[:first + 1, :2], axis=0).T).sum() < 3.0
    for pose, each in zip(truth[first:], found[first:], strict=True):
        off = (SE2(theta=0.7) @ SE2.from_array(pose)).inverse() @ each.pose
        assert each.state is State.LOCALISED
        assert math.hypot(off.x, off.y) < 0.1 and abs(math.degrees(off.theta)) < 1.0
        assert off.as_array()[:2] @ np.linalg.solve(each.covariance[:2, :2], off.as_array()[:2]) < 60.0


CLICKED = np.diag((0.5, 0.5, 0.26)) ** 2
"""Covariance of a pose that is set with the mouse in RViz."""


def test_a_pose_that_is_set_counts_at_once_and_is_corrected_by_the_first_scans(floor):
    localizer = Localizer(grid_of(floor))
    truth, updates = driven(floor, floor.tour[6:4:-1])
    localizer.process(updates[0])
    clicked = SE2.from_array(truth[0]) @ SE2(0.5, -0.4, 0.25)
    localizer.set_pose(clicked, CLICKED, updates[0])
    found = [localizer.process(update) for update in updates[1:13]]
    assert {each.state for each in found} == {State.LOCALISED}
    off = np.array([(SE2.from_array(pose).inverse() @ each.pose).as_array()
                    for pose, each in zip(truth[1:], found, strict=False)])
    assert np.hypot(*off[2:, :2].T).max() < 0.1 and np.abs(off[2:, 2]).max() < 0.02
    assert math.sqrt(found[-1].covariance[0, 0]) < 0.1


def test_a_pose_that_is_set_wrong_is_given_up_and_the_right_one_is_found(floor):
    localizer = Localizer(grid_of(floor))
    truth, updates = driven(floor, floor.tour[6:2:-1])
    localizer.set_pose(SE2(*floor.tour[1], 1.0), CLICKED, updates[0])
    found = [localizer.process(update) for update in updates[1:]]
    states = [each.state for each in found]
    gone = states.index(State.SEARCHING)
    assert set(states[:gone]) <= {State.LOCALISED} and found[gone].covariance[0, 0] == pytest.approx(100.0)
    assert all(each.covariance[0, 0] > 0.2 for each in found[:gone])
    assert states[-1] is State.LOCALISED
    off = SE2.from_array(truth[-1]).inverse() @ found[-1].pose
    assert math.hypot(off.x, off.y) < 0.1


def test_the_map_places_a_scan_whose_motion_the_odometry_does_not_know(floor):
    localizer = Localizer(grid_of(floor))
    truth, updates = driven(floor, floor.tour[6:4:-1])
    localizer.set_pose(SE2.from_array(truth[0]), 1e-4 * np.eye(3), updates[0])
    for update in updates[1:6]:
        localizer.process(update)
    off = updates[6].pose @ SE2(0.1, 0.0, 0.15)
    for pose, status in ((off, Status.FAILED), (off, Status.AMBIGUOUS), (updates[6].pose, Status.OK)):
        found = localizer.process(dataclasses.replace(updates[6], pose=pose, status=status))
        error = SE2.from_array(truth[6]).inverse() @ found.pose
        assert found.state is State.LOCALISED and math.hypot(error.x, error.y) < 0.1 and abs(error.theta) < 0.02


def sigma(found):
    return math.sqrt(found.covariance[0, 0])


@pytest.mark.parametrize('after', [Status.OK, Status.AMBIGUOUS])
def test_the_scan_after_a_failed_one_shows_that_the_robot_was_carried(floor, after):
    localizer = Localizer(grid_of(floor))
    truth, updates = driven(floor, floor.tour[6:4:-1])
    _, elsewhere = driven(floor, floor.tour[2:4])
    localizer.set_pose(SE2.from_array(truth[0]), 1e-4 * np.eye(3), updates[0])
    assert [localizer.process(update).state for update in updates[1:6]] == [State.LOCALISED] * 5
    for status in (Status.FAILED, after):
        there = dataclasses.replace(updates[5], features=elsewhere[0].features, status=status)
        found = localizer.process(there)
        assert found.state is State.SEARCHING and sigma(found) == 10.0


def test_the_covariance_grows_as_that_of_the_odometry(floor):
    localizer = Localizer(grid_of(floor))
    truth, updates = driven(floor, floor.tour[6:4:-1])
    localizer.set_pose(SE2.from_array(truth[0]), 1e-4 * np.eye(3), updates[0])
    for update in updates[1:6]:
        localizer.process(update)
    doubtful = [dataclasses.replace(updates[5], covariance=updates[5].covariance + np.diag((error, error, 0.0)) ** 2)
                for error in (0.3, 1.0)]
    found = localizer.process(doubtful[0])
    assert found.state is State.LOCALISED and sigma(found) == pytest.approx(0.3, abs=0.05)
    person = extract_features(Scan(0, np.full(12, 0.8), ScanGeometry(-0.3, 0.05, 12, 0.0, 30.0)))
    found = localizer.process(dataclasses.replace(doubtful[1], pose=updates[5].pose @ SE2(0.4), features=person))
    assert found.state is not State.LOCALISED and 1.0 <= sigma(found) < 1.3


def test_an_unknown_heading_of_the_odometry_joins_its_scans_as_well_as_a_known_one(floor):
    localizer = Localizer(grid_of(floor))
    _, updates = driven(floor, floor.tour[6:4:-1])
    unknown = []
    for update in updates:
        lever = lever_arm(update.pose.x, update.pose.y)
        covariance = update.covariance + lever @ np.diag((0.0, 0.0, 0.4)) @ lever.T
        unknown.append(dataclasses.replace(update, covariance=covariance))
    known, other = [], []
    for states, drive in ((known, updates), (other, unknown)):
        localizer.reset()
        states += [localizer.process(update).state for update in drive]
    assert known == other and State.LOCALISED in known


def test_a_search_keeps_the_last_transform_and_a_reset_forgets_it(floor):
    localizer = Localizer(grid_of(floor))
    truth, updates = driven(floor, floor.tour[6:4:-1])
    localizer.set_pose(SE2.from_array(truth[0]), 1e-4 * np.eye(3), updates[0])
    before = localizer.process(updates[1]).transform
    localizer.search()
    after = localizer.process(dataclasses.replace(updates[2], status=Status.FAILED))
    assert after.state is State.SEARCHING and after.covariance[0, 0] == pytest.approx(100.0)
    assert after.transform.as_array() == pytest.approx(before.as_array())
    localizer.reset()
    assert localizer.process(dataclasses.replace(updates[3], status=Status.FAILED)).transform is None


def test_two_equal_buildings_are_ambiguous_to_the_end(floor):
    one = grid_of(floor)
    inner = one.values[1:-1, 1:-1]
    twice = np.hstack((inner, np.full((len(inner), 20), UNKNOWN, dtype=np.int8), inner))
    localizer = Localizer(Grid(twice, one.origin, RESOLUTION))
    truth, updates = driven(floor, floor.tour[6:3:-1])
    found = [localizer.process(update) for update in updates]
    assert {each.state for each in found} <= {State.SEARCHING, State.AMBIGUOUS}
    assert found[-1].state is State.AMBIGUOUS and found[-1].elsewhere < 0.01
    (first, one_share), (second, other_share) = found[-1].hypotheses[:2]
    assert one_share + other_share > 0.99 and min(one_share, other_share) > 0.2
    apart = abs(first.x - second.x)
    assert apart == pytest.approx(RESOLUTION * (inner.shape[1] + 20), abs=0.1)
    assert min(abs(each.x - truth[-1, 0]) for each in (first, second)) < 0.1


def test_another_building_is_not_this_one(floor):
    localizer = Localizer(grid_of(floor))
    _, updates = driven(hall(seed=4), hall(seed=4).tour[:4])
    states = [localizer.process(update).state for update in updates]
    assert State.LOCALISED not in states and states[-1] is State.NOT_IN_MAP
