# SPDX-License-Identifier: Apache-2.0
"""Surfaces that look different in each scan, as a hedge does."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import FULL, look

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.mapping.records import InitialAlignment, PosePrior
from dbscan_reg_ros.core.mapping.scan_to_map import align_to_map, alignment_uncertainty, information_along
from dbscan_reg_ros.core.odometry.models.surface_agreement import SurfaceAgreement
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.records import Prior, Status

P = Parameters()
SLANT = 0.4
"""Angle of the hedge [rad]."""
ALONG = np.array((math.cos(SLANT), math.sin(SLANT)))
HERE = Prior(SE2(), np.diag((0.02, 0.02, 0.01)) ** 2)


def hedge(leaves, noise=0):
    """A scan of a hedge 1.2 m away; 30 % of the beams, by the seed of its `leaves`, end 0 to 0.4 m inside."""
    ends = SE2(0.0, 0.0, SLANT).apply(np.array(((-15.0, -1.2), (15.0, -1.2))))
    scan, rng = look(ends[None], SE2(), FULL, 0.01, noise), np.random.default_rng(leaves)
    depth = np.where(rng.random(len(scan.ranges)) < 0.3, rng.uniform(0.0, 0.4, len(scan.ranges)), 0.0)
    return extract_features(dataclasses.replace(scan, ranges=scan.ranges + depth), P)


def agreement(pairs):
    """The agreement after the registrations of these pairs of features."""
    found = SurfaceAgreement()
    for reference, current in pairs:
        found = found.after(register(reference, current, P, HERE).agreement)
    return found


def test_normals_that_are_others_in_each_scan_agree_by_chance():
    found = agreement([(hedge(100 + k), hedge(k, k)) for k in range(15)])
    assert found.is_chance and found.shared < 0.25 * found.seen


def test_normals_of_a_rough_surface_that_stays_agree():
    found = agreement([(hedge(0), hedge(0, k)) for k in range(1, 16)])
    assert not found.is_chance and found.shared > 0.5 * found.seen


def test_surfaces_are_believed_before_they_were_seen():
    assert not SurfaceAgreement().is_chance
    assert SurfaceAgreement(0.0, 100.0).is_chance and not SurfaceAgreement(0.0, 100.0).after((1000.0, 1000.0)).is_chance


def test_scattered_surfaces_constrain_no_motion_along_them():
    reference, current = hedge(0), hedge(1, 1)
    seeming, found = (register(reference, each, P, HERE) for each in (current, current.with_scattered_surfaces()))
    assert seeming.weakest_information > 5.0 and seeming.degenerate_direction is None
    assert found.status is Status.DEGENERATE and found.weakest_information == pytest.approx(0.0, abs=1e-9)
    assert found.degenerate_direction == pytest.approx(SLANT, abs=0.05)
    assert ALONG @ found.covariance[:2, :2] @ ALONG > 90.0
    assert np.linalg.eigvalsh(found.covariance[:2, :2])[0] < 0.05 ** 2


def test_the_map_constrains_no_motion_along_scattered_surfaces():
    window = KeyFrameWindow([KeyFrame(hedge(k, k), SE2()) for k in range(3)])
    seen, predicted = hedge(9, 9), SE2(0.05, 0.0, 0.0)
    scattered, initial = seen.with_scattered_surfaces(), InitialAlignment(predicted, SLANT)
    pose, pairs = align_to_map(window, scattered, initial, PosePrior(predicted, np.linalg.inv(HERE.covariance)), P)
    observed = alignment_uncertainty(scattered, pose, pairs, initial, P)[1]
    assert observed.weak == pytest.approx(0.0, abs=1e-9)
    assert math.sin(observed.angle - SLANT) == pytest.approx(0.0, abs=0.05)
    assert ALONG @ (pose.x - predicted.x, pose.y - predicted.y) == pytest.approx(0.0, abs=0.003)
    assert information_along(scattered, pose, SLANT, P) == 0.0 < information_along(seen, pose, SLANT, P)
