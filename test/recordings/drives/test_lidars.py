# SPDX-License-Identifier: Apache-2.0
"""Odometry with the parameter file of each lidar, and what the first rotations show about a lidar."""
import dataclasses
import math

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Parameters, open_recording
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.trajectory import Trajectory
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.simulation import LIDARS, PRESETS, follow, rooms, simulate


def poses_of(scans, parameters):
    """Poses of the sensor (N, 3) by the odometry, of scans that can all be used."""
    trajectory = Trajectory()
    assert len(list(trajectory.follow(scans, Odometry(parameters)))) == len(scans)
    return trajectory.pose_array()


DRIVEN = (*LIDARS, 'ldrobot_ld19', 'ydlidar_x4')


@pytest.mark.long
@pytest.mark.parametrize('name', DRIVEN)
def test_every_lidar_is_followed_with_the_parameters_of_its_file(root, name):
    world, lidar = rooms(1), PRESETS[name]
    drive = simulate(world, follow(world.tour[:4], speed=1.0).until(6.0), lidar, seed=1)
    scans = drive.scans[:int(5.0 * lidar.rate)]
    file = root / 'config' / f'{name}.yaml'
    poses = poses_of(scans, read_parameters(file) if file.exists() else Parameters())
    first, later = apart(drive.truth[:len(scans)], 1.0)
    metres, degrees = errors(relative(poses[first], poses[later]), relative(drive.truth[first], drive.truth[later]))
    assert len(metres) >= 5 and metres.mean() < 0.05 and degrees.mean() < 2.0


@pytest.mark.long
@pytest.mark.parametrize('name', ['ldrobot_ld19', 'lds_01'])
def test_the_motion_within_a_scan_is_removed_where_a_driver_reverses_the_beams(name):
    """Ten seconds through rooms: as sent, the error is several times as large; the direction is found on the way."""
    world = rooms(1)
    drive = simulate(world, follow(world.tour[:4], speed=1.0).until(10.0), PRESETS[name], seed=1)
    parameters = read_parameters(name)
    first, later = apart(drive.truth, 1.0)
    truth = relative(drive.truth[first], drive.truth[later])
    found = {}
    for direction in ('as_sent', 'auto', 'clockwise'):
        changed = parameters.replace({'scan.direction': direction})
        poses = poses_of(drive.scans, changed)
        found[direction] = np.array(errors(relative(poses[first], poses[later]), truth))
    assert np.all(3.0 * found['clockwise'].mean(axis=1) < found['as_sent'].mean(axis=1))
    half = first > len(drive.scans) // 2
    assert np.all(2.0 * found['auto'][:, half].mean(axis=1) < found['as_sent'][:, half].mean(axis=1))


def turning(name, stated=True, seconds=14.0):
    """Scans of a drive through rooms, with or without their time increments."""
    world = rooms(1)
    scans = simulate(world, follow(world.tour[:4], speed=1.0).until(seconds), PRESETS[name], seed=1).scans
    return scans if stated else [dataclasses.replace(scan, time_increment=0.0) for scan in scans]


def followed(scans, parameters=Parameters()):
    """Rotation [deg] until each finding, the findings, and the total rotation [deg]."""
    odometry, turned, total, findings = Odometry(parameters), 0.0, 0.0, []
    for scan in scans:
        update = odometry.process(scan)
        turned, total = turned + abs(update.increment.theta), total + update.increment.theta
        if update.finding:
            findings.append((math.degrees(turned), update.finding))
    return findings, math.degrees(total)


@pytest.mark.parametrize(('name', 'stated', 'remedy'), [
    ('ldrobot_ld19', True, 'set scan.direction to clockwise'), ('rplidar_a1', True, 'set scan.direction to clockwise'),
    ('lds_02', True, None), ('lds_02', False, 'set scan.revolution to 0.2'),
    ('rplidar_a1', False, 'set scan.direction to clockwise and scan.revolution to 0.1818'), ('gazebo', False, None),
    ('sick_lms200', False, None)])
def test_the_first_half_turn_shows_when_the_beams_are_measured(name, stated, remedy):
    findings, _ = followed(turning(name, stated))
    assert [text.rpartition('; ')[2] for _, text in findings] == ([remedy] if remedy else [])
    assert all(turned < 180.0 for turned, _ in findings)


@pytest.mark.parametrize('given', [{'scan.direction': 'as_sent'}, {'scan.direction': 'clockwise'},
                                   {'odometry.deskew': False}])
def test_a_direction_that_is_given_is_kept(given):
    assert not followed(turning('ldrobot_ld19', seconds=8.0), Parameters().replace(given))[0]


@pytest.mark.long
@pytest.mark.parametrize('name', ['no_time_increment', 'with_time_increment'])
def test_fast_rotations_are_followed_without_a_time_increment(cases, name):
    """The gyroscope measures about -72 deg."""
    findings, total = followed(open_recording(cases / 'time_increment' / name).scans())
    assert total == pytest.approx(-72.0, abs=4.0)
    assert len(findings) == (name == 'no_time_increment')
