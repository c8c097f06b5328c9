# SPDX-License-Identifier: Apache-2.0
"""The benchmark ablation: the odometry without one feature at a time."""
import json

import pytest
from bags import needs_rosbags
from benchmarks.__main__ import main
from benchmarks.odometry import ablation
from benchmarks.odometry.courses import COURSES

from dbscan_reg_ros import Parameters


@pytest.mark.parametrize('feature', ablation.FEATURES)
def test_a_feature_is_off_by_other_parameters_and_has_courses(feature):
    changes, courses = ablation.FEATURES[feature]
    assert Parameters().replace(changes) != Parameters()
    assert courses and set(courses) <= set(COURSES)


@needs_rosbags
def test_an_interrupted_run_continues_with_the_results_it_has(data, tmp_path, capsys, monkeypatch):
    words = ['ablation', '--quick', '--limit', '5', '--data', str(data), '--feature', 'poles', '--course', 'lms511',
             '--processes', '1', '--cache', str(tmp_path), '--json', str(tmp_path / 'rows.json')]
    assert main(words) == 0
    assert '| poles | lms511 | ' in capsys.readouterr().out
    first = (tmp_path / 'rows.json').read_text()
    assert json.loads(first)['poles, lms511']['needed'] == 0.0
    monkeypatch.setattr(ablation.Runner, '_run', lambda *_: pytest.fail('measured again'))
    assert main(words) == 0
    assert (tmp_path / 'rows.json').read_text() == first
