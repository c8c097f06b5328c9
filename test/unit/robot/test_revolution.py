# SPDX-License-Identifier: Apache-2.0
"""Sectors of a revolution that become one scan, and messages that stay as they are."""
import math
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros.robot.revolution import Revolution

MS = 1_000_000
BEAM = math.radians(1.0)


def message(first, count, stamp, step=BEAM, frame='laser'):
    """Beams from the bearing `first` [deg] on; each range is the number of degrees from -180, plus 1."""
    bearings = np.degrees(math.radians(first) + step * np.arange(count))
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame),
        angle_min=math.radians(first), angle_max=math.radians(first) + step * (count - 1), angle_increment=step,
        time_increment=0.0, ranges=(1.0 + np.round(bearings + 180.0) % 360.0).astype(np.float32).tolist())


def sectors(field, size, turns=3, sign=1, period=100 * MS):
    """Messages of `size` deg over a `field` of view [deg] about the x axis, of a lidar that turns once a `period`."""
    return [message(sign * (first - field / 2), size, round((turn + first / 360.0) * period), sign * BEAM)
            for turn in range(turns) for first in range(0, field, size)]


def assembled(messages):
    """What comes out of each message, and what is left."""
    revolution = Revolution()
    return [revolution.add(each) for each in messages] + [revolution.rest()], revolution.sectors


@pytest.mark.parametrize('sign', [1, -1], ids=['counterclockwise', 'clockwise'])
@pytest.mark.parametrize(('field', 'size'), [(360, 30), (360, 90), (360, 180), (270, 30), (276, 46)])
def test_sectors_that_follow_each_other_become_one_scan_of_the_revolution(field, size, sign):
    found, count = assembled(sectors(field, size, 4, sign))
    wholes = [each for outs in found[2:] for each in outs if len(each.ranges) > size]
    assert count == field // size and max(len(outs) for outs in found) <= 1
    assert len(wholes) >= 3 and all(len(whole.ranges) == field for whole in wholes[1:-1])
    for whole in wholes:
        assert whole.time_increment == pytest.approx(0.1 / 360.0, rel=1e-6)
        bearings = np.degrees(whole.angle_min + whole.angle_increment * np.arange(len(whole.ranges)))
        assert np.allclose(np.array(whole.ranges), 1.0 + np.round(bearings + 180.0) % 360.0)


def test_a_lost_sector_has_no_returns_and_a_lost_end_begins_a_new_revolution():
    messages = sectors(360, 30, 4)
    found, _ = assembled([each for k, each in enumerate(messages) if k not in (17, 35, 36)])
    middle = np.array([each for outs in found for each in outs if len(each.ranges) == 360][1].ranges)
    assert np.isinf(middle).sum() == 30
    assert sum(len(each.ranges) for outs in found for each in outs) == 4 * 360 - 2 * 30


@pytest.mark.parametrize('messages', [
    [message(-180, 360, k * 100 * MS) for k in range(5)],
    [message(-135, 270, k * 100 * MS) for k in range(5)],
    [message(-90, 180, k * 100 * MS) for k in range(5)],
    [message(-30, 60, k * 33 * MS) for k in range(5)],
    [message(-30 + 60 * (k % 2), 60, k * 33 * MS, frame='ab'[k % 2]) for k in range(6)],
    [message(-60 * k, 60, k * 5000 * MS) for k in range(6)],
], ids=['circle', 'wide', 'half', 'camera', 'two_frames', 'far_apart'])
def test_other_messages_are_passed_on_unchanged_and_at_once(messages):
    found, count = assembled(messages)
    assert [len(outs) for outs in found] == [1] * len(messages) + [0] and count == 0
    assert all(each is outs[0] for each, outs in zip(messages, found, strict=False))
