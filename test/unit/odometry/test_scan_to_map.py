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


def along_a_funnel(degrees, slant):
    """Registration, and alignment [m] along the walls, of a scan whose ranges are 1.5 cm too long.

    0 is the true and the predicted one.

    The tolerances of near-parallel walls are `scale` times the defaults.
    """
    defaults, walls, here = Parameters(), funnel(degrees), SE2(0.3, 0.0, 0.0)
    decision, free = (dataclasses.replace(each, parallel_tolerance=slant * each.parallel_tolerance)
                      for each in (defaults.decision, defaults.degeneracy))
    p = dataclasses.replace(defaults, decision=decision, degeneracy=free)
    poses = [SE2(0.05 * k, 0.0, 0.0) for k in range(6)]
    frames = [KeyFrame(extract_features(look(walls, pose, HALF, 0.005, k), p), pose) for k, pose in enumerate(poses)]
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


def test_in_the_odometry_steeper_walls_hold_nothing_either():
    first, second = (look(funnel(11), SE2(0.05 * k, 0.0, 0.0), HALF, 0.005, k) for k in range(2))
    second = dataclasses.replace(second, stamp=100_000_000)
    assert register(extract_features(first), extract_features(second)).status is Status.OK
    odometry = Odometry()
    odometry.process(first)
    assert odometry.process(second).status is Status.DEGENERATE
