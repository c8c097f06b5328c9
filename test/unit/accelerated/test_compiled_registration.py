# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the registration against the reference."""
import copy
import dataclasses

import numpy as np
import pytest
from accelerated_inputs import SIZES, assert_same, oriented_points, ranges, segments

from dbscan_reg_ros import SE2, Parameters, Scan, extract_features, register
from dbscan_reg_ros.backend_choice import reference_settings
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.core.features.tables import build_likelihood_field
from dbscan_reg_ros.core.registration.confidence.evidence import collect_evidence
from dbscan_reg_ros.core.registration.confidence.model import log_odds
from dbscan_reg_ros.core.registration.degeneracy import search_degenerate_direction
from dbscan_reg_ros.core.registration.pipeline import near_motions
from dbscan_reg_ros.core.registration.point_to_line import fit
from dbscan_reg_ros.core.registration.records import Prior
from dbscan_reg_ros.core.registration.rotation import estimate_rotations, pair_weights
from dbscan_reg_ros.core.registration.search import Candidates, Problem
from dbscan_reg_ros.core.registration.selection import polish_best, rank_by_density
from dbscan_reg_ros.core.registration.status import assess, find_rivals
from dbscan_reg_ros.core.registration.translation import estimate_translations
from dbscan_reg_ros.core.registration.uncertainty import Residuals, match_covariance, uncertainty

P = Parameters()


def changed(group, **changes):
    return dataclasses.replace(group, **changes)


@pytest.mark.parametrize(('n', 'm'), [(0, 0), (0, 3), (1, 1), (2, 1), (9, 12), (60, 50)])
@pytest.mark.parametrize('parallel', [False, True], ids=['random', 'parallel'])
def test_hypotheses(both, rng, n, m, parallel):
    """Also of parallel and perpendicular walls, whose differences are equal; settings that are the reference's."""
    ours, theirs = segments(rng, n, parallel), segments(rng, m, parallel)
    weights = both(pair_weights, ours, theirs, P.rotation)
    both(pair_weights, ours, theirs, changed(P.rotation, max_width=0.0))
    for p in (P.rotation, changed(P.rotation, eps=0.02, max_width=0.02),
              changed(P.rotation, max_width=0.0, max_hypotheses=2), changed(P.rotation, max_width=0.03),
              changed(P.rotation, min_samples=3)):
        rotations = both(estimate_rotations, ours, theirs, weights, p)
        for q in (P.translation, changed(P.translation, eps=0.2), changed(P.translation, max_width=0.0),
                  changed(P.translation, min_samples=2), changed(P.translation, max_pairs=3)):
            found = both(estimate_translations, ours, theirs, rotations, weights, q)
            other = both.compiled.step(estimate_translations)(ours, theirs, rotations, weights, q)
            if len(rotations.phi):
                assert_same(found.shortest, other.shortest)


def scan(rng, size):
    distance, bearings = ranges(rng, size)
    return Scan.from_ranges(distance, bearings)


def feature_pairs(rng):
    """Features of two scans, of the same and of different rooms, with far ranges that are noisier or not."""
    reference = scan(rng, 360)
    for current in (reference, scan(rng, 180), scan(rng, 1081)):
        both = (extract_features(each, backend=REFERENCE) for each in (reference, current))
        yield tuple(dataclasses.replace(each, noise_ratio=rng.choice([0.0, 0.03])) for each in both)


SETTINGS = {
    'usual': P, 'wide': P.widened,
    'never degenerate': changed(P, degeneracy=changed(P.degeneracy, information_ratio=0.0)),
    'degenerate': changed(P, degeneracy=changed(P.degeneracy, information_ratio=1.0)),
    'not polished': changed(P, refinement=changed(P.refinement, polish_iterations=0)),
    'not refined': changed(P, refinement=changed(P.refinement, coarse_iterations=0, fine_iterations=0)),
    'few': changed(P, selection=changed(P.selection, preselected=2, preselection_points=20, top_candidates=1)),
    'any normals': changed(P, density=changed(P.density, min_normal_cosine=-1.0, max_points=50)),
}


@pytest.mark.parametrize('name', SETTINGS)
def test_ranking(both, rng, name):
    """Of one candidate, of many at random, and of several close to each other; with and without a prior."""
    for reference, current in feature_pairs(rng):
        prior = Prior(SE2.from_array(rng.normal(0.0, 0.1, 3)), np.diag((0.04, 0.01, 0.02)))
        for each in (None, prior):
            problem = Problem(reference, current, SETTINGS[name], each)
            for count, spread in ((1, 0.1), (9, 0.02), (30, 0.3)):
                candidates = Candidates(rng.normal(0.0, spread, (1, 3)), rng.normal(0.0, spread, (count - 1, 3)))
                for min_score in (-np.inf, 0.3):
                    expected, found = (step(problem, candidates, min_score)
                                       for step in (rank_by_density, both.compiled.step(rank_by_density)))
                    if expected.score[0] <= min_score:
                        expected, found = expected.score, found.score
                    else:
                        both(polish_best, problem, expected)
                    assert_same(expected, found)


