# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the alignment with the map and of the dynamic points against the reference."""
import dataclasses

import numpy as np
import pytest
from accelerated_inputs import SIZES, oriented_points, ranges

from dbscan_reg_ros import SE2, Parameters, Scan, extract_features
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.core.features.free_space import build_free_space_profile
from dbscan_reg_ros.core.odometry.mapping.correspondences import PosePrior, align, pair_weights_after
from dbscan_reg_ros.core.odometry.mapping.dynamic_points import beside, detached_points, dynamic_points
from dbscan_reg_ros.core.odometry.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.odometry.mapping.key_frame_window import KeyFrameWindow, look_up_pairs, points_by_frame
from dbscan_reg_ros.core.odometry.mapping.local_map import newest_in_cell

P = Parameters()


@pytest.fixture
def window(rng):
    """Key frames of one to forty scans, somewhere near the origin."""
    frames = []
    for _ in range(rng.choice([1, 2, 7, 40])):
        distance, bearings = ranges(rng, 180)
        scan = Scan.from_ranges(distance, bearings)
        frames.append(KeyFrame(extract_features(scan, backend=REFERENCE), SE2.from_array(rng.normal(0.0, 0.3, 3))))
    return KeyFrameWindow(frames)


def noisy(rng, points):
    return dataclasses.replace(points, inverse_noise=rng.uniform(0.1, 1.0, len(points)))


@pytest.mark.parametrize('size', SIZES)
def test_pairs(both, rng, window, size):
    points = oriented_points(rng, size, reach=3.0)
    if not size:
        return
    frames = len(window.frames)
    for always in (rng.uniform(size=size) < 0.2, np.ones(size, dtype=bool), np.zeros(size, dtype=bool)):
        lookup = both(points_by_frame, always, rng.integers(0, 2 * size, size), frames, 66)
        for each in (points, noisy(rng, points)):
            pose = SE2.from_array(rng.normal(0.0, 0.3, 3))
            both(look_up_pairs, window._fields, window._poses, pose, each, lookup, 0.5)


def test_alignment(both, rng, window):
    for points in (oriented_points(rng, 180, reach=3.0), oriented_points(rng, 3000, reach=3.0)):
        pose, other = (SE2.from_array(rng.normal(0.0, 0.1, 3)) for _ in range(2))
        found = window.correspondences(pose, points, P.density)
        both(pair_weights_after, found, rng.normal(0.0, 0.05, 4), 0.05)
        both(pair_weights_after, dataclasses.replace(found, weights=None), np.array((0.0, 0.0, 0.0, 1.0)), 0.01)
        for information in (np.zeros((3, 3)), np.diag((10.0, 20.0, 30.0)) + rng.normal(0.0, 1.0, (3, 3))):
            for scales in ([], [0.05], [0.05, 0.03, 0.01]):
                both(align, found, other, PosePrior(pose, 0.5 * (information + information.T)), scales, 0.003)


def test_no_pairs(both, rng, window):
    """Where a scan is far from every key frame."""
    found = window.correspondences(SE2(1e4, 0.0, 0.0), oriented_points(rng, 100, reach=3.0), P.density)
    assert not len(found.index)
    both(align, found, SE2(1e4, 0.0, 0.0), PosePrior(SE2(), np.eye(3)), [0.05, 0.01], 0.003)


@pytest.mark.parametrize('size', SIZES)
def test_dynamic_points(both, rng, window, size):
    points = oriented_points(rng, size, reach=rng.choice([0.5, 2.0, 3.0]))
    jumps = dataclasses.replace(points, points=points.points * rng.choice([1.0, 0.5], size))
    for each in (points, noisy(rng, points), jumps):
        free_space = window.free_space(min(6, len(window.frames)))
        both(dynamic_points, each, SE2.from_array(rng.normal(0.0, 0.3, 3)), free_space, 0.2)
        for closed in (False, True):
            both(detached_points, each, 1.1, 0.2, closed)
        for ratio in (0.0, 0.1, 1.0):
            both(beside, each, rng.uniform(size=size) < ratio, 0.2)


@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('latest', [0, 1, 500])
def test_newest_in_cell(both, rng, size, latest):
    for reach in (0.1, 5.0, 1e5):
        both(newest_in_cell, oriented_points(rng, size, reach).points, rng.integers(0, 40, size),
             oriented_points(rng, latest, reach).points, 0.04)


@pytest.mark.parametrize('size', [1, 2, 7, 180, 3000])
@pytest.mark.parametrize('increment', [0.001, -0.01, 0.3])
def test_free_space(both, rng, size, increment):
    points = oriented_points(rng, size).points[::int(np.sign(increment))]
    both(build_free_space_profile, np.stack((points.real, points.imag), axis=1), increment)
