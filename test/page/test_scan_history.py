# SPDX-License-Identifier: Apache-2.0
"""Scans of a drive for its page: bounded however long the drive, and all that are not OK are kept."""
import math
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros import SE2, Odometry, Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.known_motion import KnownMotion
from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.lidars import turned
from dbscan_reg_ros.replays.page.report import Report, write_report
from dbscan_reg_ros.replays.page.scan_history import RESOLUTION, ScanHistory
from dbscan_reg_ros.replays.trajectory import Trajectory

MOST_BYTES = 25_000_000


def update(number, status, points, segments):
    """What the history reads of an `OdometryUpdate`."""
    scan = SimpleNamespace(points=points, valid=np.ones(len(points), dtype=bool))
    features = SimpleNamespace(scan=scan, segments=segments)
    reason = '' if status is Status.OK else f'score 0.{number % 100:02}, expected at least 0.5 (decision.min_score)'
    return SimpleNamespace(
        number=number, reference_number=max(number - 1, 0), status=status, features=features, restarted='',
        registration=SimpleNamespace(reason=reason, overlap=0.9), is_key_frame=number % 10 == 0,
        covariance=np.diag((1e-4, 2e-4, 1e-6)))


def long_drive(count, beams, not_ok):
    """A trajectory of `count` scans around a circle, and the history of their scans; every `not_ok`-th is not OK."""
    rng = np.random.default_rng(0)
    noise = rng.uniform(-20.0, 20.0, (beams + 64, 2))
    segments = SimpleNamespace(start=rng.uniform(-9.0, 9.0, (12, 2)), end=rng.uniform(-9.0, 9.0, (12, 2)))
    trajectory, history = Trajectory(), ScanHistory()
    for number in range(count):
        status = Status.OK if number % not_ok else Status.DEGENERATE
        angle = 2.0 * math.pi * number / 5000.0
        trajectory.stamps.append(number * 100_000_000)
        trajectory.poses.append((10.0 * math.cos(angle), 10.0 * math.sin(angle), angle))
        trajectory.statuses.append(status)
        trajectory.milliseconds.append(5.0 + number % 7)
        trajectory.used.append(True)
        history.add(update(number, status, noise[number % 64:][:beams], segments))
    return trajectory, history


@pytest.mark.parametrize('not_ok', [23, pytest.param(2, marks=pytest.mark.long)])
def test_a_long_drive_is_a_page_of_at_most_25_megabytes_that_states_what_it_leaves_out(show, tmp_path, size, not_ok):
    count = size(50_000, 150_000)
    trajectory, history = long_drive(count, 360, not_ok)
    truth = np.array(trajectory.stamps), trajectory.pose_array() + np.array((0.0, 0.1, 0.0))
    path = tmp_path / 'report.html'
    write_report(path, Report('long', [], KnownMotion(truth, None, truth), trajectory, density_map([], []), [],
                              Parameters(), history=history))
    assert path.stat().st_size <= MOST_BYTES
    numbers = [record.number for record in history.records() if record.status is not Status.OK]
    assert numbers == list(range(0, count, not_ok * history.not_ok_step))
    assert history.not_ok_step == (1 if not_ok == 23 else 2)
    browser = show(path)
    said = browser.value('document.getElementById("dropped").textContent')
    assert said.startswith(f'The page holds {len(history.records())} of {count} scans: every {history.scan_step}. scan')
    assert f'every {history.beam_step}. return of each scan' in said
    browser.value('page.go(drive.count - 1)')
    browser.frame()
    assert browser.value('drive.scan[page.current]') > count - 100 and browser.complaints == []


def test_fewer_scans_and_beams_are_kept_evenly():
    history = ScanHistory(most_scans=10, most_points=50)
    segments = SimpleNamespace(start=np.zeros((0, 2)), end=np.ones((0, 2)))
    points = np.column_stack((np.arange(16.0), np.zeros(16)))
    for number in range(100):
        history.add(update(number, Status.FAILED if number == 41 else Status.OK, points, segments))
    numbers = [record.number for record in history.records()]
    assert 41 in numbers and history.scan_step == 16
    assert numbers == sorted({*range(0, 41, 16), 41, *(n + 1 for n in range(48, 99, 16))})
    assert history.beam_step == 4
    assert history.records()[0].points[:, 0].tolist() == [0, 800, 1600, 2400]


def test_the_returns_of_a_rotated_laser_are_in_its_own_frame(simulation):
    """The laser is rotated by 2 rad on the base; the odometry has seen the scans of one that looks along the base."""
    scans = simulation.scans[20:30]
    history = ScanHistory(yaw=2.0)
    trajectory, odometry = Trajectory(yaw=2.0), Odometry()
    for scan, of_odometry in zip(scans, trajectory.follow(turned(scans, 2.0), odometry), strict=True):
        history.add(of_odometry)
        record = history.records()[-1]
        np.testing.assert_allclose(RESOLUTION * record.points, scan.points[scan.valid], atol=0.5001 * RESOLUTION)
        back = SE2(theta=-2.0)
        along = back.rotation() @ of_odometry.covariance[:2, :2] @ back.rotation().T
        np.testing.assert_allclose(record.covariance[:2, :2], along, atol=1e-15)


def test_returns_out_of_reach_are_left_out():
    history = ScanHistory()
    segments = SimpleNamespace(start=np.zeros((0, 2)), end=np.zeros((0, 2)))
    history.add(update(0, Status.OK, np.array([[1.0, 2.0], [90_000.0, 0.0]]), segments))
    assert history.records()[0].points.tolist() == [[200, 400]]
