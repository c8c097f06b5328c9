# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the alignment with the map and of the dynamic points against the reference."""
import dataclasses

import numpy as np
import pytest
from accelerated_inputs import SIZES, oriented_points, ranges

from dbscan_reg_ros import SE2, Parameters, Scan, extract_features
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.core.features.free_space import build_free_space_profile
from dbscan_reg_ros.core.features.oriented_points import high_leverage
from dbscan_reg_ros.core.odometry.mapping.correspondences import PosePrior, align, weighted_by_agreement
from dbscan_reg_ros.core.odometry.mapping.dynamic_points import (
    beside,
    detached_points,
    dynamic_points,
    information_ratio,
)
from dbscan_reg_ros.core.odometry.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.odometry.mapping.key_frame_window import (
    KeyFrameWindow,
    confirm,
    look_up_correspondences,
    look_up_pairs,
    points_by_frame,
)
from dbscan_reg_ros.core.odometry.mapping.local_map import newest_in_cell, older_map_points
from dbscan_reg_ros.core.odometry.mapping.scan_to_map import InitialAlignment, align_to_map, alignment_uncertainty
from dbscan_reg_ros.core.odometry.models.covariance import NO_MEASUREMENT, PoseMeasurement, propagate_errors
from dbscan_reg_ros.core.registration.records import Prior

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
            both(look_up_pairs, window.fields, window.poses, pose, each, lookup, 0.5)
            for distance in (0.0, 0.3, 1e3):
                both(confirm, window, pose, each, distance, 0.05, 0.5)


def test_alignment(both, rng, window):
    for points in (oriented_points(rng, 180, reach=3.0), oriented_points(rng, 3000, reach=3.0)):
        pose, other = (SE2.from_array(rng.normal(0.0, 0.1, 3)) for _ in range(2))
        found = both(look_up_correspondences, window, pose, points, P.density)
        both(high_leverage, points.normals)
        for each in (found, dataclasses.replace(found, weights=None)):
            for information in (np.zeros((3, 3)), np.diag((10.0, 20.0, 30.0)) + rng.normal(0.0, 1.0, (3, 3))):
                for scales in ([], [0.05], [0.05, 0.03, 0.01]):
                    both(align, each, other, PosePrior(pose, 0.5 * (information + information.T)), scales, 0.003)


def test_agreement_of_lidars(both, rng, window):
    """Half of the key frames are those of the own lidar; also with inverse noise scales and weights of points."""
    own = KeyFrameWindow(window.frames[::2])
    points = oriented_points(rng, 180, reach=3.0)
    for each in (points, dataclasses.replace(noisy(rng, points), weights=rng.uniform(size=180))):
        found, of_own = (part.correspondences(SE2.from_array(rng.normal(0.0, 0.02, 3)), each, P.density)
                         for part in (window, own))
        for noise in (0.01, 0.1):
            both(weighted_by_agreement, found, of_own, window.is_in(own), 0.05, noise)


SETTINGS = {
    'usual': P, 'no iterations': dataclasses.replace(P, refinement=dataclasses.replace(P.refinement, map_iterations=0)),
    'dense': dataclasses.replace(P, density=dataclasses.replace(P.density, max_points=50)),
}


@pytest.mark.parametrize('name', SETTINGS)
def test_scan_to_map(both, rng, window, name):
    """Also from a degenerate direction, with an unobservable rotation, and first with some key frames only."""
    p, part = SETTINGS[name], KeyFrameWindow(window.frames[::2])
    distance, bearings = ranges(rng, 180)
    features = extract_features(Scan.from_ranges(distance, bearings), backend=REFERENCE)
    pose, expected = (SE2.from_array(rng.normal(0.0, 0.05, 3)) for _ in range(2))
    for each in (features, dataclasses.replace(features, noise_ratio=0.03).downweighted([0, 1], 0.5)):
        for initial in (InitialAlignment(pose), InitialAlignment(pose, 0.7), InitialAlignment(pose, None, True)):
            for information in (np.zeros((3, 3)), np.diag((100.0, 300.0, 500.0))):
                prior = PosePrior(expected, information)
                both(align_to_map, window, each, initial, prior, p, part)
                _, found = both(align_to_map, window, each, initial, prior, p)
                both(alignment_uncertainty, each, pose, found, initial, p)


def test_errors_are_propagated(both, rng):
    """By the motion model and by an external prior, with and without a measurement, over a known interval and not."""
    root = rng.normal(0.0, 0.1, (9, 9))
    change = np.diag((0.01, 0.02, 0.3))
    for prior in (Prior(SE2(), 2.0 * change), Prior(SE2(), 2.0 * change, change), Prior(SE2(), np.eye(3, dtype=int))):
        for measurement in (NO_MEASUREMENT, PoseMeasurement(rng.uniform(0.0, 1.0, (3, 3)), change)):
            for interval in (0.0, 0.1, 2.0):
                step = SE2.from_array(rng.normal(0.0, 0.5, 3))
                both(propagate_errors, root @ root.T, step, interval, prior, measurement)


def test_no_pairs(both, rng, window):
    """Where a scan is far from every key frame."""
    found = both(look_up_correspondences, window, SE2(1e4, 0.0, 0.0), oriented_points(rng, 100, reach=3.0), P.density)
    assert not len(found.index)
    both(align, found, SE2(1e4, 0.0, 0.0), PosePrior(SE2(), np.eye(3)), [0.05, 0.01], 0.003)


@pytest.mark.parametrize('size', SIZES)
def test_dynamic_points(both, rng, window, size):
    points = oriented_points(rng, size, reach=rng.choice([0.5, 2.0, 3.0]))
    jumps = dataclasses.replace(points, points=points.points * rng.choice([1.0, 0.5], size))
    for each in (points, noisy(rng, points), jumps):
        free_space = window.free_space(min(6, len(window.frames)))
        for ratio in (0.0, 0.3, 1.0):
            pose, static = SE2.from_array(rng.normal(0.0, 0.3, 3)), rng.uniform(size=size) < ratio
            both(dynamic_points, each, pose, free_space, 0.2, static)
        for closed in (False, True):
            both(detached_points, each, 1.1, 0.2, closed)
        for ratio in (0.0, 0.1, 1.0):
            both(beside, each, rng.uniform(size=size) < ratio, 0.2)


@pytest.mark.parametrize('size', SIZES[1:])
def test_information_ratio(both, rng, size):
    points = oriented_points(rng, size, reach=3.0)
    for chosen in (np.arange(size // 2), np.arange(1, size, 3), np.arange(0)):
        both(information_ratio, points, chosen)


@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('latest', [0, 1, 500])
def test_newest_in_cell(both, rng, size, latest):
    for reach in (0.1, 5.0, 1e5):
        both(newest_in_cell, oriented_points(rng, size, reach).points, rng.integers(0, 40, size),
             oriented_points(rng, latest, reach).points, 0.04)


def test_local_map(both, window):
    """Points of one key frame to many complete the latest; also where a cell is large."""
    *older, latest = window.frames
    for cell_size in (0.04, 0.5) if older else ():
        both(older_map_points, older, latest, dataclasses.replace(P.density, cell_size=cell_size))


@pytest.mark.parametrize('size', [1, 2, 7, 180, 3000])
@pytest.mark.parametrize('increment', [0.001, -0.01, 0.3])
def test_free_space(both, rng, size, increment):
    points = oriented_points(rng, size).points[::int(np.sign(increment))]
    both(build_free_space_profile, np.stack((points.real, points.imag), axis=1), increment)