def test_motions_within_the_gate(both, rng):
    """Also around an angle at the wrap, with few clusters, and with settings that are the reference's."""
    settings = (P, changed(P, selection=changed(P.selection, max_clusters=3)),
                changed(P, rotation=changed(P.rotation, min_samples=3)))
    for reference, current in feature_pairs(rng):
        for p in settings:
            for spread in (0.1, 3.0):
                covariance = np.diag((0.04, 0.01, rng.choice([0.02, 1.0])))
                prior = Prior(SE2.from_array(rng.normal(0.0, spread, 3)), covariance)
                both(near_motions, Problem(reference, current, p), prior)


@pytest.mark.parametrize('name', ['usual', 'any normals'])
def test_search_along_degenerate_directions(both, rng, name):
    """Of one hypothesis and of several; also where too few points face the direction."""
    for p in (SETTINGS[name], changed(SETTINGS[name], degeneracy=changed(P.degeneracy, min_points=1000))):
        for reference, current in feature_pairs(rng):
            for count in (1, 5):
                candidates, angles = rng.normal(0.0, 0.2, (count, 3)), rng.uniform(-3.0, 3.0, count)
                both(search_degenerate_direction, candidates, angles, Problem(reference, current, p))


@pytest.mark.parametrize('size', [1, 2, 40])
def test_hypotheses_near_one(both, rng, size):
    """Also of angles that wrap around, and apart along a degenerate direction only."""
    candidates = rng.normal(0.0, (0.3, 0.3, 3.0), (size, 3))
    candidates[::2, 2] = np.pi * rng.choice([-1.0, 1.0], len(candidates[::2]))
    for direction in (None, 0.0, rng.uniform(-3.0, 3.0)):
        both(find_rivals, candidates, direction, P.decision)


@pytest.mark.parametrize('size', SIZES)
def test_uncertainty(both, rng, size):
    """Of points all around, and of a corridor whose walls are nearly parallel."""
    for spread in (3.0, 0.02):
        angle = rng.normal(0.0, spread, size) + rng.choice([0.0, np.pi], size)
        rows, own = (np.array((np.cos(each), np.sin(each), rng.normal(0.0, 2.0, size)))
                     for each in (angle, angle + rng.normal(0.0, 0.1, size)))
        residuals = Residuals(rng.normal(0.0, 0.02, size), rng.uniform(0.0, 1.0, size), rows, own, 0.01)
        for flags in ((), (True, False), (False, True), (True, True)):
            both(match_covariance, residuals, P.decision, rng.uniform(-3.0, 3.0), *flags)
        points = dataclasses.replace(oriented_points(rng, size), inverse_noise=rng.uniform(0.1, 1.0, size))
        field = build_likelihood_field(oriented_points(rng, 400), P.density)
        candidate = rng.normal(0.0, 0.1, 3)
        both(uncertainty, candidate, fit(candidate[None], points, field, 0.5), points, 0.01, P)


def test_registrations(compiled, rng):
    """Without a guess, from scans: motions, scores and status."""
    one, two = scan(rng, 360), scan(rng, 360)
    found, other = (register(one, two, backend=backend) for backend in (REFERENCE, compiled))
    assert_same(found.hypotheses, other.hypotheses)
    assert_same((found.status, found.covariance, found.reason), (other.status, other.covariance, other.reason))


def test_scans_that_were_registered_can_be_copied(compiled, rng):
    """What the compiled steps keep with points and tables is no part of them."""
    one, two = (extract_features(scan(rng, 360), backend=compiled) for _ in range(2))
    found = register(one, two)
    assert_same(found.hypotheses, register(copy.deepcopy(one), copy.deepcopy(two)).hypotheses)


def test_settings_without_compiled_steps_are_named():
    assert reference_settings(P) == []
    names = reference_settings(P.replace({'rotation.min_samples': 2, 'translation.min_samples': 2}))
    assert names == ['rotation.min_samples', 'translation.min_samples']


def test_evidence(compiled, rng):
    """Also the odds that follow, and the assessment of one hypothesis and of several."""
    one, two = (extract_features(scan(rng, 360), P) for _ in range(2))
    candidates = rng.normal(0.0, (1.0, 1.0, 3.0), (6, 3))
    fits = Problem(one, two, P).fit(candidates, two.sampled_points)
    for expected, found in zip(*(step(candidates, fits, range(6), one, two, P)
                                 for step in (collect_evidence, compiled.step(collect_evidence))), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        for prior in (None, Prior(SE2(), np.diag((0.04, 0.01, 0.02)))):
            odds = [step(expected, prior, candidates[0]) for step in (log_odds, compiled.step(log_odds))]
            assert odds[1] == pytest.approx(odds[0], rel=1e-9, abs=1e-9)
            problem = Problem(one, two, P, prior)
            for count in (1, 6):
                fine = rank_by_density(problem, Candidates(candidates[:1], candidates[1:count]), -np.inf)
                assert_same(*(step(problem, fine) for step in (assess, compiled.step(assess))))
