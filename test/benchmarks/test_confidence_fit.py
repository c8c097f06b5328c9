# SPDX-License-Identifier: Apache-2.0
"""Confidence of a registration: calibration on worlds that the model was not fitted to."""
import dataclasses
import math

import numpy as np
import pytest
from benchmarks.registration import confidence as benchmark
from benchmarks.registration import overlap


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
