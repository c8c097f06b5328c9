# SPDX-License-Identifier: Apache-2.0
"""Odometry with the parameter file of each lidar."""
import pytest

from dbscan_reg_ros import Parameters
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.trajectory import trajectory_of
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.simulation import LIDARS, PRESETS, follow, rooms, simulate

DRIVEN = (*LIDARS, 'omron_os32c', 'ydlidar_x4')


@pytest.mark.parametrize('name', DRIVEN)
def test_every_lidar_is_followed_with_the_parameters_of_its_file(root, name):
    world, lidar = rooms(1), PRESETS[name]
    drive = simulate(world, follow(world.tour[:4], speed=1.0), lidar, seed=1)
    scans = drive.scans[:int(5.0 * lidar.rate)]
    file = root / 'config' / f'{name}.yaml'
    poses = trajectory_of(scans, read_parameters(file) if file.exists() else Parameters()).pose_array()
    first, later = apart(drive.truth[:len(scans)], 1.0)
    metres, degrees = errors(relative(poses[first], poses[later]), relative(drive.truth[first], drive.truth[later]))
    assert len(metres) >= 5 and metres.mean() < 0.05 and degrees.mean() < 2.0
