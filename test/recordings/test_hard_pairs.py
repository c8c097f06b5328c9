# SPDX-License-Identifier: Apache-2.0
"""Pairs of scans of a real log with outliers, which need the wide search and the whole refinement."""
import math

import pytest
from benchmarks.registration import synthetic

from dbscan_reg_ros import Parameters, Status, register
from dbscan_reg_ros.core.features.extraction import extract_features


def off(registration, truth):
    error = truth.inverse() @ registration.transform
    return math.hypot(error.x, error.y), abs(error.theta)


@pytest.fixture(scope='module')
def trial_of(intel_log):
    """``trial_of(group, label, seed)``: that trial of ``bench synthetic``."""
    def trial_of(group, label, seed=0):
        trial, = (each for each in synthetic.trials(intel_log, seed=seed) if (each.group, each.label) == (group, label))
        return trial
    return trial_of


def test_a_hypothesis_that_comes_from_far_is_led_all_the_way(trial_of):
    """A scan with 30 % outliers, whose best hypothesis is 0.2 m off after the coarse refinement."""
    trial = trial_of('paper_30', '4740', seed=5)
    found = register(extract_features(trial.reference), extract_features(trial.current))
    distance, angle = off(found, synthetic.PAPER_MOTION)
    assert found.status is Status.OK and distance < 0.02 and angle < 0.01


def test_where_no_result_is_ok_more_hypotheses_are_looked_at(trial_of):
    """Scans with 30 % outliers: the true motion is in none of the heaviest clusters, whose scores are low."""
    trial = trial_of('random_30', '3566')
    pair = extract_features(trial.reference), extract_features(trial.current)
    few = Parameters().replace({'advanced.selection.max_clusters': 8})
    narrow, wide = (register(*pair, few.replace({'advanced.selection.wide_search_factor': factor}))
                    for factor in (1, 30))
    assert narrow.status is not Status.OK and off(narrow, trial.truth)[0] > 0.1
    distance, angle = off(wide, trial.truth)
    assert distance < 0.02 and angle < 0.01 and wide.score > narrow.score + 0.02
