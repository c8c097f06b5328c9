# SPDX-License-Identifier: Apache-2.0
"""What the counts of returns say about hypotheses."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.places.evidence import log_odds, probabilities


def counts(*shares, returns=200):
    """Counts of hypotheses with these shares of returns on surfaces, nothing blocked, a tenth unknown."""
    on = np.round(returns * np.array(shares))
    squares = np.tile((0.1 * returns, 1.8 * returns, 0.0, 0.2 * returns), (len(on), 1))
    return np.column_stack((on, returns - on, squares))


def test_what_suits_two_places_suits_a_place_outside_as_well():
    assert log_odds(counts(0.93, 0.6))[0] > log_odds(counts(0.93))[0] > log_odds(counts(0.93, 0.92))[0] + 0.5


def test_a_few_returns_do_not_decide_between_a_place_and_its_copy():
    copy, wrong = (log_odds(counts(1.0, share, returns=400)) for share in (0.98, 0.85))
    assert copy[0] - copy[1] < 4.0 and wrong[0] - wrong[1] > 6.0


def test_a_third_place_changes_the_odds_of_two_by_its_chance_to_be_the_copy():
    two, three = (log_odds(counts(0.99, 0.9, *others)) for others in ((), (0.85,)))
    assert 0.0 <= (three[0] - three[1]) - (two[0] - two[1]) < math.log(2.0)


def test_many_places_that_suit_fairly_do_not_outweigh_one_that_suits_well():
    inside, _, _ = probabilities(log_odds(counts(0.99, *np.linspace(0.89, 0.84, 19))), 3)
    assert inside[0] > 0.99


def test_large_odds_and_many_scans_are_still_told_apart():
    inside, missed, outside = probabilities(np.array((130.0, 87.0)), 2000)
    assert inside == pytest.approx((1.0, math.exp(-43.0))) and missed == 0.0 and 0.0 < outside < 1e-50


def test_a_place_that_changed_is_still_found():
    assert log_odds(counts(0.93, 0.75))[0] > 3.0 > -3.0 > log_odds(counts(0.7, 0.65))[0]


def test_a_place_that_the_map_hardly_knows_is_less_probable():
    known = counts(0.95)
    unknown = known.copy()
    unknown[0, [3, 5]] = unknown[0, [5, 3]]
    assert log_odds(known)[0] - log_odds(unknown)[0] > 2.0


def test_probabilities_sum_to_one_and_the_unfound_fades():
    inside, missed, outside = probabilities(np.array((3.0, -1.0)), 1)
    assert inside.sum() + missed + outside == pytest.approx(1.0)
    assert inside[0] / inside[1] == pytest.approx(math.exp(4.0))
    assert probabilities(np.array((3.0, -1.0)), 5)[1] < 0.1 * missed
    assert probabilities(np.full(3, -20.0), 5)[2] > 0.99
