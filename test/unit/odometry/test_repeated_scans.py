# SPDX-License-Identifier: Apache-2.0
"""Lidars that repeat a scan, by the motion that others measure."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.repeated_scans import RepeatedScans
from dbscan_reg_ros.core.registration.records import Prior
from dbscan_reg_ros.core.scan import SECOND, Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry

SEEDS = 1, 2, 3
PATIENCE = 1.0


class Robot:
    """Scans of lidars with 60 beams, one of which has no return."""

    def __init__(self, seed):
        self.repeated, self._rng = RepeatedScans(), np.random.default_rng(seed)
        self._geometry = ScanGeometry(-1.5, 0.05, 60, 0.1, 20.0)
        self._ranges = {}

    def sends(self, sensor, seconds, motion=None, new=True, prior=None):
        """Add a scan, and use it unless it is left out; return whether it is left out."""
        if new:
            self._ranges[sensor] = np.append(self._rng.uniform(1.0, 9.0, 59), math.nan)
        scan = Scan(round(seconds * SECOND), self._ranges[sensor], self._geometry)
        left_out = self.repeated.add(sensor, scan, prior, PATIENCE)
        if not left_out:
            self.repeated.used(sensor, motion, prior)
        return left_out


def forwards(metres, degrees=0.0):
    return SE2(metres, 0.0, math.radians(degrees))


def measured(motion, **further):
    return Prior(motion, 1e-4 * np.eye(3), **further)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('step', [forwards(0.03), forwards(0.0, 1.5)])
def test_a_lidar_is_named_once_the_others_have_moved(seed, step):
    robot = Robot(seed)
    robot.sends('rear', 0.0)
    assert not robot.sends('front', 0.01, step)
    assert robot.sends('rear', 0.1, new=False)
    robot.sends('front', 0.11, step)
    with pytest.raises(ScanError, match=r'repeats the same scan: its 60 ranges are those of 0\.20 s before, but the '
                                        r'robot has moved by 0\.0[06] m and [03] deg'):
        robot.sends('rear', 0.2, new=False)
    # The first new scan is used.
    assert not robot.sends('rear', 0.3, step) and not robot.sends('front', 0.31, step)


@pytest.mark.parametrize('seed', SEEDS)
def test_a_single_lidar_without_wheels_is_never_named(seed):
    robot = Robot(seed)
    assert not any(robot.sends('', 0.1 * k, forwards(0.1), new=not k) for k in range(50))
    # A gyroscope measures no translation: that of its prior is predicted.
    prior = measured(forwards(0.1), measures_translation=False)
    assert not any(robot.sends('', 0.1 * k, forwards(0.1), new=False, prior=prior) for k in range(50, 60))


@pytest.mark.parametrize('seed', SEEDS)
def test_wheels_show_that_the_only_lidar_repeats_a_scan(seed):
    robot = Robot(seed)
    robot.sends('', 0.0)
    assert not robot.sends('', 0.1, new=False, prior=measured(forwards(0.03)))
    with pytest.raises(ScanError, match=r'0\.20 s before, but the robot has moved by 0\.06 m and 0 deg'):
        robot.sends('', 0.2, new=False, prior=measured(forwards(0.03)))
    # The scan was not used, so that the next prior contains its motion.
    with pytest.raises(ScanError, match=r'has moved by 0\.09 m'):
        robot.sends('', 0.3, new=False, prior=measured(forwards(0.06)))
    assert not robot.sends('', 0.4, prior=measured(forwards(0.09)))
    assert not robot.sends('', 0.5, new=False, prior=measured(forwards(0.03)))


@pytest.mark.parametrize('seed', SEEDS)
def test_wheels_that_slip_do_not_count_while_another_lidar_sees_no_motion(seed):
    robot, prior = Robot(seed), measured(forwards(0.1))
    robot.sends('rear', 0.0)
    for k in range(10):
        robot.sends('front', 0.1 * k + 0.01, forwards(0.0), prior=prior)
        assert robot.sends('rear', 0.1 * k + 0.1, new=False, prior=prior)


@pytest.mark.parametrize('seed', SEEDS)
def test_repeated_scans_are_used_if_all_lidars_repeat_them_or_the_others_are_silent(seed):
    robot = Robot(seed)
    robot.sends('rear', 0.0)
    robot.sends('front', 0.01, forwards(0.0))
    robot.sends('front', 0.09, forwards(0.0), new=False)
    assert not any(robot.sends(name, 0.1 * k, forwards(0.0), new=False)
                   for k in range(1, 20) for name in ('rear', 'front'))
    robot.sends('front', 2.0, forwards(0.0))
    assert robot.sends('rear', 2.1, new=False) and robot.sends('rear', 2.9, new=False)
    assert not robot.sends('rear', 3.1, new=False)


@pytest.mark.parametrize('seed', SEEDS)
def test_motions_that_are_not_certain_and_messages_that_come_twice_name_no_lidar(seed):
    robot = Robot(seed)
    robot.sends('rear', 0.0)
    for k in range(20):
        robot.sends('front', 0.1 * k + 0.01)
        assert robot.sends('rear', 0.1 * k + 0.1, new=False)
    robot.sends('rear', 3.0)
    robot.sends('front', 3.01, forwards(0.2))
    assert not robot.sends('rear', 3.0, new=False)
