# SPDX-License-Identifier: Apache-2.0
"""Which beams are masked."""
import dataclasses
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.replays.lidars import prepared
from dbscan_reg_ros.robot.mask import within
from dbscan_reg_ros.robot.parameter_groups import InputParameters


@pytest.mark.parametrize('sector, inside', [
    ((0.5, 1.0), [0.5, 0.7, 1.0]),
    ((1.0, 0.5), [1.1, 3.0, -3.0, 0.0, 0.4]),
    ((3.0, -3.0), [3.1, -3.1]),
    ((3.0, 3.3), [3.1, -3.1]),
    ((-math.pi, math.pi), [0.0, 2.0, -2.0]),
])
def test_sectors_go_counter_clockwise_across_the_seam(sector, inside):
    assert within(np.array(inside), np.array([sector])).all()


def test_bearings_outside_all_sectors_are_kept():
    bearings = np.array([0.0, 0.4, 1.1, 3.0, -3.0])
    assert not within(bearings, np.array([[0.5, 1.0], [3.05, 3.1]])).any()


def test_a_masked_sector_without_a_beam_is_named(scans):
    ahead = dataclasses.replace(scans[0].geometry, angle_min=float(scans[0].geometry.bearings[90]), size=180)
    half = [dataclasses.replace(scan, ranges=scan.ranges[90:270], geometry=ahead) for scan in scans[:4]]
    notes, given = [], InputParameters(mask=(2.0, 2.5, -0.1, 0.1, *[0.0] * 4))
    assert len(list(prepared(half, Mounting(), given, notes.append))) == 4
    assert {note.startswith('input.mask has 2 to 2.5 rad, where the lidar has no beam') for note in notes} == {True}
