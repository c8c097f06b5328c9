# SPDX-License-Identifier: Apache-2.0
"""Poses between poses, and transforms between transforms."""
import math

import pytest

from dbscan_reg_ros import SE2
from dbscan_reg_ros.robot.pose_history import HeadingHistory, PoseHistory

SECOND = 1_000_000_000


def history(*poses):
    poses_by_time = PoseHistory()
    for stamp, pose in poses:
        poses_by_time.add(stamp, pose)
    return poses_by_time


def test_poses_are_interpolated_the_short_way_round():
    poses = history((0, SE2(0.0, 0.0, 3.0)), (10, SE2(1.0, -2.0, -3.0)))
    middle = poses.at(5)
    assert (middle.x, middle.y) == pytest.approx((0.5, -1.0))
    assert abs(middle.theta) == pytest.approx(math.pi)
    assert poses.at(0) == SE2(0.0, 0.0, 3.0)
    assert poses.at(10) == SE2(1.0, -2.0, -3.0)


def test_other_times_have_no_pose():
    poses = history((10, SE2()), (20, SE2()))
    assert poses.at(9) is None
    assert poses.at(21) is None
    assert poses.reaches(20)
    assert not poses.reaches(21)
    assert not PoseHistory().reaches(0)
    assert PoseHistory().at(0) is None


def test_time_that_goes_back_starts_a_new_history():
    poses = history((10 * SECOND, SE2()), (20 * SECOND, SE2()), (15 * SECOND, SE2(1.0)))
    assert poses.at(15 * SECOND) == SE2(1.0)
    assert poses.at(20 * SECOND) is None


@pytest.mark.parametrize('late', [0, 10, SECOND])
def test_a_pose_that_comes_twice_or_late_is_passed_over(late):
    poses = history((0, SE2()), (2 * SECOND, SE2(2.0)), (2 * SECOND - late, SE2(9.0)), (3 * SECOND, SE2(4.0)))
    assert poses.at(SECOND) == SE2(1.0)
    assert poses.at(2 * SECOND + SECOND // 2) == SE2(3.0)


def test_the_past_is_forgotten():
    poses = history(*((k * SECOND, SE2(float(k))) for k in range(1000)))
    assert poses.at(500 * SECOND) is None
    assert poses.at(995 * SECOND) == SE2(995.0)
    assert len(poses._stamps) <= 22


def test_headings_are_the_integral_of_the_rates():
    headings = HeadingHistory()
    for k in range(101):
        headings.add_rate(k * SECOND // 100, 0.02 * k)
        headings.add_rate(k * SECOND // 100, math.nan)
    assert headings.at(SECOND).theta == pytest.approx(1.0)
    assert headings.at(SECOND // 2).theta == pytest.approx(0.25)


def test_rates_that_come_twice_or_late_turn_nothing():
    headings = HeadingHistory()
    for k in range(101):
        headings.add_rate(k * SECOND // 100, 1.0)
        headings.add_rate(k * SECOND // 100, 1.0)
        headings.add_rate((k - 1) * SECOND // 100, -5.0)
    assert headings.at(SECOND).theta == pytest.approx(1.0)
