# SPDX-License-Identifier: Apache-2.0
"""Drives of lidars that send a range for a missing return: the track is that of the same scans with inf."""
import dataclasses
import math

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, open_recording
from dbscan_reg_ros.simulation import Lidar, corridor, follow, hall, simulate


def poses(scans):
    odometry = Odometry()
    return np.array([odometry.process(scan).pose.as_array() for scan in scans])


@pytest.mark.filterwarnings('ignore:many beams:UserWarning')
@pytest.mark.parametrize('name', ['no_return_is_range_max', 'no_return_is_range_max.log'])
def test_a_drive_among_missing_returns_at_range_max_is_that_with_inf(cases, name):
    found, expected = (poses(open_recording(cases / 'no_return' / each).scans())
                       for each in (name, 'no_return_is_inf_control'))
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert np.hypot(*np.diff(found[:, :2], axis=0).T).sum() == pytest.approx(2.49, abs=0.02)


@pytest.mark.parametrize('code', [3.99])
def test_a_hall_where_half_the_beams_have_a_code_is_driven_as_with_inf(code):
    lidar = Lidar(720, -math.pi, math.radians(0.5), range_max=4.0, stated=(0.05, 30.0), no_return=code)
    world = hall()
    path = follow(world.tour[:3], speed=1.0)
    scans, control = (simulate(world, path, each, seed=1).scans[:40]
                      for each in (lidar, dataclasses.replace(lidar, no_return=math.inf)))
    assert np.mean([scan.ranges == np.float32(code) for scan in scans]) > 0.4
    with pytest.warns(UserWarning, match=f'largest range, {code:g} m') as warned:
        found = poses(scans)
    assert len(warned) == 1
    np.testing.assert_array_equal(found, poses(control))


@pytest.mark.filterwarnings('ignore:many beams:UserWarning')
@pytest.mark.parametrize('code', [29.9])
def test_a_code_is_found_among_ranges_in_centimetres_and_some_beyond_it(code):
    lidar = Lidar(681, math.radians(-120.0), math.radians(240.0 / 680), 0.06, 5.6, resolution=0.01, stated=(0.06, 30.0),
                  no_return=code)
    drive = simulate(corridor(seed=3), follow(corridor(seed=3).tour, speed=0.8).until(5.0), lidar, seed=1)
    end = poses(drive.scans)[-1]
    assert math.hypot(end[0], end[1]) == pytest.approx(math.dist(drive.truth[0, :2], drive.truth[-1, :2]), abs=0.15)
