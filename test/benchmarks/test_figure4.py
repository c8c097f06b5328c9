# SPDX-License-Identifier: Apache-2.0
"""Figure 4: real scans and the same points moved by (-1.5, 0.8, 0.3), features extracted again."""
import numpy as np
import pytest
from benchmarks.paper import figure4
from benchmarks.trials import attempt

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.evaluation.methods import method


@pytest.fixture(scope='module')
def scans(intel_log):
    return intel_log.scans


def test_the_50_scans_are_drawn_by_the_rule_and_have_more_than_150_returns(scans):
    assert list(figure4.SCANS) == figure4.draw(scans)
    assert min(np.count_nonzero(scans[i].valid) for i in figure4.SCANS) > 150


def test_the_reference_is_the_moved_scan_with_one_bearing_for_each_point(scans):
    trial = figure4.trial(scans[figure4.EXAMPLE])
    assert trial.truth == SE2(-1.5, 0.8, 0.3)
    there = trial.current.valid
    np.testing.assert_array_equal(trial.reference.valid, there)
    np.testing.assert_allclose(trial.reference.points[there], trial.truth.apply(trial.current.points[there]), atol=1e-5)


def test_the_papers_parameters_solve_a_named_scan(scans):
    assert figure4.EXAMPLE in figure4.SCANS
    assert figure4.exact(attempt(method('paper'), figure4.trial(scans[figure4.EXAMPLE])))


@pytest.mark.long
def test_the_defaults_solve_all_50_scans(scans):
    ours = method('dbscan')
    missed = [i for i in figure4.SCANS if not figure4.exact(attempt(ours, figure4.trial(scans[i])))]
    assert not missed
