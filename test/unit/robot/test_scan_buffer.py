# SPDX-License-Identifier: Apache-2.0
"""Scans of several lidars that wait for older ones of others, and when the next of a lidar is due."""
import pytest

from dbscan_reg_ros.robot.scan_buffer import RecentStamps, ScanBuffer

MS = 1_000_000


@pytest.fixture
def queues():
    """Queues of two lidars, of which the first sends a scan each 80 ms, the last at 240 ms."""
    buffer = ScanBuffer()
    first, second = buffer.add_queue(), buffer.add_queue()
    for stamp in (0, 80, 160, 240):
        first.add(stamp * MS, stamp)
    return buffer, first, second


def test_a_scan_waits_for_an_older_one_of_another_lidar_that_is_there_or_due(queues):
    buffer, first, second = queues
    second.add(250 * MS, 'late')
    assert buffer.must_wait(second, 250 * MS) and not buffer.must_wait(first, 240 * MS)
    assert [first.pop() for _ in range(4)] == [0, 80, 160, 240]
    # The next is due at 320 ms, and no more expected three periods after the last.
    assert [buffer.must_wait(second, stamp * MS) for stamp in (250, 319, 321, 480, 481)] == [
        False, False, True, True, False]
    buffer.remove_queue(first)
    assert not buffer.must_wait(second, 321 * MS)


@pytest.fixture
def stamps():
    """A lidar at 12.5 Hz, whose last scan was at 240 ms."""
    recent = RecentStamps()
    for k in range(4):
        recent.add(80 * k * MS)
    return recent


@pytest.mark.parametrize('stamp, due', [(200, False), (300, False), (319, False), (321, True), (480, True),
                                        (481, False), (5000, False)])
def test_a_scan_waits_for_the_scan_that_is_due_before_it(stamps, stamp, due):
    """Not for one that is due later, nor for a lidar that sent nothing for three periods."""
    assert stamps.expects_before(stamp * MS) is due


def test_nothing_is_due_before_the_period_is_known(stamps):
    recent = RecentStamps()
    assert not recent.expects_before(MS)
    recent.add(0)
    assert not recent.expects_before(100 * MS)
    stamps.clear()
    assert not stamps.expects_before(321 * MS) and stamps.period is None


def test_one_late_scan_does_not_change_the_period(stamps):
    stamps.add(400 * MS)
    assert stamps.period == 80 * MS
    assert stamps.is_heard(560 * MS, 2) and not stamps.is_heard(561 * MS, 2)
