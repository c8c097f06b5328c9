# SPDX-License-Identifier: Apache-2.0
"""What the counts of returns say about hypotheses."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.places.evidence import log_odds, probabilities


def counts(*shares, returns=200):
    """Counts of hypotheses with these shares of returns on surfaces, nothing blocked, a tenth unknown."""
    on = np.round(returns * np.array(shares))
    return np.column_stack((on, returns - on, np.full(len(on), 0.1 * returns), np.zeros((len(on), 3))))


def test_what_suits_two_places_suits_a_place_outside_as_well():
    assert log_odds(counts(0.93, 0.6))[0] > log_odds(counts(0.93))[0] > log_odds(counts(0.93, 0.92))[0] + 0.5


def test_a_few_returns_do_not_decide_between_a_place_and_its_copy():
    copy, wrong = (log_odds(counts(1.0, share, returns=400)) for share in (0.98, 0.85))
    assert copy[0] - copy[1] < 4.0 and wrong[0] - wrong[1] > 6.0


def test_the_odds_of_two_places_do_not_depend_on_a_third():
    two, three = (log_odds(counts(0.99, 0.9, *others)) for others in ((), (0.85,)))
    assert two == pytest.approx(three[:2])


def test_a_place_that_changed_is_still_found():
    assert log_odds(counts(0.93, 0.75))[0] > 3.0 > -3.0 > log_odds(counts(0.7, 0.65))[0]


def test_probabilities_sum_to_one_and_the_unfound_fades():
    inside, missed, outside = probabilities(np.array((3.0, -1.0)), 1)
    assert inside.sum() + missed + outside == pytest.approx(1.0)
    assert inside[0] / inside[1] == pytest.approx(math.exp(4.0))
    assert probabilities(np.array((3.0, -1.0)), 5)[1] < 0.1 * missed
    assert probabilities(np.full(3, -20.0), 5)[2] > 0.99
