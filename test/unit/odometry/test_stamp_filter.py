# SPDX-License-Identifier: Apache-2.0
"""Intervals between scans from their stamps."""
import pytest

from dbscan_reg_ros.core.odometry.models.stamp_filter import StampFilter
from dbscan_reg_ros.core.parameters.odometry import TimeParameters


def test_ten_intervals_without_a_scan_are_a_gap_where_stamps_are_uneven():
    intervals = StampFilter()
    stamps = -1, 0, 100, 200, 1150, 1250, 2300, 2300, 7000
    found = [intervals.next(s * 1_000_000, 0.05, TimeParameters(), 0.0) for s in stamps]
    assert [time.gap for time in found[3:]] == [False, False, False, True, False, True]
    assert [bool(time.jump) for time in found] == [False] * 8 + [True]
    assert found[6].elapsed == pytest.approx(1.05) and found[7].elapsed == 0.0
    assert all(time.middle_offset == 0.05 for time in found)


def test_even_stamps_are_believed_and_scans_between_them_were_lost():
    intervals = StampFilter()
    stamps = (0, 100, 400, 500, 1900, 2600, 2700, 2702, 3000, 3100)
    found = [intervals.next(s * 1_000_000, 0.0, TimeParameters(), 0.0) for s in stamps]
    assert [time.length for time in found[1:7]] == pytest.approx([0.1, 0.3, 0.1, 1.4, 0.7, 0.1])
    assert not any(time.gap for time in found)
    assert [time.steady for time in found[1:]] == [True] * 6 + [False] * 3
    assert [time.length for time in found[8:]] == pytest.approx([0.298, 0.1])


def test_where_scans_would_overlap_intervals_are_whole():
    intervals = StampFilter()
    stamps = (0, 130, 180, 310, 440, 500, 800, 890, 890)
    found = [intervals.next(s * 1_000_000, 0.0, TimeParameters(), 0.1) for s in stamps]
    assert [time.length for time in found[1:]] == pytest.approx([0.13, 0.09, 0.13, 0.13, 0.13, 0.26, 0.11, 0.11])
    assert [time.steady for time in found[1:]] == [True] + [False] * 7
    assert intervals.ratio(0.1) == 1.0
    assert intervals.ratio(0.2) == pytest.approx(0.65)


@pytest.mark.parametrize('elapsed, taken', [(49, 100), (51, 51), (120, 120), (204, 204), (206, 100)])
def test_between_uneven_stamps_an_interval_counts_from_half_to_about_twice_the_median(elapsed, taken):
    intervals = StampFilter()
    for stamp in (-1, *range(0, 1100, 100)):
        intervals.next(stamp * 1_000_000, 0.0, TimeParameters(), 0.0)
    found = intervals.next((1000 + elapsed) * 1_000_000, 0.0, TimeParameters(), 0.0)
    assert (found.length, found.elapsed) == pytest.approx((taken * 1e-3, elapsed * 1e-3))


def test_stamps_that_go_back_took_no_time_and_keep_the_median():
    intervals = StampFilter()
    found = [intervals.next(s * 1_000_000, 0.05, TimeParameters(max_jump=2.0), 0.0) for s in (9000, 9100, 9150, 1000)]
    assert (found[0].length, found[0].elapsed, found[0].middle_offset) == (0.0, 0.0, 0.05)
    assert (found[3].length, found[3].elapsed, found[3].middle_offset) == (pytest.approx(0.075), 0.0, 0.05)
    assert found[3].gap and found[3].reason == 'stamps went back by 8.150 s'


@pytest.mark.parametrize('period, gap, missing', [(100, 2500, True), (2500, 2600, False), (2500, 30_000, True)])
def test_scans_are_missing_after_an_interval_far_beyond_the_usual_one(period, gap, missing):
    intervals = StampFilter()
    stamps = [*range(0, 12 * period, period), 11 * period + gap]
    found = [intervals.next(stamp * 1_000_000, 0.0, TimeParameters(max_jump=2.0), 0.0) for stamp in stamps]
    assert found[-1].jump and found[-1].missing is missing
    assert not any(each.missing for each in found[:-1])
