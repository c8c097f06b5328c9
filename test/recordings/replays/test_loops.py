# SPDX-License-Identifier: Apache-2.0
"""Places seen again: relations found, and poses that suit them."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import outline
from scipy.optimize import minimize

from dbscan_reg_ros import SE2, Odometry, Status
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.places.pose_graph import ROBUST, Constraints, optimise
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.replays.lidars import turned
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.simulation import Lidar, World, follow, hall, simulate


def ring(count=12, radius=4.0):
    angle = 2.0 * math.pi * np.arange(count) / count
    return np.column_stack((radius * np.sin(angle), radius * (1.0 - np.cos(angle)), wrap(angle)))


def relations_of(poses, rng, spread):
    """Neighbours, the last and the first as well, and chords across, with errors."""
    count = len(poses)
    first = np.concatenate((np.arange(count), np.arange(count // 2)))
    second = np.concatenate(((np.arange(count) + 1) % count, np.arange(count // 2) + count // 2))
    root = rng.normal(0.0, 1.0, (len(first), 3, 3)) * spread + np.diag([2.0, 2.0, 2.0]) * spread
    errors = np.einsum('eij,ej->ei', root, rng.normal(0.0, 1.0, (len(first), 3)))
    motions = compose(relative(poses[first], poses[second]), errors)
    return np.column_stack((first, second)), motions, root @ root.transpose(0, 2, 1)


def test_the_poses_are_those_of_robust_least_squares():
    """Scipy's minimum of the same sum: Cauchy's kernel of every relation's distance."""
    truth, rng = ring(), np.random.default_rng(1)
    pairs, motions, covariances = relations_of(truth, rng, 0.02)
    motions[5] += (0.5, -0.3, 0.2)
    found = optimise(truth, Constraints(pairs, motions, covariances))

    def cost(free):
        poses = np.vstack((truth[:1], free.reshape(-1, 3)))
        off = relative(motions, relative(poses[pairs[:, 0]], poses[pairs[:, 1]]))
        squared = np.einsum('ei,eij,ej->e', off, np.linalg.inv(covariances), off)
        return ROBUST ** 2 * np.log1p(squared / ROBUST ** 2).sum()

    best = minimize(cost, truth[1:].ravel(), options={'gtol': 1e-6, 'maxiter': 2000})
    assert cost(found[1:].ravel()) == pytest.approx(best.fun, rel=1e-4)
    assert found[1:] == pytest.approx(best.x.reshape(-1, 3), abs=2e-3)
    assert cost(found[1:].ravel()) < 0.9 * cost(truth[1:].ravel())


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
    assert len(loops.mapper.numbers) == sum(update.reference_changed for update in updates)
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
