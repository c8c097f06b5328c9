# SPDX-License-Identifier: Apache-2.0
"""Selection of hypotheses: scores, distance from the prediction, duplicates."""
import math

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline
from scipy.spatial.distance import mahalanobis

from dbscan_reg_ros import SE2, Parameters, Prior
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.parameters.registration import SCORE_SCALE
from dbscan_reg_ros.core.registration.hypotheses import Candidates
from dbscan_reg_ros.core.registration.problem import Problem
from dbscan_reg_ros.core.registration.ranking import rank_by_density
from dbscan_reg_ros.core.registration.scoring import (
    distinct,
    same,
    scores,
    search_degenerate_direction,
)

ALL_POINTS = Parameters().replace({'advanced.density.max_points': 1000})
DENSITY = ALL_POINTS.density
ROOM = outline(L_ROOM)
BOX = outline([(0.3, -0.4), (0.7, -0.4), (0.7, 0.0), (0.3, 0.0)])
"""Stands in the room, a metre from its walls."""
START, END = SE2(-0.6, 0.3, 0.3), SE2(-0.9, 0.1, -0.4)
MOTION = START.inverse() @ END


def features(pose, walls=ROOM):
    return extract_features(look(walls, pose, FULL), ALL_POINTS)


def on_the_box(scan, pose):
    """Fraction of a scan's points on the box, and of the sum of their leverages."""
    points = pose.apply(np.column_stack((scan.sampled_points.points.real, scan.sampled_points.points.imag)))
    near = np.abs(points - (0.5, -0.2)).max(axis=1) < 0.25
    return near.mean(), np.asarray(scan.leverage)[near].sum()


def rows(*motions):
    return np.array([motion.as_array() for motion in motions])


def test_the_score_is_the_share_on_surfaces_less_that_in_free_space():
    """What the current scan sees of a box, the reference saw through."""
    empty, current = features(START), features(END, np.concatenate((ROOM, BOX)))
    share, weighted = on_the_box(current, END)
    assert share > 0.05
    value, overlap, conflict, _ = scores(Problem(empty, current, ALL_POINTS), rows(MOTION))
    assert overlap[0] == pytest.approx(1.0 - share, abs=0.01)
    assert conflict[0] == pytest.approx(weighted, abs=0.01)
    assert value[0] == pytest.approx(1.0 - weighted - DENSITY.violation_weight * weighted, abs=0.02)


def test_reference_points_in_the_free_space_of_the_current_scan_count_as_violations():
    box, current = features(START, np.concatenate((ROOM, BOX))), features(END)
    share, weighted = on_the_box(box, START)
    assert share > 0.05
    *_, found = scores(Problem(box, current, ALL_POINTS), rows(MOTION, MOTION @ SE2(0.0, 0.0, 0.1)))
    assert found[0] == pytest.approx(weighted, abs=0.005)
    *_, (none,) = scores(Problem(features(START), current, ALL_POINTS), rows(MOTION))
    assert none == 0.0


@pytest.mark.parametrize('step', [SE2(0.0, 0.1, 0.0), SE2(-0.4, 0.0, 0.0), SE2(0.3, -0.2, 0.1)])
def test_a_prior_costs_the_squared_distance_from_it_in_its_frame(step):
    reference, current, p = features(START), features(END), ALL_POINTS
    root = np.array([[0.1, 0.0, 0.0], [0.3, 0.2, 0.0], [-0.1, 0.05, 0.1]])
    prior = Prior(MOTION @ step.inverse(), root @ root.T)
    found = rank_by_density(Problem(reference, current, p, prior), Candidates(rows(MOTION), np.empty((0, 3))), np.inf)
    off = prior.transform.inverse() @ SE2(*found.candidates[0])
    distance = mahalanobis(off.as_array(), np.zeros(3), np.linalg.inv(prior.covariance))
    (expected,), *_ = scores(Problem(reference, current, p), found.candidates)
    assert found.best_score == pytest.approx(expected - p.prior.weight * min((distance / p.prior.gate) ** 2, 1.0))


def test_the_spread_of_a_prior_is_that_of_its_widest_direction():
    for angle in (0.0, 0.4, 1.2, 2.5):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        prior = Prior(SE2(), turn @ np.diag([0.3, 0.1, 0.05]) ** 2 @ turn.T)
        assert prior.translation_sigma == pytest.approx(0.3) and prior.rotation_sigma == pytest.approx(0.05)


def test_hypotheses_are_one_when_both_distance_and_angle_are_small():
    candidates = np.array([(0.0, 0.0, math.pi - 0.005), (0.03, 0.04, -math.pi + 0.005), (0.0, 0.06, math.pi),
                           (0.0, 0.0, -math.pi + 0.02), (0.04, 0.04, math.pi - 0.015)])
    assert same(candidates, candidates[0], 0.0501, 0.02).tolist() == [True, True, False, False, False]
    assert distinct(candidates, 5, 0.0501, 0.02) == [0, 2, 3]
    assert distinct(candidates, 2, 0.0501, 0.02) == [0, 2]


CORRIDOR = outline([(-20.0, -1.0), (3.0, -1.0), (3.0, 1.2), (-20.0, 1.2)])


@pytest.mark.parametrize('off', [0.93, -0.47, 0.02, -0.93])
def test_the_end_of_a_corridor_is_found_along_it(off):
    """To half of the last step, with a sensor that is turned and a second corridor that is not off."""
    start, end = SE2(0.0, 0.0, 0.7), SE2(0.4, 0.1, -0.5)
    reference, current = features(start, CORRIDOR), features(end, CORRIDOR)
    truth = start.inverse() @ end
    axis = -start.theta
    away = SE2(truth.x + off * math.cos(axis), truth.y + off * math.sin(axis), truth.theta)
    found = search_degenerate_direction(rows(away, truth), np.array([axis, axis + math.pi]),
                                        Problem(reference, current, ALL_POINTS))
    assert np.abs(found - truth.as_array()).max() <= 0.2 * SCORE_SCALE + 0.005
