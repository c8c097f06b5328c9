# SPDX-License-Identifier: Apache-2.0
"""The compiled steps with no point, one, two and thousands, also all of them at one place."""
import math
from types import SimpleNamespace

import numpy as np
from compiled_inputs import oriented_points, scan_points, segments
from hypothesis import given
from hypothesis import strategies as st

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.noise import estimate_noise
from dbscan_reg_ros.core.features.oriented_points import leverage, sample
from dbscan_reg_ros.core.features.ring_band import Outcome, ring_band_filter
from dbscan_reg_ros.core.features.surfaces import estimate_normals, find_breaks
from dbscan_reg_ros.core.features.tables import build_free_space_profile, build_likelihood_field
from dbscan_reg_ros.core.geometry.se2 import as_complex, as_vectors
from dbscan_reg_ros.core.mapping.correspondences import align
from dbscan_reg_ros.core.mapping.dynamic_points import beside, detached_points, dynamic_points, information_ratio
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.mapping.lookup import confirm, look_up_correspondences
from dbscan_reg_ros.core.mapping.records import PosePrior
from dbscan_reg_ros.core.registration.clustering.clusters import dbscan_plane
from dbscan_reg_ros.core.registration.clustering.rotation import dbscan_circle, estimate_rotations, pair_weights
from dbscan_reg_ros.core.registration.clustering.translation import estimate_translations
from dbscan_reg_ros.core.registration.fit import fit
from dbscan_reg_ros.core.registration.point_to_line import refine
from dbscan_reg_ros.core.registration.residuals import Alignment
from dbscan_reg_ros.core.sensor import FIRST

P = Parameters()
SIZES, SEEDS = st.sampled_from((0, 1, 2, 4096)), st.integers(0, 2**32 - 1)
POINTS = st.builds(lambda size, seed, reach: oriented_points(np.random.default_rng(seed), size, reach),
                   SIZES, SEEDS, st.sampled_from((0.0, 0.01, 5.0, 60.0)))
SEEN = POINTS.filter(len)


@given(SIZES, SEEDS)
def test_beams_keep_their_number_and_normals_their_length(size, seed):
    measured = scan_points(np.random.default_rng(seed), size)
    filtered, outcome = ring_band_filter(measured, 0.01, P.filter)
    known = np.isfinite(measured[:, 0])
    np.testing.assert_array_equal(np.isfinite(filtered[:, 0]), known & (outcome != Outcome.REMOVED))
    beams, points = np.flatnonzero(known), as_complex(measured[known])
    breaks = find_breaks(points, beams, 0.01, 0.01, P.segments)
    normals = estimate_normals(points, breaks, 0.01, np.full(len(points), 0.01), P.segments)
    assert len(breaks) == max(len(points) - 1, 0)
    np.testing.assert_allclose(np.abs(normals[normals != 0.0]), 1.0)
    assert P.scan.noise_min <= estimate_noise(np.abs(points), P.scan) <= P.scan.noise_max


@given(POINTS, POINTS, st.integers(0, 2))
def test_points_meet_the_lines_of_a_table(around, points, count):
    field, motions = build_likelihood_field(around, P.density), np.zeros((count, 3))
    found = fit(np.zeros(3), points, field)
    # Errors and derivatives; weights and derivatives by own normals are written when they are asked for.
    assert found.residuals.shape == (8, len(points)) and np.isfinite(found.residuals[[0, 2, 3, 4]]).all()
    np.testing.assert_array_equal(found.places, points.points)
    assert len(around) or not found.alike.any()
    moved, equations = refine(motions, Alignment(points, field, 0.003), [0.5, 0.1])
    assert moved.shape == (count, 3) and np.isfinite(moved).all()
    np.testing.assert_array_equal(equations, equations.swapaxes(1, 2))
    assert (np.diagonal(equations, axis1=1, axis2=2) >= 0.0).all()
    assert leverage(points).sum() <= 1.0 + 1e-9 and len(sample(points, 100)) <= max(len(points), 100)


@given(SEEN, POINTS, st.integers(1, 3))
def test_points_meet_key_frames(around, points, count):
    features = SimpleNamespace(likelihood_field=build_likelihood_field(around, P.density),
                               free_space=build_free_space_profile(as_vectors(around.points), 0.01))
    window = KeyFrameWindow([SimpleNamespace(pose=SE2(0.1 * k), features=features, sensor=FIRST)
                             for k in range(count)])
    found = look_up_correspondences(window, SE2(), points, P.density)
    assert found.rows.shape == (4, len(found)) and np.isfinite(found.rows).all()
    assert set(found.frame) <= set(range(count)) and set(found.index) <= set(range(len(points)))
    aligned = align(found, SE2(), PosePrior(SE2(), np.eye(3)), [0.1, 0.05], 0.003)
    assert np.isfinite(aligned.as_array()).all()
    confirmed = confirm(window, SE2(), points, -1.0, 0.05, P.density)
    assert ((confirmed >= 0.0) & (confirmed <= 1.0)).all() and len(confirmed) == len(points)
    dynamic = dynamic_points(points, SE2(), window, 1, 0.3, np.ones(len(points), dtype=bool))
    near = beside(points, dynamic, 0.3)
    assert (near >= dynamic).all() and len(near) == len(points)
    assert len(detached_points(points, 0.8, 0.3, True)) == len(points)
    assert 0.0 <= information_ratio(points, np.flatnonzero(dynamic)) <= 1.0 + 1e-6


@given(SIZES, st.integers(1, 5))
def test_samples_at_one_place_by_eights_and_far_apart(size, min_samples):
    number = np.arange(size)
    for cluster, alone in ((number // 8, min(size, 8) < min_samples), (number, min_samples > 1)):
        samples = cluster * math.tau / max(size, 1)
        for found in (dbscan_circle(samples, 1e-4, min_samples, math.tau),
                      dbscan_plane(samples * np.exp(0.3j), 1e-4, min_samples)):
            np.testing.assert_array_equal(found, np.full(size, -1) if alone else cluster)


@given(st.integers(0, 2), st.integers(0, 2), SEEDS)
def test_few_segments_have_few_hypotheses(ours, theirs, seed):
    rng = np.random.default_rng(seed)
    lines = segments(rng, ours), segments(rng, theirs)
    weights = pair_weights(*lines, P.rotation)
    rotations = estimate_rotations(*lines, weights, P.rotation)
    motions = estimate_translations(*lines, rotations, weights, P.translation).transform
    assert weights.shape == (ours, theirs) and motions.shape == (len(motions), 3) and np.isfinite(motions).all()
    assert bool(len(rotations.phi)) == bool(ours and theirs)
