# SPDX-License-Identifier: Apache-2.0
"""Places seen again: relations found, and poses that suit them."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import outline
from scipy.optimize import least_squares

from dbscan_reg_ros import SE2, Odometry, Status
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.places.pose_graph import ROBUST, Constraints, optimise
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.replays.lidars import turned
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.simulation import Lidar, World, follow, hall, simulate


def round_trip(seed, weak):
    """A circle driven twice: a graph with wrong loops and `weak` motions that are hardly known, and its chained poses.

    Each motion has a full covariance of its own.
    """
    rng, count, period = np.random.default_rng(seed), 24, 12
    angle = 2.0 * math.pi * np.arange(count) / period
    truth = np.column_stack((4.0 * np.sin(angle), 4.0 * (1.0 - np.cos(angle)), wrap(angle)))
    steps, loops = np.arange(count - 1), np.arange(count - period)
    pairs = np.column_stack((np.concatenate((steps, loops)), np.concatenate((steps + 1, loops + period))))
    root = 0.02 * (rng.normal(0.0, 0.5, (len(pairs), 3, 3)) + 1.5 * np.eye(3))
    errors = np.einsum('eij,ej->ei', root, rng.normal(0.0, 1.0, (len(pairs), 3)))
    motions, covariances = compose(relative(*truth[pairs.T]), errors), root @ root.transpose(0, 2, 1)
    for step in rng.choice(steps, weak, replace=False):
        covariances[step] = np.diag([100.0, 1e-4, 2.0])
        motions[step] += rng.normal(0.0, (1.5, 0.05, 0.5))
    motions[len(steps) + rng.choice(loops, 2, replace=False)] += rng.normal(0.0, (2.0, 2.0, 1.0), (2, 3))
    start = truth[:1]
    for motion in motions[steps]:
        start = np.vstack((start, compose(start[-1:], motion[None])))
    return Constraints(pairs, motions, covariances), start


def least_squares_of(constraints, start):
    """Scipy's minimum of the same sum from `start`: half of Cauchy's kernel of every relation's distance."""
    inverse = np.linalg.inv(np.linalg.cholesky(constraints.covariances_in_first()))

    def residuals(free):
        poses = np.vstack((start[:1], free.reshape(-1, 3)))
        off = relative(*poses[constraints.pairs.T]) - constraints.motions
        off[:, 2] = wrap(off[:, 2])
        off = np.einsum('eij,ej->ei', inverse, off)
        length = np.maximum(np.linalg.norm(off, axis=1, keepdims=True), 1e-12)
        return (off * ROBUST * np.sqrt(np.log1p((length / ROBUST) ** 2)) / length).ravel()

    found = least_squares(residuals, start[1:].ravel(), x_scale='jac')
    return found.x.reshape(-1, 3), found.cost, 0.5 * (residuals(start[1:].ravel()) ** 2).sum()


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
@pytest.mark.parametrize('off', [0.0, 0.5])
def test_the_poses_are_those_of_robust_least_squares(seed, off):
    """From a good start and from one that is off by half a metre and half a radian."""
    constraints, start = round_trip(seed, weak=0)
    start[1:] += np.random.default_rng(seed).normal(0.0, off, (len(start) - 1, 3))
    best, lowest, first = least_squares_of(constraints, start)
    found = optimise(start, constraints)
    assert wrap(found[1:] - best) == pytest.approx(np.zeros_like(best), abs=5e-3)
    _, _, cost = least_squares_of(constraints, found)
    assert cost == pytest.approx(lowest, rel=1e-5) and cost < 0.9 * first


@pytest.mark.parametrize('seed', range(1, 9))
def test_the_optimisation_ends_in_a_minimum_where_motions_are_hardly_known(seed):
    constraints, start = round_trip(seed, weak=4)
    _, lower, cost = least_squares_of(constraints, optimise(start, constraints))
    assert cost == pytest.approx(lower, rel=1e-5)


def test_a_drive_that_never_comes_back_stays_as_it_is():
    drive = simulate(hall(seed=1), follow([(2.0, 2.2), (10.0, 2.2)]), Lidar(rate=5.0), seed=1)
    odometry, loops = Odometry(), Loops()
    updates = [odometry.process(scan) for scan in drive.scans]
    for update in updates:
        loops.add(update)
    assert loops.found == []
    assert loops.poses() == pytest.approx(np.array([update.pose.as_array() for update in updates]), abs=1e-9)


JAGGED = [*enumerate((0.0, -1.0, -0.2, -0.8, -0.8, -1.5, 0.0, -0.5, 0.0, -1.0, -1.0, -0.3, 0.0))]
BLOCK = World(np.concatenate((outline([*JAGGED, (12.0, 6.0), (0.0, 6.0)]),
                              outline([(2.0, 2.0), (10.0, 2.0), (10.0, 4.0), (2.0, 4.0)]))),
              np.array([(3.0, 0.5), (11.0, 0.5), (11.0, 5.0), (1.0, 5.0), (1.0, 0.5), (6.0, 0.5)]))
"""Corridors around a block: along a jagged wall, and back between smooth ones."""


def around_the_block():
    """The scans, and the true poses from the first on."""
    lidar = Lidar(beams=360, angle_min=-math.pi, range_max=4.0, rate=2.0)
    drive = simulate(BLOCK, follow(BLOCK.tour, speed=1.0), lidar, seed=1)
    return drive.scans, relative(np.repeat(drive.truth[:1], len(drive.truth), axis=0), drive.truth)


def mean_distance(poses, others):
    return np.hypot(*(poses - others)[:, :2].T).mean()


def test_a_closure_stretches_the_degenerate_part_of_a_corridor_for_any_mounting():
    """The odometry falls short by 8 cm a scan between the smooth walls."""
    scans, truth = around_the_block()
    odometry, loops = Odometry(), Loops()
    updates = [odometry.process(scan) for scan in turned(scans, 1.5)]
    free = [update.status is Status.DEGENERATE for update in updates]
    short, turn = truth + np.outer(np.cumsum(free), (0.08, 0.0, 0.0)), SE2(theta=1.5)
    for update, pose in zip(updates, short, strict=True):
        loops.add(dataclasses.replace(update, pose=turn @ SE2.from_array(pose) @ turn.inverse()))
    assert loops.found and mean_distance(short, truth) > 0.2
    assert mean_distance(loops.poses(1.5), truth) < 0.03
    # All key frames of the odometry are kept, but a place seen again has no further view in the map.
    assert len(loops.mapper.numbers) == sum(update.is_key_frame for update in updates)
    assert len(loops.mapper.map().views) < len(loops.mapper.numbers)


@pytest.mark.parametrize('gap', [18, 24])
def test_a_jump_between_scans_stays_where_it_was(gap):
    """No scan is received for five seconds, and the trajectory jumps by half a metre.

    The next scan is a key frame or not.
    """
    scans, truth = around_the_block()
    odometry, loops = Odometry(), Loops()
    leapt = truth.copy()
    leapt[gap:, 1] += 0.5
    for number, (scan, pose) in enumerate(zip(scans, leapt, strict=True)):
        late = dataclasses.replace(scan, stamp=scan.stamp + 5 * 10**9 * (number >= gap))
        loops.add(dataclasses.replace(odometry.process(late), pose=SE2.from_array(pose)))
    assert loops.found and mean_distance(leapt, truth) > 0.2
    assert mean_distance(loops.poses(), truth) < 0.03
