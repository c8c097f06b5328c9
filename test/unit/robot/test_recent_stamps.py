# SPDX-License-Identifier: Apache-2.0
"""When the next scan of a lidar is due."""
import pytest

from dbscan_reg_ros.robot.scan_buffer import RecentStamps

MS = 1_000_000


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
