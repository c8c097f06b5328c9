# SPDX-License-Identifier: Apache-2.0
"""Pose of a scan among several key frames, and its observability."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import HALF, look, outline

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.mapping.records import InitialAlignment, PosePrior
from dbscan_reg_ros.core.mapping.scan_to_map import align_to_map
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.records import Prior, Status


def funnel(degrees):
    """Walls along x, 2 m apart in the middle, each rotated by `degrees` towards the other."""
    rise = 20.0 * math.tan(math.radians(degrees))
    return outline([(-20.0, -1.0 - rise), (20.0, -1.0 + rise), (20.0, 1.0 - rise), (-20.0, 1.0 + rise)])[::2]


def key_frames(walls, noise, p, seed=0):
    """Of six scans, 5 cm apart."""
    poses = [SE2(0.05 * k, 0.0, 0.0) for k in range(6)]
    return [KeyFrame(extract_features(look(walls, pose, HALF, noise, seed + k), p), pose)
            for k, pose in enumerate(poses)]


def along_a_funnel(degrees, slant):
    """Registration, and alignment [m] along the walls, of a scan whose ranges are 1.5 cm too long.

    0 is the true and the predicted one.

    The tolerances of near-parallel walls are `scale` times the defaults.
    """
    defaults, walls, here = Parameters(), funnel(degrees), SE2(0.3, 0.0, 0.0)
    decision, free = (dataclasses.replace(each, parallel_tolerance=slant * each.parallel_tolerance)
                      for each in (defaults.decision, defaults.degeneracy))
    p = dataclasses.replace(defaults, decision=decision, degeneracy=free)
    frames = key_frames(walls, 0.005, p)
    scan = look(walls, here, HALF, 0.005, 9)
    features = extract_features(dataclasses.replace(scan, ranges=scan.ranges + 0.015), p)
    spread = np.diag((0.02, 0.02, 0.01)) ** 2
    registration = register(frames[-1].features, features, p, Prior(SE2(0.05, 0.0, 0.0), spread))
    initial, prior = InitialAlignment(here, registration.degenerate_direction), PosePrior(here, np.linalg.inv(spread))
    pose, _ = align_to_map(KeyFrameWindow(frames), features, initial, prior, p)
    return registration, pose.x - here.x


@pytest.mark.parametrize('degrees', [2, 4, 6])
def test_near_parallel_walls_constrain_nothing_along_them(degrees):
    """Taken exactly, their angle would: a corridor 3 cm wider lies 0.1 to 0.4 m farther back."""
    registration, off = along_a_funnel(degrees, 1.0)
    assert registration.status is Status.DEGENERATE
    assert math.sin(registration.degenerate_direction) == pytest.approx(0.0, abs=0.02)
    assert abs(off) < 0.005
    assert along_a_funnel(degrees, 0.0)[1] < -0.05


def test_the_parallel_tolerance_makes_a_funnel_degenerate():
    assert along_a_funnel(6, 0.0)[0].status is Status.OK


def test_noise_of_parallel_walls_holds_hardly_anything_along_them():
    """3 mm where the prior, which is sure to 20 mm, is not strengthened along the degenerate direction."""
    p, walls, here, off = Parameters(), funnel(0), SE2(0.3, 0.0, 0.0), []
    prior = PosePrior(here, np.diag((2500.0, 2500.0, 1e4)))
    for seed in range(0, 120, 10):
        features = extract_features(look(walls, here, HALF, 0.02, seed + 9), p)
        window = KeyFrameWindow(key_frames(walls, 0.02, p, seed))
        off.append(align_to_map(window, features, InitialAlignment(here, 0.0), prior, p)[0].x - here.x)
    assert np.sqrt(np.mean(np.square(off))) < 0.0015


def test_in_the_odometry_steeper_walls_hold_nothing_either():
    first, second = (look(funnel(11), SE2(0.05 * k, 0.0, 0.0), HALF, 0.005, k) for k in range(2))
    second = dataclasses.replace(second, stamp=100_000_000)
    assert register(extract_features(first), extract_features(second)).status is Status.OK
    odometry = Odometry()
    odometry.process(first)
    assert odometry.process(second).status is Status.DEGENERATE
