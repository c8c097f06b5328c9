# SPDX-License-Identifier: Apache-2.0
"""Odometry over whole simulated drives: small objects, range noise, local map and loop closure."""
import dataclasses
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from benchmarks.odometry.course import simulated
from benchmarks.odometry.places import hall_of_chairs

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.replays.lidars import turned
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.simulation import LIDARS, Lidar, follow, hall, simulate


def drive_error(course, **changes):
    """Mean translation error [m] over 60 scans, 5 m."""
    odometry = Odometry(Parameters().replace(changes))
    truth = [SE2.from_array(pose) for pose in course.reference]

    def motion(poses, k):
        return poses[k - 60].inverse() @ poses[k]

    poses = [odometry.process(scan).pose for scan in course.scans]
    off = [motion(truth, k).inverse() @ motion(poses, k) for k in range(60, len(poses))]
    return np.mean([math.hypot(each.x, each.y) for each in off])


@pytest.mark.parametrize('seed', range(3))
def test_chair_legs_suffice_where_no_wall_is_within_range(seed):
    """The legs occlude each other: a single key frame contains too few of them, and chains of scans have to help."""
    course = simulated(hall_of_chairs(seed), LIDARS['hokuyo_urg04lx'], seed)
    off = drive_error(course)
    assert off < 0.03
    assert off < 0.75 * drive_error(course, **{'advanced.odometry.pole_size': 0.0})
    assert off < drive_error(course, **{'odometry.key_frames': 1})


def drive_through_hall(share, **changes):
    """Lowest score of a drive through a hall with a cheap lidar, and the translation error [m] at its end."""
    lidar = dataclasses.replace(LIDARS['rplidar_a'], noise_ratio=share)
    world = hall(0)
    drive = simulate(world, follow(world.tour).until(51.0), lidar, seed=0)
    odometry = Odometry(Parameters().replace(changes))
    updates = [odometry.process(scan) for scan in drive.scans[:500]]
    truth = relative(drive.truth[:1], drive.truth[499:500])[0]
    off = SE2.from_array(truth).inverse() @ updates[-1].pose
    # A restart counts as a score below all others.
    scores = [update.registration.score if update.registration else -1.0 for update in updates[1:]]
    return min(scores), math.hypot(off.x, off.y)


def test_a_lidar_whose_far_ranges_are_off_by_a_quarter_of_a_metre_is_not_lost():
    """With a constant noise, points off by several kernels lower the score of the true pose below the threshold."""
    score, off = drive_through_hall(0.03)
    assert score > 0.5 and off < 0.2
    assert drive_through_hall(0.03, **{'advanced.scan.noise_ratio_max': 0.0})[0] < 0.4


@pytest.mark.parametrize('yaw', [0.0, 2.5])
def test_a_drive_that_drifts_closes_where_it_comes_back(yaw):
    """Two laps with a heading drift of 0.01 deg per scan."""
    tour = hall(seed=1).tour
    drive = simulate(hall(seed=1), follow(np.vstack((tour, tour)), speed=2.0), Lidar(rate=2.0), seed=1)
    odometry, loops = Odometry(), Loops()
    truth = relative(np.repeat(drive.truth[:1], len(drive.truth), axis=0), drive.truth)
    drifted = truth[:1]
    for step in relative(truth[:-1], truth[1:]):
        drifted = np.vstack((drifted, compose(drifted[-1:], step[None] + (0.0, 0.0, math.radians(0.01)))))
    turn = SE2(theta=yaw)
    for scan, pose in zip(turned(drive.scans, yaw), drifted, strict=True):
        loops.add(dataclasses.replace(odometry.process(scan), pose=turn @ SE2.from_array(pose) @ turn.inverse()))
    closed, pairs = loops.poses(yaw), np.array([loop.pair for loop in loops.found])
    assert len(pairs) > 20
    assert (pairs[:, 1] > pairs[:, 0]).all()
    assert closed[0] == pytest.approx(truth[0])

    def seen_twice(poses):
        true, found = (relative(each[pairs[:, 0]], each[pairs[:, 1]]) for each in (truth, poses))
        gap = relative(true, found)
        return np.hypot(gap[:, 0], gap[:, 1]).mean()

    assert seen_twice(drifted) > 0.2
    assert seen_twice(closed) < 0.03


DIGEST = """
import dataclasses
from hashlib import sha256
from dbscan_reg_ros import SE2, Odometry
from rooms import L_ROOM, look, outline
odometry, digest, room = Odometry(), sha256(), outline(L_ROOM)
for k in range(40):
    scan = look(room, SE2(0.02 * k, 0.0, 0.03 * k), noise=0.01, seed=k)
    update = odometry.process(dataclasses.replace(scan, stamp=k * 10**8))
    digest.update(update.pose.as_array().tobytes() + update.covariance.tobytes() + update.twist.tobytes())
print(digest.hexdigest())
"""


def test_results_do_not_depend_on_the_run_nor_on_the_number_of_threads(root):
    """To the last bit, in processes of their own."""
    digests = set()
    for threads in ('1', '8'):
        variables = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), threads)
        result = subprocess.run([sys.executable, '-c', DIGEST], capture_output=True, text=True, check=True,
                                env=os.environ | variables | {'PYTHONPATH': f'{root}:{root / "test"}'})
        digests.add(result.stdout)
    assert len(digests) == 1
