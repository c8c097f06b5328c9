# SPDX-License-Identifier: Apache-2.0
"""A map that is built while the robot drives."""
import dataclasses
import itertools
import math

import numpy as np
import pytest

from dbscan_reg_ros import SE2, Odometry, Parameters
from dbscan_reg_ros.places.localizer import State
from dbscan_reg_ros.places.mapper import Mapper
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

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
