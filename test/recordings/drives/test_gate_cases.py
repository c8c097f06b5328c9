# SPDX-License-Identifier: Apache-2.0
"""Recordings on which a gate fails easily, read in place beside the project."""
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from dbscan_reg_ros import Parameters, Status, open_recording, read_parameters, register
from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.recordings import interpolate
from dbscan_reg_ros.recordings.poses import relative

CASES = Path(__file__).resolve().parents[4] / 'shared' / 'cases'


def drive(name, parameters=Parameters()):
    """The updates of all scans of a case that can be used."""
    path = CASES / name
    if not path.exists():
        pytest.skip(f'{path} is not there')
    odometry, updates = Odometry(parameters), []
    for scan in open_recording(path).scans():
        try:
            updates.append(odometry.process(scan))
        except ScanError:
            continue
    return updates


def sigmas(covariances):
    return np.sqrt(np.diagonal(np.array(covariances), axis1=1, axis2=2)).max(axis=0)


@pytest.mark.parametrize('name', ['22_scans', 'kinect_55deg_25s'])
def test_the_covariance_of_a_narrow_field_of_view_stays_within_the_motion_model(name):
    """A wall in a field of view of 55 deg leaves directions open; these are bounded by 1 m/s and 1 rad/s."""
    updates = drive(f'covariance_explodes/{name}')
    assert (sigmas([update.twist_covariance for update in updates]) <= 1.05).all()
    assert (sigmas([update.covariance for update in updates]) < 3.0).all()
    twists = np.array([update.twist for update in updates])
    assert np.hypot(twists[:, 0], twists[:, 1]).max() <= 5.0 + 1e-12 and np.abs(twists[:, 2]).max() <= 6.3


def test_a_person_passing_close_by_is_no_jump():
    """A result at 0.55 m and 42 % of the score of a moment ago is not believed."""
    updates = drive('carmen/leap_behind_a_passer_at_288.log.gz')
    steps = [math.hypot(update.increment.x, update.increment.y) for update in updates[288:297]]
    assert max(steps) < 0.08
    assert all(update.status is not Status.OK or update.registration.score > 0.5 for update in updates[286:296])


@pytest.mark.parametrize('name', ['standing_100_of_720', '0_0_200_then_717'])
def test_a_poor_first_scan_is_replaced_by_the_next(name):
    """The first scan of a lidar that spins up holds few beams; the third scan is found by the second."""
    statuses = [update.status for update in drive(f'start_on_a_partial_scan/{name}')]
    assert statuses.count(Status.FAILED) <= 2
    assert all(status is Status.OK for status in statuses[3:])


def test_a_scan_that_the_map_does_not_know_is_registered_to_the_scan_before():
    """One pair of key frames 1 m apart fails; the chain goes on from there, each step as the pair of its scans."""
    updates = drive('carmen/lost_for_six_scans.log')
    failed = [update.number for update in updates if update.status is Status.FAILED]
    assert failed == [9]
    for last, update in itertools.pairwise(updates[9:]):
        pair = register(last.features.scan, update.features.scan)
        off = pair.transform.inverse() @ (last.pose.inverse() @ update.pose)
        assert math.hypot(off.x, off.y) < 0.06 and abs(off.theta) < math.radians(2.0)


def test_a_vehicle_ahead_at_the_same_speed_does_not_stop_the_odometry():
    """The vehicle hides most of what faces along a corridor with doors; the robot drives 21.9 m."""
    assert 21.5 < drive('vehicle_ahead')[-1].pose.x < 22.2


@pytest.mark.parametrize('parameters', [Parameters(), read_parameters('rplidar_a')], ids=['default', 'rplidar_a'])
def test_along_a_corridor_between_alcoves_no_pose_jumps(parameters):
    """Movable objects that suggest a jump of 1 m are not confirmed by the previous scan."""
    steps = [math.hypot(update.increment.x, update.increment.y) for update in drive('corridor_back', parameters)]
    assert max(steps) < 0.15


def test_after_a_gap_without_overlap_the_covariance_holds_the_error():
    """The robot drives on for 20 s without scans, and never returns."""
    updates, recording = drive('gap/gap_without_overlap'), open_recording(CASES / 'gap' / 'gap_without_overlap')
    truth = interpolate(*recording.truth(), [update.stamp for update in updates])
    error = np.array([update.pose.as_array() for update in updates]) - relative(truth[:1], truth)
    error[:, 2] = wrap(error[:, 2])
    variance = np.diagonal([update.covariance for update in updates], axis1=1, axis2=2)
    after = np.array([update.stamp for update in updates]) > updates[0].stamp + 20e9
    assert (error[after] ** 2 < 9.0 * variance[after]).all()
    assert all(update.status is not Status.OK for update in updates[np.argmax(after):])
