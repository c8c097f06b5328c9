# SPDX-License-Identifier: Apache-2.0
"""Confidence of a registration: calibration on worlds that the model was not fitted to."""
import dataclasses
import math

import numpy as np
import pytest
from benchmarks.registration import confidence as benchmark
from benchmarks.registration import gaps, overlap


@pytest.mark.parametrize('seed', [11, 12, 13])
def test_the_confidence_is_calibrated_on_worlds_that_it_was_not_fitted_to(seed):
    """The sum of the confidences is the number of right results, within three standard deviations."""
    assert seed not in benchmark.FITTED
    cell = overlap.Cell('rplidar_a' if seed % 2 else 'sick_lms200', 'rooms', 'any', 'low')
    cells = [dataclasses.replace(cell, world=world) for world in ('rooms', 'corridors', 'busy_halls')]
    rows = [row for each in cells for row in benchmark.of_cell(benchmark.judged, each, 5, seed)]
    certainty, right, ok = np.array(rows, dtype=float).T
    sigma = math.sqrt((certainty * (1.0 - certainty)).sum())
    assert abs(certainty.sum() - right.sum()) < 3.0 * sigma + 1.0
    assert (ok * (1.0 - right)).sum() <= 1 and ok.sum() > 0.3 * right.sum()


def test_after_gaps_the_places_of_worlds_that_the_model_was_not_fitted_to_are_told_apart():
    assert not {31, 32} & {*benchmark.PLACES_FITTED, *benchmark.PLACES_HELD_OUT}
    found = [row for kind, seed in (('rooms', 31), ('halls', 32)) for row in gaps.simulated_matches('lds', kind, seed)]
    metrics, text = benchmark.places_summary(found)
    assert metrics['place_recall'] > 0.6 and metrics['place_wrong'] < 0.03, text
