# SPDX-License-Identifier: Apache-2.0
"""The compiled steps of the registration against their definitions."""
import copy
import math

import numpy as np
import pytest
from compiled_inputs import oriented_points, segments
from l_room import linear_residuals, normal_equations, table, weight
from rooms import FULL, L_ROOM, look, outline
from sklearn.cluster import DBSCAN

from dbscan_reg_ros import SE2, Parameters, Prior, extract_features, register
from dbscan_reg_ros.core.features.tables import build_likelihood_field
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.registration.clustering.rotation import estimate_rotations, pair_weights
from dbscan_reg_ros.core.registration.clustering.translation import estimate_translations, near_motions
from dbscan_reg_ros.core.registration.confidence.evidence import evidence_terms, log_odds
from dbscan_reg_ros.core.registration.confidence.model import COEFFICIENTS, INTERCEPT
from dbscan_reg_ros.core.registration.fit import fit
from dbscan_reg_ros.core.registration.point_to_line import refine
from dbscan_reg_ros.core.registration.problem import Problem
from dbscan_reg_ros.core.registration.records import Evidence
from dbscan_reg_ros.core.registration.residuals import Alignment
from dbscan_reg_ros.core.registration.scoring import find_rivals
from dbscan_reg_ros.core.registration.uncertainty import match_covariance

P = Parameters()
SEEDS = range(2)


@pytest.fixture(params=SEEDS)
def rng(request):
    return np.random.default_rng(request.param)


@pytest.mark.parametrize('map_size', [1, 200, 70_000])
def test_the_errors_are_the_distances_from_the_lines_of_the_nearest_points(map_size):
    """Nearest up to a cell, with indices of one, two and four bytes."""
    rng = np.random.default_rng(map_size)
    around, points = oriented_points(rng, map_size), oriented_points(rng, 180)
    field, pose = build_likelihood_field(around, P.density), SE2.from_array(rng.normal(0.0, 0.3, 3))
    found = fit(pose.as_array(), points, field)
    places = np.exp(1j * pose.theta) * points.points + complex(pose.x, pose.y)
    np.testing.assert_allclose(found.places, places, atol=1e-12)
    apart = np.abs(places[:, None] - around.points)
    line = ((places[:, None] - around.points) * around.normals.conj()).real
    candidates = apart <= apart.min(axis=1, keepdims=True) + 2.0 * P.density.cell_size
    at = apart.min(axis=1) < P.density.cell_size
    off = np.where(candidates, np.abs(np.abs(line) - np.abs(found.residuals[0])[:, None]), np.inf).min(axis=1)
    assert off[at].max(initial=0.0) < 1e-9


def test_the_normal_equations_are_those_of_finite_differences(rng):
    field, points = build_likelihood_field(oriented_points(rng, 400), P.density), oriented_points(rng, 180)
    pose, scale, step = rng.normal(0.0, 0.02, 3), 0.1, 1e-7

    def errors(at):
        return fit(at, points, field)

    now = errors(pose)
    columns = np.array([(errors(pose + move).residuals[0] - now.residuals[0]) / step for move in step * np.eye(3)])
    # In another cell a point may have another line.
    same = (np.abs(columns) < 10.0).all(axis=0)
    weights = points.weights * weight(now, scale) * same
    design = np.vstack((columns, now.residuals[0])) * same
    _, equations = refine(pose[None], Alignment(points, field, 0.0), [scale])
    assert same.mean() > 0.97
    assert np.abs(equations[0] - (design * weights) @ design.T).max() < 0.05 * np.abs(equations[0]).max()
    weights = points.weights * weight(now, scale)
    np.testing.assert_allclose(equations[0], normal_equations(linear_residuals(now), weights), rtol=1e-9, atol=1e-9)


def mean_angle(angles, weights):
    first = angles[0]
    return wrap(first + np.average(wrap(angles - first), weights=weights))


@pytest.mark.parametrize('min_samples', [1, 3])
@pytest.mark.parametrize('parallel', [False, True])
def test_hypotheses_are_the_weighted_means_of_the_clusters_of_scikit_learn(rng, min_samples, parallel):
    ours, theirs = segments(rng, 12, parallel), segments(rng, 9, parallel)
    weights = pair_weights(ours, theirs, P.rotation)
    found = estimate_rotations(ours, theirs, weights, P.replace({
        'advanced.rotation.min_samples': min_samples, 'advanced.rotation.eps': 0.02,
        'advanced.rotation.max_hypotheses': 100,
        'advanced.rotation.max_width': 0.0}).rotation)
    apart = np.abs(wrap(found.difference.ravel()[:, None] - found.difference.ravel()))
    expected = DBSCAN(eps=0.02, min_samples=min_samples, metric='precomputed').fit_predict(apart)
    labels = found.labels.ravel()
    assert partition(labels) == partition(expected)
    for cluster, (phi, total) in enumerate(zip(found.phi, found.weight, strict=True)):
        inside = labels == cluster
        assert total == pytest.approx(weights.ravel()[inside].sum())
        assert abs(wrap(phi - mean_angle(found.difference.ravel()[inside], weights.ravel()[inside]))) < 1e-9
    assert (np.diff(found.weight) <= 1e-9).all()
    check_translations(ours, theirs, found, weights,
                       P.replace({'advanced.translation.min_samples': min_samples}).translation)


