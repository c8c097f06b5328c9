# SPDX-License-Identifier: Apache-2.0
"""Confidence of a registration: evidence and rivals."""
import math

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters, Prior, Scan, Status, register
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.registration.confidence.assessment import evidence_of
from dbscan_reg_ros.core.registration.confidence.evidence import log_odds
from dbscan_reg_ros.core.registration.confidence.model import confidence, probability
from dbscan_reg_ros.core.registration.problem import Problem

ROOM = outline(L_ROOM)
START, END = SE2(0.2, 0.1, 0.3), SE2(-0.5, 0.4, 0.9)
HALL = outline([(-6.0, -1.5), (6.0, -1.5), (6.0, 1.5), (-6.0, 1.5)])


def features(pose, geometry=FULL, walls=ROOM, seed=0):
    return extract_features(look(walls, pose, geometry, 0.01, seed))


def evidence(reference, current, motion):
    """That for a motion."""
    found, = evidence_of(Problem(reference, current, Parameters()), motion.as_array()[None])
    return found


def test_the_points_of_the_same_scan_are_on_its_outline_and_do_not_conflict():
    """Its segments lie upon themselves. Some walls are nearer than 1 m."""
    scan = features(START, walls=0.5 * ROOM)
    found = evidence(scan, scan, SE2())
    assert found.on_outline == len(scan.sampled_points)
    assert found.conflicts_current == found.conflicts_reference == found.unmatched_ends == 0
    lengths, directions = scan.segments.length, scan.segments.direction
    assert found.crossing == pytest.approx(0.5 * (lengths.sum() - abs(lengths @ np.exp(2j * directions))))


def test_points_in_front_of_the_outline_conflict_and_points_behind_it_are_hidden():
    """Half of a room, in it, and the room around the half."""
    whole, half = features(SE2()), features(SE2(), walls=0.5 * ROOM)
    inside, around = evidence(whole, half, SE2()), evidence(half, whole, SE2())
    assert inside.conflicts_current > 0.9 and around.conflicts_reference > 0.9
    assert inside.conflicts_reference == around.conflicts_current == inside.on_outline == around.on_outline == 0


def test_ends_match_where_the_motion_is_right_and_are_missed_elsewhere():
    reference, current = features(SE2()), features(START, seed=1)
    ends = len(reference.segments.fixed_ends) + len(current.segments.fixed_ends)
    found, missed = (evidence(reference, current, motion) for motion in (START, SE2(0.8, 0.5, 0.3)))
    assert found.matched_ends >= ends - 2 and found.unmatched_ends <= 2
    assert missed.matched_ends <= 2 and missed.unmatched_ends >= 2


@pytest.mark.parametrize(('walls', 'turn'), [(ROOM, 0.6), (HALL, 0.4)])
def test_the_margin_is_that_of_the_listed_log_odds(walls, turn):
    found = register(features(SE2(), walls=walls), features(SE2(0.3, 0.1, turn), walls=walls, seed=1))
    assert found.hypotheses[0] not in found.rivals
    assert set(found.rivals) <= set(found.hypotheses)
    odds = [each.log_odds for each in found.rivals]
    assert found.margin == pytest.approx(found.hypotheses[0].log_odds - max(odds, default=-math.inf), abs=1e-12)
    assert found.confidence == confidence(found.hypotheses[0].log_odds, odds)


def test_rivals_share_the_confidence():
    assert confidence(2.0) == probability(2.0)
    assert confidence(2.0, [2.0]) == pytest.approx(0.5 * probability(2.0))
    assert confidence(2.0, [2.0, 2.0]) == pytest.approx(probability(2.0) / 3.0)
    assert confidence(2.0, [-40.0]) == pytest.approx(probability(2.0))


@pytest.mark.parametrize('turn', [0.0, 0.4, -2.0, 3.0])
def test_half_a_turn_in_a_symmetric_corridor_is_ambiguous_and_listed(turn):
    motion = SE2(0.5, 0.2, turn)
    found = register(features(SE2(), walls=HALL), features(motion, walls=HALL, seed=1))
    other = SE2(theta=math.pi) @ motion
    assert found.status is Status.AMBIGUOUS
    assert found.confidence < 0.7
    candidates = [found.transform, *(rival.transform for rival in found.rivals)]
    for truth in (motion, other):
        errors = [truth.inverse() @ each for each in candidates]
        assert min(math.hypot(each.x, each.y) + abs(each.theta) for each in errors) < 0.05


def test_a_room_seen_again_is_certain():
    found = register(features(START), features(END, seed=1))
    assert found.status is Status.OK and found.confidence > 0.95


def test_random_ranges_make_conflicts_weak_evidence():
    """The fraction of isolated points, squared, is that of the conflicts to be expected by chance."""
    reference, ranges = features(START), look(ROOM, END, FULL, 0.01, 1).ranges.copy()
    assert register(reference, features(END, seed=1)).evidence.chance < 1e-3
    rng = np.random.default_rng(0)
    beams = rng.permutation(len(ranges))[:len(ranges) * 3 // 10]
    ranges[beams] = rng.uniform(0.2, 10.0, len(beams))
    found = register(reference, extract_features(Scan(0, ranges, FULL)))
    assert 0.005 < found.evidence.chance < 0.1
    assert found.status is Status.OK
    drop = [log_odds(each._replace(conflicts_reference=0.02)) - log_odds(each._replace(conflicts_reference=0.0))
            for each in (found.evidence, found.evidence._replace(chance=0.0))]
    assert drop[1] < 1.5 * drop[0] < 0.0


def test_the_least_confidence_decides_on_ok():
    pair = features(START), features(END, seed=1)
    found = register(*pair)
    asked = Parameters().replace({'advanced.decision.min_confidence': min(found.confidence + 1e-3, 1.0)})
    assert register(*pair, asked).status is Status.AMBIGUOUS


def test_a_prior_does_not_replace_the_score_and_the_evidence_does():
    pair = features(START), features(END, seed=1)
    found = register(*pair)
    asked = Parameters().replace({'advanced.decision.min_score': found.score + 0.01})
    assert register(*pair, asked).status is Status.OK
    assert register(*pair, asked, Prior(found.transform, 0.01 * np.eye(3))).status is Status.AMBIGUOUS
