# SPDX-License-Identifier: Apache-2.0
"""The modes of a track, through drives in which scans are not found."""
import dataclasses

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Odometry, Parameters, Prior, Scan, Status
from dbscan_reg_ros.core.odometry.state import Mode

ROOM = outline(L_ROOM)
TENTH = 100_000_000
P = Parameters().odometry


def seen(index, x=0.0):
    """A scan of the room from `x` [m], at a tenth of a second for each index."""
    return dataclasses.replace(look(ROOM, SE2(x), FULL, 0.01, index), stamp=index * TENTH)


def noise(index):
    return Scan(index * TENTH, np.random.default_rng(100 + index).uniform(0.3, 8.0, FULL.size), FULL)


def modes(odometry, scans, prior=None):
    for scan in scans:
        odometry.process(scan, prior)
        yield odometry._state.tracking.mode


@pytest.fixture
def odometry():
    """After ten scans at 0.3 m/s."""
    odometry = Odometry()
    assert list(modes(odometry, [seen(i, 0.03 * i) for i in range(10)])) == [Mode.STARTING, *[Mode.TRACKING] * 9]
    return odometry


def test_a_track_coasts_is_lost_and_starts_again(odometry):
    found = list(modes(odometry, map(noise, range(10, 70))))
    coasting, restart = round(10 * P.coast_time), round(10 * P.restart_time)
    assert found[:coasting] == [Mode.COASTING] * coasting
    assert found[coasting + 1:restart - 1] == [Mode.LOST] * (restart - coasting - 2)
    assert Mode.STARTING in found[restart - 1:restart + 2]


@pytest.mark.parametrize(('lost', 'mode'), [(1, Mode.COASTING), (5, Mode.COASTING), (20, Mode.LOST)])
def test_a_scan_that_is_found_ends_coasting_and_loss(odometry, lost, mode):
    assert list(modes(odometry, map(noise, range(10, 10 + lost))))[-1] is mode
    tracking = odometry._state.tracking
    assert tracking.lost_time == pytest.approx(0.1 * lost, abs=1e-6)
    assert tracking.observability == 0.0
    found = list(modes(odometry, [seen(10 + lost, 0.3), seen(11 + lost, 0.3)]))
    assert found[-1] is Mode.TRACKING
    assert odometry._state.tracking.lost_time == 0.0


def test_lost_with_an_external_prior_the_pose_follows_it(odometry):
    start = odometry._state.pose
    prior = Prior(SE2(0.03), np.diag((0.005, 0.005, 0.005)) ** 2)
    assert list(modes(odometry, map(noise, range(10, 30)), prior))[-1] is Mode.LOST
    moved = start.inverse() @ odometry._state.pose
    assert moved.x == pytest.approx(20 * 0.03, abs=0.01)


def test_a_jump_forward_in_a_known_place_goes_on(odometry):
    assert list(modes(odometry, [seen(1000, 0.3)])) == [Mode.TRACKING]


def test_after_a_gap_the_displacement_is_unknown_until_the_map_before_it_is_found(odometry):
    """The robot is elsewhere after 12 s, and back in the room 2 s later."""
    known = odometry._state.window
    hall = outline([(-1.0, -4.0), (7.0, -4.0), (7.0, 2.5), (-1.0, 1.5)])
    there = [dataclasses.replace(look(hall, SE2(), FULL, 0.01, k), stamp=k * TENTH) for k in range(130, 150)]
    updates = [odometry.process(scan) for scan in there]
    sigma = np.sqrt(np.diagonal([update.covariance for update in updates], axis1=1, axis2=2))
    assert (sigma >= (12.0, 12.0, 3.14)).all()
    assert all(update.status is not Status.OK for update in updates)
    updates = [odometry.process(seen(k, 0.3)) for k in range(150, 160)]
    assert odometry._state.window.frames[0] is known.frames[0]
    assert updates[-1].status is Status.OK and updates[-1].pose.x == pytest.approx(0.3, abs=0.02)
    assert np.sqrt(np.diagonal(updates[-1].covariance)).max() < 0.05


@pytest.mark.parametrize('seed', [0])
def test_a_sensor_that_was_carried_away_goes_on_by_a_chain_and_rejoins_the_map(seed):
    """It is carried 2.5 m between two scans, faster than `odometry.max_speed`, and stays there."""
    walls = outline([(-2.0, -1.5), (6.0, -1.5), (6.0, 1.0), (1.5, 1.0), (1.5, 3.0), (-2.0, 3.0)])
    odometry = Odometry()

    def at(index, x):
        scan = look(walls, SE2(x), FULL, 0.01, index + 100 * seed)
        return odometry.process(dataclasses.replace(scan, stamp=index * TENTH))
    for k in range(10):
        at(k, 0.0)
    known = odometry._state.window
    too_fast = at(10, 2.5)
    assert too_fast.status is Status.FAILED and 'odometry.max_speed' in too_fast.registration.reason
    chained = at(11, 2.5)
    assert chained.status is Status.AMBIGUOUS and 'the previous scan' in chained.registration.reason
    assert odometry._state.tracking.mode is Mode.TRACKING
    assert odometry._state.window is not known and odometry._state.tracking.lost.window is known
    updates = [at(k, 2.5) for k in range(12, 30)]
    rejoined = next(update for update in updates if 'map before the loss' in update.registration.reason)
    assert rejoined.status is Status.AMBIGUOUS
    assert updates[-1].status is Status.OK and odometry._state.tracking.lost is None
    assert updates[-1].pose.x == pytest.approx(2.5, abs=0.02)
    assert max(np.abs(update.twist).max() for update in updates) < 0.5, 'a correction is no velocity'
