# SPDX-License-Identifier: Apache-2.0
"""Odometry over whole drives behind people and among movable objects."""
import dataclasses
import math

import numpy as np
import pytest
from benchmarks.odometry.courses import strolled
from rooms import with_person

from dbscan_reg_ros import SE2, Odometry, Parameters, Status
from dbscan_reg_ros.simulation import Lidar, Person, corridor, follow, rooms, simulate


@pytest.mark.parametrize(('size', 'held'), [(1.1, False), (0.0, True)])
def test_a_person_walking_ahead_does_not_stop_the_odometry_in_a_corridor(size, held):
    """The person keeps the same distance, and is nearly all that faces along the corridor."""
    world = corridor(seed=1)
    start, end = world.tour
    leader = Person(np.array([start + np.array((1.2, 0.0)), end]), speed=1.0)
    result = simulate(dataclasses.replace(world, people=(leader,)), follow(world.tour, speed=1.0).until(21.0), Lidar(),
                      seed=1)
    odometry = Odometry(Parameters().replace({'advanced.odometry.movable_size': size}))
    for scan in result.scans[:200]:
        pose = odometry.process(scan).pose
    first, last = (SE2.from_array(result.truth[k]) for k in (0, 199))
    off = (first.inverse() @ last).inverse() @ pose
    assert off.x < -5.0 if held else abs(off.x) < 0.3


def error_behind_a_person(room, walk, **changes):
    """Error [m] after 15 s with a person always a metre ahead of the sensor, and number of OK scans."""
    world = rooms(room)
    result = simulate(world, follow(world.tour).until(16.0), Lidar())
    rng, bearing = np.random.default_rng(walk), 0.0
    parameters = Parameters().replace({f'advanced.odometry.{name}': value for name, value in changes.items()})
    odometry, ok = Odometry(parameters), 0
    for scan in result.scans[:150]:
        bearing = float(np.clip(bearing + rng.normal(0.0, 0.15), -1.0, 1.0))
        update = odometry.process(with_person(scan, bearing)[0])
        ok += update.status is Status.OK
    first, last = (SE2.from_array(result.truth[k]) for k in (0, 149))
    off = (first.inverse() @ last).inverse() @ update.pose
    return math.hypot(off.x, off.y), ok


def test_a_co_moving_person_straight_ahead_does_not_bias_the_odometry():
    """The person keeps the same distance, and is most of what faces along the drive."""
    off, _ = error_behind_a_person(2, 2, movable_size=0.0)
    assert off > 0.5
    off, ok = error_behind_a_person(2, 2)
    assert off < 0.01 and ok == 150


def test_a_symmetric_corridor_does_not_stop_a_rotation(intel_log):
    """The sensor turns on the spot while a person hides most of the view.

    A pose rotated by 180 deg, 5 m away, fits slightly better.
    """
    odometry, turned = Odometry(), []
    for scan in strolled(intel_log.scans[:1890], seed=0)[1650:]:
        turned.append(odometry.process(scan).pose.theta)
    off = np.unwrap(turned) - np.unwrap(intel_log.reference[1650:1890, 2])
    assert np.degrees(np.abs(off - off[0]).max()) < 3.0


def lag_behind_a_person(hidden, seed, **changes):
    """Lag [m] after 6 s along a bare corridor whose end a person hides in some scans, and statuses."""
    world = dataclasses.replace(corridor(length=16.0, doors=0), tour=np.array([(2.0, 0.0), (12.0, 0.0)]))
    result = simulate(world, follow(world.tour).until(7.0), Lidar(), seed=seed)
    odometry = Odometry(Parameters().replace({f'advanced.odometry.{name}': value for name, value in changes.items()}))
    statuses = []
    for k, scan in enumerate(result.scans[:60]):
        update = odometry.process(with_person(scan, 0.0)[0] if hidden(k) else scan)
        if not hidden(k):
            statuses.append(update.status)
    first, last = (SE2.from_array(result.truth[k]) for k in (0, 59))
    return -((first.inverse() @ last).inverse() @ update.pose).x, statuses


@pytest.mark.parametrize(('retries', 'lost'), [(2, False), (0, True)])
def test_older_key_frames_are_used_where_the_latest_is_occluded(retries, lost):
    """A person hides the end of the corridor in every other three scans."""
    behind, statuses = lag_behind_a_person(lambda k: k % 6 < 3, 0, older_key_frames=retries)
    assert (behind > 0.3) is lost
    assert (sum(status is not Status.OK for status in statuses) > 5) is lost


@pytest.mark.parametrize('seed', [3, 6])
def test_a_start_behind_a_person_is_found_once_the_view_is_clear(seed):
    """The end of the corridor is hidden from the third scan on, while the sensor starts and drives 0.9 m."""
    behind, statuses = lag_behind_a_person(lambda k: 3 <= k < 20, seed)
    assert abs(behind) < 0.03
    assert all(status is Status.OK for status in statuses[-20:])
