# SPDX-License-Identifier: Apache-2.0
"""Odometry with the parameter file of each lidar."""
import numpy as np
import pytest

from dbscan_reg_ros import Parameters
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.trajectory import trajectory_of
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.simulation import LIDARS, PRESETS, follow, rooms, simulate

DRIVEN = (*LIDARS, 'ldrobot_ld19', 'ydlidar_x4')


@pytest.mark.parametrize('name', DRIVEN)
def test_every_lidar_is_followed_with_the_parameters_of_its_file(root, name):
    world, lidar = rooms(1), PRESETS[name]
    drive = simulate(world, follow(world.tour[:4], speed=1.0).until(6.0), lidar, seed=1)
    scans = drive.scans[:int(5.0 * lidar.rate)]
    file = root / 'config' / f'{name}.yaml'
    poses = trajectory_of(scans, read_parameters(file) if file.exists() else Parameters()).pose_array()
    first, later = apart(drive.truth[:len(scans)], 1.0)
    metres, degrees = errors(relative(poses[first], poses[later]), relative(drive.truth[first], drive.truth[later]))
    assert len(metres) >= 5 and metres.mean() < 0.05 and degrees.mean() < 2.0


@pytest.mark.parametrize('name', ['ldrobot_ld19', 'lds_01'])
def test_the_motion_within_a_scan_is_removed_where_a_driver_reverses_the_beams(name):
    """Ten seconds through rooms: as sent, the error is several times as large."""
    world = rooms(1)
    drive = simulate(world, follow(world.tour[:4], speed=1.0).until(10.0), PRESETS[name], seed=1)
    parameters = read_parameters(name)
    first, later = apart(drive.truth, 1.0)
    truth = relative(drive.truth[first], drive.truth[later])
    found = {}
    for direction in ('as_sent', 'clockwise'):
        changed = parameters.replace({'scan.direction': direction})
        poses = trajectory_of(drive.scans, changed).pose_array()
        found[direction] = [each.mean() for each in errors(relative(poses[first], poses[later]), truth)]
    assert np.all(3.0 * np.array(found['clockwise']) < found['as_sent'])
