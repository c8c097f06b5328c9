# SPDX-License-Identifier: Apache-2.0
"""The registration as a whole: motion, status and covariance."""
import math

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters, Prior, Scan, ScanGeometry, Status, register
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.registration.pipeline import search_near
from dbscan_reg_ros.core.registration.problem import Problem, SearchStage

ROOM = outline(L_ROOM)


def features(pose, geometry=FULL, noise=0.0, seed=0, walls=ROOM):
    return extract_features(look(walls, pose, geometry, noise, seed))


def off(registration, truth):
    error = truth.inverse() @ registration.transform
    return math.hypot(error.x, error.y), abs(error.theta)


@pytest.mark.parametrize('turn', [0.0, 0.5, 1.5, 3.0, -2.2])
def test_any_rotation_is_found_without_a_prior(turn):
    start, end = SE2(0.2, 0.1, 0.3), SE2(-0.5, 0.4, 0.3 + turn)
    found = register(features(start, noise=0.01, seed=1), features(end, noise=0.01, seed=2))
    distance, angle = off(found, start.inverse() @ end)
    assert found.status is Status.OK
    assert distance < 0.01
    assert angle < 0.005


def test_noiseless_scans_are_registered_exactly():
    start, end = SE2(0.2, 0.1, 0.3), SE2(-0.1, 0.3, 0.7)
    distance, angle = off(register(features(start), features(end)), start.inverse() @ end)
    assert distance < 5e-4
    assert angle < 5e-4


def test_a_scan_of_noise_is_not_called_ok():
    noise = np.random.default_rng(0).uniform(0.3, 8.0, FULL.size)
    found = register(features(SE2()), extract_features(Scan(0, noise, FULL)))
    assert found.status is not Status.OK
    assert found.reason


def test_a_prior_decides_the_heading_in_a_bare_corridor_and_the_translation_along_it_stays_degenerate():
    walls = np.array([[(-60.0, -1.0), (60.0, -1.0)], [(60.0, 1.2), (-60.0, 1.2)]])
    geometry = ScanGeometry(-math.pi, FULL.angle_increment, FULL.size, 0.0, 12.0)
    start, end = SE2(0.0, 0.0, 0.1), SE2(0.3, 0.1, 0.2)
    truth = start.inverse() @ end
    found = register(features(start, geometry, 0.01, 1, walls), features(end, geometry, 0.01, 2, walls),
                     prior=Prior(truth, np.diag([0.3, 0.3, 0.1]) ** 2))
    assert found.status is Status.DEGENERATE
    assert math.sin(found.degenerate_direction + 0.1) == pytest.approx(0.0, abs=0.01)
    # Seen from the reference the corridor's walls face along (sin 0.1, cos 0.1).
    across = np.array([math.sin(0.1), math.cos(0.1)]) @ (found.transform.x - truth.x, found.transform.y - truth.y)
    assert abs(across) < 0.005
    free = found.degenerate_direction - found.transform.theta
    along = np.array([math.cos(free), math.sin(free), 0.0])
    assert along @ found.covariance @ along > 100.0


def test_a_result_in_a_corridor_after_a_rotation_shows_what_is_unknown_in_the_frame_of_the_reference():
    walls = np.array([[(-60.0, -1.0), (60.0, -1.0)], [(60.0, 1.0), (-60.0, 1.0)]])
    geometry = ScanGeometry(-math.pi, FULL.angle_increment, FULL.size, 0.0, 12.0)
    found = register(features(SE2(), geometry, 0.01, 1, walls), features(SE2(0.0, 0.1, 1.5), geometry, 0.01, 2, walls))
    assert found.status is Status.DEGENERATE
    for part in ('translation along one direction', 'confidence', 'rivals: ', 'heading unknown'):
        assert part in found.reason
    sure = register(features(SE2(), geometry, 0.01, 1, walls), features(SE2(0.0, 0.1, 1.5), geometry, 0.01, 2, walls),
                    prior=Prior(SE2(0.0, 0.1, 1.5), np.diag([0.3, 0.3, 0.1]) ** 2))
    x, y, _ = np.sqrt(np.diag(sure.covariance_in_reference))
    assert x > 5.0 and y < 0.05
    assert f'sigma {x:.2g} m, {y:.2g} m, ' in repr(sure) and 'in the reference' in repr(sure)


def test_a_square_room_is_ambiguous():
    square = outline([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)])
    found = register(features(SE2(), walls=square), features(SE2(0.0, 0.0, 0.4), walls=square))
    assert found.status is Status.AMBIGUOUS
    assert len(found.hypotheses) > 1


def test_a_prior_decides_between_rivals():
    square = outline([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)])
    reference, current = features(SE2(), walls=square), features(SE2(0.1, 0.0, 0.4), walls=square)
    for turn in (0.4, 0.4 + 0.5 * math.pi):
        prior = Prior(SE2(0.1, 0.0, turn), np.diag([0.2, 0.2, 0.1]) ** 2)
        assert register(reference, current, prior=prior).transform.theta == pytest.approx(turn, abs=0.01)