def check_translations(ours, theirs, rotations, weights, p):
    found = estimate_translations(ours, theirs, rotations, weights, p)
    assert len(found.labels) == len(found.samples) == len(found.sample_weight)
    for rotation in np.unique(found.rotation):
        own = found.rotation == rotation
        expected = DBSCAN(eps=p.eps, min_samples=p.min_samples).fit_predict(found.samples[own])
        assert partition(found.labels[own]) == partition(expected)
    for cluster, (x, y, theta) in enumerate(found.transform):
        inside = found.labels == cluster
        assert found.weight[cluster] == pytest.approx(found.sample_weight[inside].sum())
        np.testing.assert_allclose((x, y), np.average(found.samples[inside], axis=0,
                                                      weights=found.sample_weight[inside]), atol=1e-9)
        assert {theta} == set(rotations.phi[found.rotation[inside]])


def partition(labels):
    """The clusters as sets of samples, and the noise."""
    return ({frozenset(np.flatnonzero(labels == label)) for label in set(labels.tolist()) - {-1}},
            frozenset(np.flatnonzero(labels == -1)))


def test_the_weakest_direction_is_that_of_the_least_eigenvalue(rng):
    """Of the translation for an unknown rotation: the Schur complement."""
    rows = np.ascontiguousarray(rng.normal(0.0, 1.0, (3, 200)) * rng.uniform(0.5, 2.0, (3, 1)))
    _, held = match_covariance(table(rows, np.ones(200), rows), 0.01, P.decision, 0.0)
    information = rows @ rows.T
    open_rotation = information[:2, :2] - np.outer(information[:2, 2], information[2, :2]) / information[2, 2]
    values, vectors = np.linalg.eigh(open_rotation)
    assert held.weak == pytest.approx(values[0])
    assert abs(vectors[:, 0] @ (math.cos(held.angle), math.sin(held.angle))) == pytest.approx(1.0)


def test_the_log_odds_are_the_weighted_sum_of_the_terms_and_the_gain_of_the_prior():
    evidence = Evidence(0.02, 0.03, 40, 6, 1, 2.5, 0.012, 0.7, 9.0, 0.01)
    values = (math.sqrt(0.03) + math.sqrt(0.04) - 0.2, math.log(41.0), math.log(7.0), math.log(2.0),
              math.log(2.5 + 0.1), 0.012, 0.7, 9.0 / 11.0)
    assert evidence_terms(evidence) == pytest.approx(values)
    odds = INTERCEPT + np.dot(values, list(COEFFICIENTS.values()))
    assert log_odds(evidence) == pytest.approx(odds)
    prior = Prior(SE2(0.3, -0.2, 0.1), np.diag((0.04, 0.01, 0.02)))
    density = 1.0 / math.sqrt((2.0 * math.pi) ** 3 * 0.04 * 0.01 * 0.02)
    gain = math.log(0.9 * 250.0 * density + 0.1)
    assert log_odds(evidence, prior, prior.transform.as_array()) == pytest.approx(odds + gain)


def scans():
    return [extract_features(look(outline(L_ROOM), pose, FULL, 0.01, seed))
            for seed, pose in enumerate((SE2(), SE2(0.3, 0.1, 0.4)))]


@pytest.mark.parametrize('sigma', [0.02, 0.5, 3.0])
def test_near_motions_are_those_of_all_clusters_that_lie_within_the_gate(sigma):
    reference, current = scans()
    prior = Prior(SE2(0.3, 0.1, 0.4), np.diag((sigma, 0.5 * sigma, 0.2 * sigma)) ** 2)
    problem = Problem(reference, current, P)
    lines = reference.segments, current.segments
    weights = pair_weights(*lines, P.rotation)
    rotations = estimate_rotations(*lines, weights, P.rotation)
    motions = estimate_translations(*lines, rotations, weights, P.translation).transform
    apart, turned = np.hypot(*(motions[:, :2] - (0.3, 0.1)).T), np.abs(wrap(motions[:, 2] - 0.4))
    inside = (apart <= P.prior.gate * sigma) & (turned <= P.prior.gate * 0.2 * sigma)
    np.testing.assert_array_equal(near_motions(problem, prior), motions[inside][:P.selection.max_clusters])


def test_rivals_lie_farther_than_a_distance_or_an_angle(rng):
    candidates = rng.normal(0.0, (0.3, 0.3, 3.0), (40, 3))
    for direction in (None, 0.4):
        off = candidates[:, :2] - candidates[0, :2]
        if direction is not None:
            off = off @ np.array((-math.sin(direction), math.cos(direction)))[:, None]
        rivals = ((np.linalg.norm(off, axis=1) > 0.2)
                  | (np.abs(wrap(candidates[:, 2] - candidates[0, 2])) > 0.09))
        np.testing.assert_array_equal(find_rivals(candidates, direction), rivals)


def test_scans_that_were_registered_can_be_copied():
    """What the compiled steps keep with points and tables is no part of them."""
    one, two = scans()
    found, again = register(one, two), register(*(copy.deepcopy(each) for each in (one, two)))
    assert again.transform == found.transform and again.score == found.score


def test_arrays_of_different_lengths_are_an_error(rng):
    points = oriented_points(rng, 20)
    with pytest.raises(ValueError, match='arrays of different lengths'):
        type(points)(points.points, points.normals[:10], points.beams)
