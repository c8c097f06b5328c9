# SPDX-License-Identifier: Apache-2.0
"""Registration and odometry in a wood, by landmarks."""
import math

import numpy as np
import pytest
from benchmarks.odometry.course import simulated
from benchmarks.odometry.places import wood

from dbscan_reg_ros import Parameters, Status
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import LIDARS

PARAMETERS = Parameters()
NONE = PARAMETERS.replace({'advanced.selection.max_landmarks': 0})


@pytest.fixture(scope='module')
def drive():
    return simulated(wood(0), LIDARS['rplidar_a'], seed=0)


def apart(motion, truth):
    """Translation [m] and rotation [rad] of a motion from the true one."""
    off = motion - truth
    return math.hypot(off[0], off[1]), abs(math.remainder(off[2], 2.0 * math.pi))


def test_scans_of_a_wood_are_registered_without_a_prior(drive):
    """From 5 to 50 scans apart. What shows of a trunk turns with the sensor.

    By lines alone every seventh pair is lost.
    """
    turning = np.abs(np.angle(np.exp(1j * np.diff(drive.reference[:, 2], append=drive.reference[-1, 2])))) > 0.005
    rng, right, without = np.random.default_rng(0), [], []
    while len(right) < 60:
        i = int(rng.integers(0, len(drive.scans) - 50))
        j = i + int(rng.integers(5, 50))
        if turning[[i - 1, i, j - 1, j]].any():
            continue
        truth = relative(drive.reference[i:i + 1], drive.reference[j:j + 1])[0]
        reference, current = (extract_features(drive.scans[each], PARAMETERS) for each in (i, j))
        for parameters, results in ((PARAMETERS, right), (NONE, without)):
            found = register(reference, current, parameters)
            way, turn = apart(found.transform.as_array(), truth)
            results.append(way < 0.1 and turn < math.radians(2.0))
            assert results[-1] or found.status is not Status.OK or parameters is NONE
    assert np.mean(right) >= 0.98
    assert np.mean(without) < 0.9, 'what the landmarks are there for'


@pytest.mark.parametrize('seed', range(3))
def test_after_four_seconds_without_a_scan_the_odometry_recovers_in_a_wood(seed):
    """Three gaps in a minute."""
    drive = simulated(wood(seed), LIDARS['rplidar_a'], seed=seed)
    course = drive.take((drive.seconds % 15.0 < 11.0) & (drive.seconds < 60.0))
    odometry, poses = Odometry(PARAMETERS), []
    for scan in course.scans:
        update = odometry.process(scan)
        poses.append(update.pose.as_array())
    way, turn = apart(*(relative(each[:1], each[-1:])[0] for each in (np.array(poses), course.reference)))
    assert way < 0.1 and turn < math.radians(1.0), f'{way:.2f} m off after a minute'
    assert update.status is Status.OK
