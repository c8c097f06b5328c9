# SPDX-License-Identifier: Apache-2.0
"""Stamps that are of no use, negative or wrapped."""
import numpy as np
import pytest

from dbscan_reg_ros.recordings.stamps import STEADY, mend, usable

SECOND = 10**9
WRAP = 2**32


def seconds(*values):
    return [round(value * SECOND) for value in values]


@pytest.mark.parametrize('stamps', [[], [5], seconds(1, 2, 3), seconds(1, 1, 2, 3), seconds(5, 4, 6, 7)])
def test_stamps_that_are_of_use_stay_as_they_are(stamps):
    assert mend(stamps) == (stamps, '')


@pytest.mark.parametrize(('stamps', 'first'), [
    (seconds(*[0] * 40), 1), (seconds(*[1.01893e9] * 40), 1_018_930_000),
                                               (seconds(*[1.01893e9] * 39, 1.01894e9), 1_018_930_000),
    (seconds(*range(40, 0, -1)), 40), (seconds(*[-0.4, 0.9, -1.3], *[4.29497e9] * 37), 1)])
def test_stamps_that_are_of_no_use_become_steady(stamps, first):
    mended, note = mend(stamps)
    assert mended == [first * SECOND + STEADY * k for k in range(40)]
    assert 'of no use' in note and '1 s apart' in note and '\n' not in note


def test_negative_stamps_keep_their_intervals():
    mended, note = mend(seconds(-0.5, -0.4, 0.1, 2.0))
    assert mended == seconds(1.0, 1.1, 1.6, 3.5) and note == 'stamps from -0.500 s on are shifted to start at 1 s'


def test_stamps_that_no_message_can_hold_are_shifted():
    mended, note = mend(seconds(WRAP - 3, WRAP - 2, WRAP - 1))
    assert mended == seconds(1, 2, 3) and 'shifted' in note


@pytest.mark.parametrize(('unit', 'scale'), [('s', 1.0), ('ms', 1e-3), ('us', 1e-6)])
def test_a_counter_of_32_bits_that_starts_at_0_again_is_unwrapped(unit, scale):
    counts = np.arange(WRAP - 5, WRAP + 20, 2)
    given = [round(int(count) % WRAP * scale * SECOND) for count in counts]
    mended, note = mend(given)
    assert np.diff(mended).tolist() == pytest.approx(np.full(len(counts) - 1, 2 * scale * SECOND), abs=2)
    assert note.startswith(f'stamps start at 0 again after 2^32 {unit}: unwrapped')
    assert min(mended) > 0


def test_a_clock_that_is_set_back_is_no_counter_that_wraps():
    stamps = seconds(3000, 3001, 3002, 1, 2, 3)
    assert mend(stamps) == (stamps, '')


def test_stamps_that_reach_farther_than_a_message_can_hold_become_steady():
    mended, note = mend(seconds(-1, 0, 1, 3.0e9))
    assert mended == [STEADY * k for k in range(1, 5)] and 'of no use' in note


def test_half_of_the_stamps_must_be_later_than_the_one_before():
    assert usable([]) and usable([3]) and not usable([3, 3]) and usable([3, 3, 4]) and not usable([3, 3, 3, 4])
