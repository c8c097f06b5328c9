# SPDX-License-Identifier: Apache-2.0
"""A map that is built while the robot drives."""
import dataclasses
import itertools
import math

import numpy as np
import pytest
from rooms import outline

from dbscan_reg_ros import SE2, Odometry, Parameters
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.evaluation.metrics import absolute_error
from dbscan_reg_ros.places.localizer import State
from dbscan_reg_ros.places.mapper import Mapper
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.simulation import Lidar, World, corridor, follow, hall, rooms, simulate

DRIFT = math.radians(0.01)
"""Error [rad] of the heading that each scan adds."""


@pytest.fixture(scope='module')
def tour():
    """Through every room and back to the first, twice: true poses from the first on, and updates."""
    world = rooms(seed=2)
    drive = simulate(world, follow(np.vstack((world.tour, world.tour)), speed=1.0), Lidar(rate=2.0), seed=1)
    odometry = Odometry(Parameters())
    updates = [odometry.process(scan) for scan in drive.scans]
    return relative(np.repeat(drive.truth[:1], len(drive.truth), axis=0), drive.truth), updates


def drifted(updates):
    """The same updates of an odometry whose heading drifts."""
    pose = updates[0].pose
    yield updates[0]
    for before, update in itertools.pairwise(updates):
        pose = pose @ (before.pose.inverse() @ update.pose) @ SE2(theta=DRIFT)
        yield dataclasses.replace(update, pose=pose)


def errors(found, truth):
    """Errors (N, 3) of the poses that were found."""
    return relative(truth, np.array([each.pose.as_array() for each in found]))


def test_loops_correct_a_drift_and_places_seen_before_are_not_added(tour):
    truth, updates = tour
    mapper, found, sizes = Mapper(), [], []
    updates = list(drifted(updates))
    for update in updates:
        found.append(mapper.process(update))
        sizes.append(len(mapper.graph.poses))
    half = len(truth) // 2
    assert found[0].transform == SE2() and {each.state for each in found} == {State.LOCALISED}
    off, away = errors(found, truth), relative(truth, np.array([update.pose.as_array() for update in updates]))
    second = slice(half + 20, None)
    assert np.hypot(*away[second, :2].T).mean() > 0.3
    assert np.hypot(*off[second, :2].T).mean() < 0.1
    assert sizes[-1] <= 1.1 * sizes[half]
    spread = np.array([np.sqrt(np.trace(each.covariance[:2, :2])) for each in found])
    assert (np.hypot(*off[:, :2].T) < 4.0 * spread + 0.02).all()


def test_another_place_at_the_pose_of_an_old_one_is_added(tour):
    """The odometry has drifted by so much that it is at its first poses again, and the scans show other rooms."""
    _, updates = tour
    count, mapper = len(updates) // 8, Mapper()
    for update in updates[:count]:
        mapper.process(update)
    before = len(mapper.map().views)
    for update, old in zip(updates[count:2 * count], updates[:count], strict=True):
        mapper.process(dataclasses.replace(update, pose=old.pose))
        assert mapper.seen_again is None
    assert len(mapper.map().views) > 1.7 * before


def there_and_back(world, seed):
    """Through a world, back, and through it once more: true poses from the first on, and scans."""
    way = np.vstack((world.tour, world.tour[-2::-1], world.tour[1:]))
    drive = simulate(world, follow(way, speed=1.0), Lidar(rate=2.0), seed=seed)
    return relative(np.repeat(drive.truth[:1], len(drive.truth), axis=0), drive.truth), drive.scans


def test_loops_are_closed_with_key_frames_that_look_the_same_way():
    """There, back and there: key frames of the way back are as near, but show little of the same."""
    truth, scans = there_and_back(rooms(seed=22), 22)
    odometry, loops = Odometry(Parameters()), Loops(every=False)
    for scan in scans:
        loops.add(odometry.process(scan))
    pairs = np.array([loop.pair for loop in loops.found])
    off = relative(relative(*truth[pairs.T]), np.array([loop.motion.as_array() for loop in loops.found]))
    assert len(pairs) > 250
    assert np.hypot(*off[:, :2].T).max() < 0.06 and np.degrees(np.abs(off[:, 2])).max() < 1.0


