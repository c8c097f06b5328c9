# SPDX-License-Identifier: Apache-2.0
"""Scans of several lidars that wait for older ones of others."""
import pytest

from dbscan_reg_ros.robot.scan_buffer import ScanBuffer

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
