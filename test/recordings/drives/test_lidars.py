# SPDX-License-Identifier: Apache-2.0
"""Odometry with the parameter file of each lidar."""
import math

import pytest

from dbscan_reg_ros import Parameters
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.trajectory import trajectory_of
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.simulation import LIDARS, Lidar, follow, rooms, simulate

FURTHER = {
    'ldrobot_ld19': Lidar(450, 0.0, math.radians(0.8), 0.02, 25.0, 10.0, duration=0.0998, noise=0.01),
    'ydlidar_x4': Lidar(500, -math.pi, math.radians(0.72), 0.1, 12.0, 10.0, duration=0.0998, noise=0.01,
                        noise_ratio=0.01)}
"""Further lidars that have a file, as doc/sensors.md describes them; the noise of the last one is a guess."""


@pytest.mark.parametrize('name', [*LIDARS, *FURTHER])
def test_every_lidar_is_followed_with_the_parameters_of_its_file(root, name):
    world, lidar = rooms(1), (LIDARS | FURTHER)[name]
    drive = simulate(world, follow(world.tour[:4], speed=1.0), lidar, seed=1)
    scans = drive.scans[:int(5.0 * lidar.rate)]
    file = root / 'config' / f'{name}.yaml'
    poses = trajectory_of(scans, read_parameters(file) if file.exists() else Parameters()).pose_array()
    first, later = apart(drive.truth[:len(scans)], 1.0)
    metres, degrees = errors(relative(poses[first], poses[later]), relative(drive.truth[first], drive.truth[later]))
    assert len(metres) >= 5 and metres.mean() < 0.05 and degrees.mean() < 2.0
