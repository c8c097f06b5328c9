# SPDX-License-Identifier: Apache-2.0
"""Replays with the recorded wheel odometry as the external prior."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
from bags import replayed

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.sensor import FIRST, Sensor
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.replays.odometry import RecordedMotion, RecordedPriors, ReplayOdometry
from dbscan_reg_ros.robot.parameter_groups import NodePriorParameters
from dbscan_reg_ros.robot.parameters import NodeParameters

MOUNTING = Mounting(SE2(0.3, -0.2, math.radians(40.0)))


@pytest.fixture(scope='module')
def corridor(tmp_path_factory):
    """A bag of a drive along a corridor, of which the lidar sees 2 m."""
    folder = tmp_path_factory.mktemp('corridor') / 'drive'
    assert simulate([str(folder), '--world', 'corridor', '--lidar', 'hokuyo_urg04lx', '--range-max', '2',
                     '--seconds', '12', '--seed', '2']) == 0
    return folder


def test_recorded_wheels_measure_the_motion_along_a_corridor(corridor, tmp_path, capsys):
    (tmp_path / 'robot.yaml').write_text(
        '/**: {ros__parameters: {mounting: none, prior.source: odometry, prior.translation: 0.05}}')
    alone = replayed(corridor, tmp_path / 'alone')
    assert 'prior ' not in capsys.readouterr().out
    given = replayed(corridor, tmp_path / 'given', '--params-file', str(tmp_path / 'robot.yaml'))
    printed = capsys.readouterr()
    assert 'prior       the recorded wheel odometry\n' in printed.out and 'no effect' not in printed.err
    assert given['rpe_1m_mean_m'] < 0.5 * alone['rpe_1m_mean_m']


def test_a_replay_names_a_recording_without_wheels(corridor, tmp_path, capsys):
    log = tmp_path / 'drive.log'
    scans = list(open_recording(corridor).scans())[:5]
    log.write_text(''.join(
        f'FLASER {len(scan.ranges)} {" ".join(f"{r:.3f}" for r in scan.ranges)} 0 0 0 0 0 0 {k} robot {k}\n'
        for k, scan in enumerate(scans)))
    assert replay([str(log), '--out', str(tmp_path / 'out'), '--wheels']) == 0
    assert 'prior       none, as the recording has no wheel odometry\n' in capsys.readouterr().out


def test_recorded_yaw_rates_are_the_rotation_of_the_prior(corridor, tmp_path, capsys):
    recording = open_recording(corridor)
    stamps, rates = recording.yaw_rates()
    truth = recording.truth()
    scans = list(recording.scans())[:40]
    for wheels in (None, recording.wheel_odometry()):
        priors = RecordedPriors(RecordedMotion(wheels, (stamps, rates)), Mounting(), NodePriorParameters())
        odometry = Odometry()
        for k, scan in enumerate(scans):
            prior = priors.prior(scan.stamp, odometry.predict_motion)
            if k > 1:
                turned = SE2(*truth[1][k - 1]).inverse() @ SE2(*truth[1][k])
                assert prior.transform.theta == pytest.approx(turned.theta, abs=0.01)
            odometry.process(scan, prior)
            priors.last = scan.stamp
    replayed(corridor, tmp_path / 'both', '--wheels', '--imu')
    assert 'prior       the recorded wheel odometry and IMU\n' in capsys.readouterr().out


def test_the_prior_is_the_motion_of_the_lidar_since_the_last_scan_that_was_used(corridor):
    """A further lidar is not used before it has been compared."""
    recording, mounting, priors, used = open_recording(corridor), MOUNTING, [], []

    class Recorder(Odometry):
        def process(self, scan, prior=None, sensor=FIRST):
            update = super().process(scan, prior, sensor)
            priors.append(prior)
            used.append(not update.waits)
            return update

    stamps, poses = recording.wheel_odometry()
    scans = list(recording.scans())[:7]
    rear = SimpleNamespace(recording=SimpleNamespace(topic='rear'), scans=lambda _: scans[4:5],
                           sensor=lambda _, rank: Sensor('rear', rank=rank))
    odometry = ReplayOdometry(Recorder(), [rear], 'scan', mounting, NodeParameters())
    odometry.priors = RecordedPriors(RecordedMotion((stamps, poses)), mounting, NodePriorParameters())
    for scan in [*scans[:4], *scans[5:]]:
        odometry.process(scan)
    assert priors[0] is None and used == [k != 4 for k in range(7)]
    for k, (scan, prior) in enumerate(zip(scans[1:], priors[1:], strict=True)):
        before = scans[k] if used[k] else scans[k - 1]
        start, end = ([np.interp(at.stamp, stamps, poses[:, k]) for k in range(3)] for at in (before, scan))
        moved = (SE2(*start) @ mounting.aligned_pose).inverse() @ (SE2(*end) @ mounting.aligned_pose)
        offset = moved.inverse() @ prior.transform
        assert math.hypot(offset.x, offset.y) < 1e-4 and abs(offset.theta) < 1e-9
