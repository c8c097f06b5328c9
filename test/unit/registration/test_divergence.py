# SPDX-License-Identifier: Apache-2.0
"""Kernel densities and K-L divergence (Eq. 16-21), and the paper's method from end to end."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
from rooms import HALF, L_ROOM, look, outline
from scipy.stats import gaussian_kde

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.registration import DivergenceParameters
from dbscan_reg_ros.core.registration.paper.divergence import (
    _scatter,
    divergences,
    log_density,
    shifted_divergences,
    silverman,
)
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.robot.parameter_files import read_parameters

PARAMETERS = DivergenceParameters()


@pytest.fixture(scope='module')
def paper(root):
    return read_parameters(root / 'config' / 'paper.yaml')


def coordinates(seed, size=180):
    """Two lumps and a flat part, as the walls of a room make them."""
    rng = np.random.default_rng(seed)
    return np.concatenate((rng.normal(-2.0, 0.05, size // 3), rng.normal(3.0, 0.1, size // 3),
                           rng.uniform(-2.0, 3.0, size - 2 * (size // 3))))


def oracle(samples, bandwidth):
    return gaussian_kde(samples, bandwidth / np.std(samples, ddof=1))


@pytest.mark.parametrize('bandwidth', [0.05, 0.3])
def test_the_density_is_that_of_scipy(bandwidth):
    samples, at = coordinates(0), np.linspace(-4.0, 5.0, 300)
    found = log_density(samples, bandwidth, at)
    np.testing.assert_allclose(found, oracle(samples, bandwidth).logpdf(at), atol=1e-9)
    np.testing.assert_allclose(np.exp(found), oracle(samples, bandwidth)(at), atol=1e-12)


def test_the_density_sums_to_one_and_knows_its_tails():
    at = np.linspace(-4.0, 5.0, 2000)
    assert np.exp(log_density(coordinates(1), 0.1, at)).sum() * (at[1] - at[0]) == pytest.approx(1.0, abs=1e-6)
    far = log_density(np.zeros(3), 0.1, np.array([10.0]))
    assert far[0] == pytest.approx(-0.5 * 100.0 ** 2 - math.log(0.1 * math.sqrt(2.0 * math.pi)))


def test_silvermans_rule_is_that_of_scipy():
    for seed in range(5):
        samples = coordinates(seed, 100 + 50 * seed)
        kernel = gaussian_kde(samples, 'silverman')
        assert silverman(samples) == pytest.approx(math.sqrt(kernel.covariance[0, 0]))
    assert silverman(np.ones(20)) == 1e-3


def summed(p, q, step):
    """Eq. 19-21, term by term."""
    return (sum(a * math.log(a / b) for a, b in zip(p, q, strict=True))
            + sum(b * math.log(b / a) for a, b in zip(p, q, strict=True))) * step


@pytest.mark.parametrize('bandwidth, grid', [(0.1, 300), (0.3, 100)])
def test_the_divergence_of_every_shift_is_the_sum_of_the_paper(bandwidth, grid):
    reference, current = coordinates(0), coordinates(1, 150)
    shifts = np.array([-0.4, -0.05, 0.0, 0.001, 0.3])
    parameters = DivergenceParameters(grid=grid)
    found = shifted_divergences(reference, current, shifts, bandwidth, parameters)
    low = min(reference.min(), current.min() - 0.4) - 3.0 * bandwidth
    high = max(reference.max(), current.max() + 0.3) + 3.0 * bandwidth
    at = np.linspace(low, high, grid)
    q = oracle(reference, bandwidth)(at)
    expected = [summed(oracle(current + shift, bandwidth)(at), q, at[1] - at[0]) for shift in shifts]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_equal_sets_do_not_diverge_and_others_do_the_more_the_farther_apart():
    samples = coordinates(2)
    shifts = np.array([0.0, 0.001, 0.01, 0.1, 0.5, 1.0])
    found = shifted_divergences(samples, samples, shifts, 0.2, PARAMETERS)
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(found) > 0.0).all()
    np.testing.assert_allclose(shifted_divergences(samples, samples, -shifts, 0.2, PARAMETERS)[1:], found[1:], rtol=0.3)


def test_millimetres_are_distinguished():
    samples = coordinates(3)
    shifts = 0.001 * np.arange(-5, 6)
    for bandwidth in (0.05, 0.2, 0.8):
        found = shifted_divergences(samples, samples, shifts, bandwidth, PARAMETERS)
        assert np.argmin(found) == 5
        assert (np.diff(found[5:]) > 0.0).all() and (np.diff(found[:6]) < 0.0).all()


def test_shifts_far_away_are_no_trouble():
    found = shifted_divergences(coordinates(0), coordinates(0), np.array([0.0, 50.0, -80.0]), 0.1, PARAMETERS)
    assert np.isfinite(found).all()
    assert np.argmin(found) == 0 and found[1:].min() > 100.0


def test_the_true_motion_diverges_least_of_all_candidates():
    motion = SE2(-1.5, 0.8, 0.3)
    current = look(outline(L_ROOM)).points
    rng = np.random.default_rng(0)
    candidates = motion.as_array() + rng.uniform(-0.3, 0.3, (200, 3)) * (1.0, 1.0, 0.0)
    candidates = np.concatenate((candidates, candidates + np.array((0.0, 0.0, 0.1)), -candidates))
    candidates[77] = motion.as_array()
    found = divergences(candidates, motion.apply(current), current, PARAMETERS)
    assert np.argmin(found) == 77
    assert found[77] == pytest.approx(0.0, abs=1e-6)


def test_candidates_are_judged_one_by_one_whatever_their_rotations():
    scan, other = look(outline(L_ROOM)).points, look(outline(L_ROOM), SE2(0.1, 0.2, 0.1)).points
    candidates = np.array([(0.0, 0.0, 0.0), (0.1, 0.2, 0.1), (0.1, 0.2, 0.0), (0.3, -0.2, 0.1)])
    fixed = DivergenceParameters(bandwidth=0.2, grid=2000)
    together = divergences(candidates, scan, other, fixed)
    alone = [divergences(candidate[None], scan, other, fixed)[0] for candidate in candidates]
    np.testing.assert_allclose(together, alone, rtol=2e-3)
    assert np.argmin(together) == 1


# The paper's method


def test_the_papers_parameters_are_the_papers(paper):
    assert paper.filter.test == 'anchor'
    assert paper.segments.corners == 'slope' and paper.segments.sections == 5
    assert not paper.rotation.directed and not paper.rotation.weighted
    assert paper.rotation.eps == pytest.approx(0.08 / math.sqrt(2.0), abs=1e-4)
    assert paper.translation.form == 'squared' and paper.translation.eps == 0.05
    assert paper.rotation.min_samples == paper.translation.min_samples == 1
    assert paper.rotation.max_width == paper.translation.max_width == 0.0, 'clusters are as DBSCAN leaves them'
    assert paper.rotation.max_hypotheses == 1
    assert paper.selection.method == 'divergence'
    assert paper.refinement.coarse_iterations == paper.refinement.fine_iterations == 0


FIVE_WALLS = outline([(-2.0, -1.5), (3.0, -2.0), (4.5, 0.5), (2.5, 3.0), (-1.0, 2.5)])
"""A room whose walls all have directions of their own: no other pairs of walls are parallel."""
MOTIONS = [SE2(0.2, -0.15, 0.1), SE2(0.3, 0.2, 0.15), SE2(-0.25, 0.2, -0.2)]


def room_pair(paper, motion=MOTIONS[0], noise=0.002):
    scans = (look(FIVE_WALLS, pose, noise=noise, seed=i) for i, pose in enumerate((SE2(), motion)))
    return [extract_features(scan, paper) for scan in scans]


@pytest.mark.parametrize('noise', [0.0, 0.005])
@pytest.mark.parametrize('motion', MOTIONS)
def test_the_papers_method_registers_a_room(paper, motion, noise):
    found = register(*room_pair(paper, motion, noise), paper)
    error = motion.inverse() @ found.transform
    assert math.hypot(error.x, error.y) < 0.03 and abs(error.theta) < 0.005
    assert found.status is Status.OK
    assert found.score > 0.95 and found.overlap > 0.9
    assert len(found.matches) >= 5


def test_the_best_of_both_key_clusters_are_reported_best_first(paper):
    found = register(*room_pair(paper), paper)
    right, opposite = found.hypotheses
    assert right.transform == found.transform and right.score == found.score > opposite.score
    assert opposite.transform.x == pytest.approx(-right.transform.x, abs=0.02)
    assert opposite.transform.y == pytest.approx(-right.transform.y, abs=0.02)


def test_the_covariance_is_the_scatter_of_the_clusters(paper):
    covariance = register(*room_pair(paper), paper).covariance
    np.testing.assert_allclose(covariance, covariance.T)
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    assert 1e-3 <= math.sqrt(covariance[0, 0]) < 0.1 and 1e-3 <= math.sqrt(covariance[2, 2]) < 0.1


def test_the_covariance_is_in_the_sensors_frame():
    """A winner at (1, 2) that faces along y; its cluster spreads along y, ahead of it: 0.1 m once in two."""
    rotations = SimpleNamespace(difference=np.array([[0.5 * math.pi + 0.2, 0.5 * math.pi - math.pi], [9.0, 9.0]]),
                                labels=np.array([[1, 1], [0, -1]]))
    translations = SimpleNamespace(samples=np.array([(1.0, 2.0), (1.0, 2.1), (7.0, 7.0)]), labels=np.array([0, 0, 1]),
                                   rotation=np.array([1, 1, 0]))
    found = _scatter(SE2(1.0, 2.0, 0.5 * math.pi), 0, rotations, translations)
    assert found == pytest.approx(np.diag([0.005, 0.0, 0.02]) + 1e-6 * np.eye(3))


def test_where_no_lines_cross_the_registration_fails_and_says_why(paper):
    wall = np.array([[(2.0, -3.0), (2.0, 3.0)]])
    features = extract_features(look(wall, geometry=HALF), paper)
    found = register(features, features, paper)
    assert found.status is Status.FAILED
    assert 'no two pairs of lines cross' in found.reason
