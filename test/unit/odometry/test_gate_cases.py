# SPDX-License-Identifier: Apache-2.0
"""Recordings on which a gate fails easily, read in place beside the project."""
import math
from pathlib import Path

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Status, open_recording
from dbscan_reg_ros.core.errors import ScanError

CASES = Path(__file__).resolve().parents[4] / 'shared' / 'cases'


def drive(name):
    """The updates of all scans of a case that can be used."""
    path = CASES / name
    if not path.exists():
        pytest.skip(f'{path} is not there')
    odometry, updates = Odometry(), []
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
    assert np.hypot(twists[:, 0], twists[:, 1]).max() <= 5.0 and np.abs(twists[:, 2]).max() <= 6.3


def test_a_person_passing_close_by_is_no_jump():
    """A result at 0.55 m and 42 % of the score of a moment ago is not believed."""
    updates = drive('carmen/leap_behind_a_passer_at_288.log.gz')
    steps = [math.hypot(update.increment.x, update.increment.y) for update in updates[288:297]]
    assert max(steps) < 0.08
    assert all(update.status is not Status.OK or update.registration.score > 0.5 for update in updates[286:296])