def test_a_prior_that_lies_does_not_beat_the_scans():
    start, end = SE2(0.2, 0.1, 0.3), SE2(-0.5, 0.4, 0.9)
    lie = Prior(SE2(1.0, -1.0, -1.0), np.diag([0.01, 0.01, 0.01]) ** 2)
    distance, angle = off(register(features(start), features(end), prior=lie), start.inverse() @ end)
    assert distance < 0.002
    assert angle < 0.002


def test_what_is_found_near_a_prior_is_what_all_hypotheses_lead_to():
    """Honest priors, sure and vague, and lies."""
    rng, near, outside = np.random.default_rng(7), 0, Parameters().prior.max_score_outside_gate
    for k in range(40):
        start, end = (SE2(*rng.uniform(-0.4, 0.4, 2), rng.uniform(-3.0, 3.0)) for _ in range(2))
        truth, spread = start.inverse() @ end, float(rng.choice([0.01, 0.05, 0.3]))
        error = SE2.from_array(rng.normal(0.0, spread, 3) if k % 4 else rng.uniform(0.5, 1.5, 3))
        prior = Prior(truth @ error, np.eye(3) * spread ** 2)
        pair = features(start, noise=0.01, seed=2 * k), features(end, noise=0.01, seed=2 * k + 1)
        one, other = register(*pair, prior=prior), register(*pair, prior=prior, first_stage=SearchStage.NORMAL)
        assert one.status is other.status
        assert off(one, other.transform)[0] < 0.002 and off(one, other.transform)[1] < 0.001
        assert off(one, truth)[0] < 0.02
        near += search_near(Problem(*pair, Parameters(), prior), prior).score > outside
    assert near > 10


def test_between_bare_walls_a_prior_that_lies_leads_to_the_shortest_way():
    """No lines cross: only the shortest translations remain as hypotheses."""
    walls = np.array([[(-60.0, -1.0), (60.0, -1.0)], [(60.0, 1.2), (-60.0, 1.2)]])
    start, end = SE2(0.0, 0.1, 0.2), SE2(0.1, -0.15, -0.3)
    truth = start.inverse() @ end
    for turn in (0.3, 0.6, 1.0):
        lie = Prior(truth @ SE2(0.0, 0.0, turn), np.diag([0.01, 0.01, 0.01]) ** 2)
        found = register(features(start, walls=walls), features(end, walls=walls), prior=lie)
        left = end.inverse() @ start @ found.transform
        assert abs(left.theta) < 1e-3
        inside = SE2(0.0, 0.0, end.theta) @ left
        assert abs(inside.y) < 1e-3 and abs(inside.x) < 0.2
        assert found.status is not Status.OK


def test_matched_segments_are_aligned():
    start, end = SE2(0.2, 0.1, 0.3), SE2(-0.1, 0.3, 0.7)
    reference, current = features(start), features(end)
    found = register(reference, current)
    assert len(found.matches) >= 5
    for i, j in found.matches:
        middle = found.transform.apply(current.segments.midpoint[j])
        across = np.array([-math.sin(reference.segments.direction[i]), math.cos(reference.segments.direction[i])])
        assert abs((middle - reference.segments.midpoint[i]) @ across) < 0.02


def test_noise_draws_no_match_to_one_side():
    """Scans from one place, with 3 cm of noise: what is found of the motion between them is nothing on average."""
    scans = [extract_features(look(ROOM, SE2(), noise=0.03, seed=seed)) for seed in range(120)]
    guess = Prior(SE2(), np.diag([0.05, 0.05, 0.02]) ** 2)
    found = np.array([register(*pair, prior=guess).transform.as_array() for pair in zip(scans[::2], scans[1::2])])
    assert (np.abs(found.mean(axis=0)) < (0.002, 0.002, 0.001)).all()


def test_a_search_with_a_low_score_is_repeated_with_more_hypotheses():
    narrow = Parameters().replace({'advanced.rotation.max_hypotheses': 1, 'advanced.selection.max_clusters': 1,
                                   'advanced.selection.wide_search_factor': 1})
    again = narrow.replace({'advanced.selection.wide_search_factor': 60})
    truths = [SE2(0.4 * math.cos(k), 0.4 * math.sin(k), 0.5 * k) for k in range(12)]
    found = {}
    for name, parameters in (('narrow', narrow), ('again', again)):
        pairs = [(extract_features(look(ROOM, SE2()), parameters), extract_features(look(ROOM, truth), parameters))
                 for truth in truths]
        found[name] = [off(register(*pair, parameters), truth)[0] < 0.01 for pair,
                       truth in zip(pairs, truths, strict=True)]
    assert all(found['again'])
    assert not all(found['narrow'])


def test_a_search_that_finds_nothing_but_violations_ends():
    """A room that is a little larger: every point is in the way, and each counts twenty times."""
    parameters = Parameters().replace({'advanced.density.violation_weight': 20.0})
    reference, current = (extract_features(look(outline(size * np.asarray(L_ROOM))), parameters) for size in (1.1, 1.0))
    found = register(reference, current, parameters)
    assert found.score < -1.0 and found.status is Status.FAILED
