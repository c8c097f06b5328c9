# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the registration against the reference."""
import dataclasses

import numpy as np
import pytest
from accelerated_inputs import SIZES, assert_same, oriented_points, ranges, segments

from dbscan_reg_ros import Parameters, Scan, extract_features, register
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.core.registration.point_to_line import fit, next_step, polish
from dbscan_reg_ros.core.registration.rotation import estimate_rotations, pair_weights
from dbscan_reg_ros.core.registration.scoring import reverse_violation, score
from dbscan_reg_ros.core.registration.translation import estimate_translations
from dbscan_reg_ros.core.registration.uncertainty import Residuals, informations

P = Parameters()


def changed(group, **changes):
    return dataclasses.replace(group, **changes)


@pytest.mark.parametrize(('n', 'm'), [(0, 0), (0, 3), (1, 1), (2, 1), (9, 12), (60, 50)])
@pytest.mark.parametrize('parallel', [False, True], ids=['random', 'parallel'])
def test_hypotheses(both, rng, n, m, parallel):
    """Also of parallel and perpendicular walls, whose differences are equal; settings that are the reference's."""
    ours, theirs = segments(rng, n, parallel), segments(rng, m, parallel)
    weights = both(pair_weights, ours, theirs, P.rotation)
    for p in (changed(P.rotation, weighted=False), changed(P.rotation, max_width=0.0)):
        both(pair_weights, ours, theirs, p)
    for p in (P.rotation, changed(P.rotation, directed=False), changed(P.rotation, eps=0.02, max_width=0.02),
              changed(P.rotation, max_width=0.0, max_hypotheses=2), changed(P.rotation, max_width=0.03),
              changed(P.rotation, min_samples=3), changed(P.rotation, median_scale=0.02)):
        rotations = both(estimate_rotations, ours, theirs, weights, p)
        for q in (P.translation, changed(P.translation, eps=0.2), changed(P.translation, max_width=0.0),
                  changed(P.translation, min_samples=2), changed(P.translation, max_pairs=3)):
            found = both(estimate_translations, ours, theirs, rotations, weights, q)
            other = both.compiled.step(estimate_translations)(ours, theirs, rotations, weights, q)
            if len(rotations.phi):
                assert_same(found.shortest, other.shortest)


@pytest.mark.parametrize('size', SIZES)
def test_single_candidate(both, rng, size):
    points = dataclasses.replace(oriented_points(rng, size), inverse_noise=rng.uniform(0.1, 1.0, size))
    field = extract_features(scan(rng, 360), backend=REFERENCE).likelihood_field
    found = fit(rng.normal(0.0, 0.1, (1, 3)), points, field, 0.5)
    both(next_step, found, points, 0.1, 0.003)
    for iterations in (0, 1, 5):
        both(polish, np.zeros(3), found, points, changed(P.refinement, polish_iterations=iterations))


def scan(rng, size):
    distance, bearings = ranges(rng, size)
    return Scan.from_ranges(distance, bearings)


def test_scores(both, rng):
    reference, current = (extract_features(scan(rng, size), backend=REFERENCE) for size in (360, 180))
    current = dataclasses.replace(current, noise_ratio=rng.choice([0.0, 0.03]))
    for count in (0, 1, 5):
        candidates = rng.normal(0.0, 0.2, (count, 3))
        found = fit(candidates, current.sampled_points, reference.likelihood_field, 0.5)
        both(score, found, reference, current, 0.05, P.density)
        both(reverse_violation, candidates, reference, current, P.density)


@pytest.mark.parametrize('size', SIZES)
def test_informations(both, rng, size):
    """Of points all around, and of a corridor whose walls are nearly parallel."""
    for spread in (3.0, 0.02):
        angle = rng.normal(0.0, spread, size) + rng.choice([0.0, np.pi], size)
        rows, own = (np.array((np.cos(each), np.sin(each), rng.normal(0.0, 2.0, size)))
                     for each in (angle, angle + rng.normal(0.0, 0.1, size)))
        weight = rng.uniform(0.0, 1.0, size)
        both(informations, Residuals(rng.normal(0.0, 0.02, size), weight, rows, own, 0.01), P.decision)


def test_registrations(compiled, rng):
    """Without a guess, from scans: motions, scores and status."""
    one, two = scan(rng, 360), scan(rng, 360)
    found, other = (register(one, two, backend=backend) for backend in (REFERENCE, compiled))
    assert_same(found.hypotheses, other.hypotheses)
    assert_same((found.status, found.covariance, found.reason), (other.status, other.covariance, other.reason))