@pytest.mark.parametrize('world', [rooms(seed=22), hall(seed=22)], ids=['rooms', 'hall'])
def test_poses_as_published_with_loops_are_better_than_those_of_the_odometry(world):
    """Where the odometry hardly drifts, and its errors are as large as those of loops."""
    truth, scans = there_and_back(world, 22)
    odometry, mapper = Odometry(Parameters()), Mapper()
    updates = [odometry.process(scan) for scan in scans]
    published = np.array([mapper.process(update).pose.as_array() for update in updates])
    alone = np.array([update.pose.as_array() for update in updates])
    assert absolute_error(published, truth) < 0.9 * absolute_error(alone, truth)


@pytest.mark.parametrize('seed', [20, 21])
def test_loops_share_an_error_among_the_motions_that_are_known_least(seed):
    """Where scans do not show the motion along the corridor, the motion model limits its error."""
    truth, scans = there_and_back(corridor(seed=seed), seed)
    odometry, loops, known = Odometry(Parameters()), Loops(every=False), []
    updates = [odometry.process(scan) for scan in scans]
    for update in updates:
        known.append(loops.add(update))
    away = relative(truth, np.array([update.pose.as_array() for update in updates]))
    off = relative(truth, loops.poses())
    assert loops.found and np.hypot(*off[:, :2].T).mean() < 0.9 * np.hypot(*away[:, :2].T).mean()
    # Also between key frames the covariance is that of the errors.
    error = (np.array([each.pose.as_array() for each in known]) - truth)[1:]
    error[:, 2] = wrap(error[:, 2])
    squared = [each @ np.linalg.solve(found.covariance, each) for each, found in zip(error, known[1:], strict=True)]
    assert np.quantile(squared, 0.99) < 16.3


def test_the_covariance_grows_where_no_key_frame_is_added():
    """Between two smooth walls the odometry stays where it was, says so, and adds no key frame."""
    walls = World(outline([(0.0, 0.0), (60.0, 0.0), (60.0, 2.4), (0.0, 2.4)]), np.array([(2.0, 1.2), (30.0, 1.2)]))
    drive = simulate(walls, follow(walls.tour, speed=1.0), Lidar(rate=5.0, range_max=9.0), seed=1)
    odometry, mapper = Odometry(Parameters()), Mapper()
    found = [mapper.process(odometry.process(scan)) for scan in drive.scans]
    off = drive.truth[:, 0] - drive.truth[0, 0] - np.array([each.pose.x for each in found])
    assert len(mapper.numbers) == 1 and off[-1] > 20.0
    spread = np.array([math.sqrt(each.covariance[0, 0]) for each in found])
    assert (off < 3.0 * spread + 0.02).all()
    assert max(math.sqrt(each.covariance[1, 1]) for each in found) < 0.2


def test_after_a_loss_the_robot_is_found_in_its_own_map(tour):
    truth, updates = tour
    half, start = len(truth) // 2, len(truth) // 4
    mapper = Mapper()
    for update in updates[:half]:
        mapper.process(update)
    before = len(mapper.map().views)
    # Another odometry begins elsewhere: its frame is that of its own first scan.
    odometry, found = Odometry(Parameters()), []
    for update in updates[start:start + 40]:
        found.append(mapper.process(odometry.process(update.features.measured)))
        if found[-1].state is State.LOCALISED:
            break
        assert found[-1].covariance[0, 0] > 25.0
        assert len(mapper.map().views) == before
    assert found[0].state is State.SEARCHING and found[-1].state is State.LOCALISED
    off = errors(found[-1:], truth[start + len(found) - 1:start + len(found)])[0]
    assert math.hypot(*off[:2]) < 0.1 and abs(math.degrees(off[2])) < 1.0
    assert math.sqrt(found[-1].covariance[0, 0]) < 0.3
    # What was seen since the loss is in the map where it is, too.
    assert len(mapper.graph.poses) > before and len(mapper.map().views) == len(mapper.graph.poses)
    numbers = np.array(mapper.numbers)
    numbers[before:] += start
    assert np.abs(relative(truth[numbers], mapper.graph.poses)).max() < 0.1


def test_a_map_does_not_change_when_the_mapper_goes_on_and_a_reset_begins_a_new_one(tour):
    _, updates = tour
    mapper = Mapper()
    assert mapper.map().views == []
    for update in updates[:40]:
        mapper.process(update)
    made = mapper.map(SE2(0.1, 0.2))
    poses, count = made.graph.poses.copy(), len(made.views)
    for update in updates[40:80]:
        mapper.process(update)
    assert np.array_equal(made.graph.poses, poses) and len(made.views) == count < len(mapper.map().views)
    assert made.mounting == SE2(0.1, 0.2)
    mapper.reset()
    assert mapper.process(updates[0]).transform == SE2() and len(mapper.map().views) == 1
