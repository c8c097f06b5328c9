# SPDX-License-Identifier: Apache-2.0
"""Which lidars are used and which errors are named, on drives whose truth is known."""
import dataclasses
import math
from collections import deque

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.odometry.calibration.compared_lidar import ComparedLidar
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.core.odometry.calibration.location import Location
from dbscan_reg_ros.core.odometry.calibration.odd_one import named
from dbscan_reg_ros.core.odometry.calibration.relative_pose import Comparison, Disagreement, RelativePose
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.odometry.state import TrackState
from dbscan_reg_ros.core.odometry.update import leave_out
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.simulation import follow, rooms, simulate

TRUE = SE2(-0.7, -0.5, 0.0)
SEEDS = 1, 2, 3
BIAS = 0.003
"""Standard deviation of the error of the map [m]."""


@pytest.fixture(scope='module')
def update():
    """A real update with a registration, whose stamp, pose and sensor the tests replace."""
    world, odometry = rooms(1), Odometry()
    scans = simulate(world, follow(world.tour[:2]), seed=1).scans[:2]
    return [odometry.process(scan) for scan in scans][-1]


def pose_at(seconds):
    """Pose on an eight-shaped drive: the turn rate changes, and so does the speed."""
    x, y = 4.0 * math.sin(0.3 * seconds), 2.0 * math.sin(0.6 * seconds)
    return SE2(x, y, math.atan2(1.2 * math.cos(0.6 * seconds), 1.2 * math.cos(0.3 * seconds)))


def straight(seconds):
    """Pose on a straight drive at a constant speed, which begins at rest."""
    return SE2(0.8 * max(seconds - 0.5, 0.0), 0.0, 0.0)


class Drive:
    """A drive of two lidars, 12.5 and 15 Hz; the first one may be silent for a while."""

    def __init__(self, update, given, late=0.0, seed=1, **kinds):
        self.comparisons, self._path = LidarComparisons(), kinds.get('path', pose_at)
        self._update, self.late, self.true = update, late, TRUE
        self.chance = kinds.get('chance')
        self.first, self.rear = Sensor('front'), Sensor('rear', given, 1)
        self._rng, self.used, self.now = np.random.default_rng(seed), [], 0.0

    def _locate(self, update):
        """Locate a scan with noise, and an error for each metre of the drive."""
        if self.chance is not None:
            return self._by_chance(update)
        seconds = 1e-9 * update.stamp - self.late
        pose, group = self._path(seconds), int(seconds)
        common = np.random.default_rng(group).normal(0.0, BIAS, 3) * [1.0, 1.0, 0.5]
        sigmas = np.array([0.002, 0.002, 0.001])
        found = pose @ self.true @ SE2(*(common + self._rng.normal(0.0, sigmas)))
        return Location(update.stamp, found, np.diag(sigmas ** 2), group)

    def _by_chance(self, update):
        """Locate a scan at a random place near its mounting, or most often nowhere: its walls are unknown."""
        if self._rng.random() > self.chance:
            return None
        near = self.rear.pose @ SE2(*self._rng.normal(0.0, [0.1, 0.1, 0.03]))
        return Location(update.stamp, self._path(1e-9 * update.stamp) @ near, np.diag([0.02, 0.02, 0.01]) ** 2,
                        round(1e-9 * update.stamp))

    def run(self, seconds, silent=False):
        """Drive on."""
        end = self.now + seconds
        events = [(time, self.first, time) for time in np.arange(0.0, end, 0.08) if time >= self.now and not silent]
        events += [(time + self.late, self.rear, time) for time in np.arange(0.019, end, 1 / 15) if time >= self.now]
        for stamp, sensor, time in sorted(events, key=lambda event: event[2]):
            sensor = self.rear if sensor.rank else sensor
            uses = self.comparisons.uses(sensor, round(1e9 * stamp), first_maps=False)
            self.used += [uses] * sensor.rank
            update = dataclasses.replace(self._update, stamp=round(1e9 * stamp), pose=self._path(time), sensor=sensor)
            self.comparisons.add(update, self._locate)
        self.now = end
        return self

    @property
    def lidar(self):
        """The comparisons of the rear lidar."""
        return self.comparisons.lidars['rear']


@pytest.mark.parametrize('seed', SEEDS)
def test_a_lidar_that_agrees_is_used_after_ten_comparisons_and_not_named(update, seed):
    drive = Drive(update, TRUE, seed=seed).run(4.0)
    # Used until the first one has sent scans, then not before it has been compared.
    assert drive.used[0] and not any(drive.used[3:8]) and drive.used[-1]
    before = len(drive.used)
    drive.run(26.0)
    assert drive.lidar.driven > 20.0 and not drive.lidar.disagrees and all(drive.used[before:])


def test_key_frames_of_a_lidar_that_is_not_used_are_removed(update):
    front, rear = Sensor('front'), Sensor('rear', TRUE, 1)
    state = TrackState.initial(SE2(), number=0)
    leave_out(state, rear)
    assert state.window is None
    state.window = KeyFrameWindow([KeyFrame(update.features, SE2(), sensor=each) for each in (front, rear)])
    leave_out(state, rear)
    assert state.window.sensors == {'front'}


def test_a_robot_with_one_lidar_compares_nothing(monkeypatch):
    for name in 'uses', 'add':
        monkeypatch.delattr(LidarComparisons, name)
    world = rooms(1)
    odometry = Odometry()
    assert not [update for update in map(odometry.process, simulate(world, follow(world.tour[:2]), seed=1).scans[:3])
                if update.waits]


@pytest.mark.parametrize('seed', SEEDS)
def test_a_wrong_mounting_is_named_within_20_m_and_never_used(update, seed):
    drive = Drive(update, TRUE @ SE2(0.04, -0.03, math.radians(3.0)), seed=seed).run(3.0)
    assert drive.lidar.known and not drive.lidar.disagrees
    while not drive.lidar.disagrees:
        drive.run(0.5)
    error = drive.lidar.error
    assert drive.lidar.driven < 20.0 and not any(drive.used[3:])
    assert error.distance == pytest.approx(0.05, abs=0.01) and error.time_offset == 0.0
    assert math.degrees(error.rotation) == pytest.approx(-3.0, abs=0.1)
    assert str(error).startswith('its mounting is off by ') and 'ms' not in str(error)
    assert not drive.lidar.unfit


@pytest.mark.parametrize('seed', SEEDS)
def test_late_stamps_are_named(update, seed):
    drive = Drive(update, TRUE, late=0.06, seed=seed).run(15.0)
    error = drive.lidar.error
    assert drive.lidar.disagrees and drive.lidar.driven < 20.0 and not any(drive.used[-50:])
    assert error == Disagreement(0.0, 0.0, pytest.approx(-0.06, abs=0.01))
    assert str(error) == f'its stamps are off by {-1e3 * error.time_offset:.0f} ms'


@pytest.mark.parametrize('seed', SEEDS)
def test_late_stamps_on_a_straight_drive_are_named_as_mounting_or_stamps(update, seed):
    """At a constant speed both look the same."""
    drive = Drive(update, TRUE, late=0.06, seed=seed, path=lambda seconds: SE2(0.8 * seconds, 0.0, 0.0)).run(30.0)
    assert drive.lidar.disagrees and str(drive.lidar.error) == 'its mounting or its stamps are off'


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('chance', [0.2, 0.0])
def test_a_lidar_whose_scans_fit_by_chance_or_never_is_not_used_and_named_after_a_long_drive(update, seed, chance):
    drive = Drive(update, TRUE, seed=seed, chance=chance).run(4.0)
    assert not drive.lidar.unfit
    drive.run(60.0)
    assert not any(drive.used[3:]) and drive.lidar.unfit
    assert named(SE2(), [drive.lidar]) == [None, None]


def test_a_lidar_that_disagrees_is_used_while_the_first_one_is_silent(update):
    drive = Drive(update, TRUE @ SE2(0.1, 0.0, 0.0)).run(8.0)
    before = len(drive.used)
    drive.run(2.0, silent=True)
    assert not any(drive.used[before - 5:before]) and all(drive.used[before + 4:])
    before = len(drive.used)
    drive.run(2.0)
    assert not any(drive.used[before + 4:])


def test_a_mounting_that_is_corrected_is_used_at_once(update):
    drive = Drive(update, TRUE @ SE2(0.1, 0.0, 0.0)).run(10.0)
    drive.rear = dataclasses.replace(drive.rear, pose=TRUE)
    before = len(drive.used)
    drive.run(10.0)
    assert not any(drive.used[before - 5:before]) and all(drive.used[before:])


@pytest.mark.parametrize('seed', SEEDS)
def test_a_knock_is_noticed_and_named_until_the_lidar_is_back(update, seed):
    """It is knocked by 6 cm and 3 deg; the given mounting stays."""
    drive = Drive(update, TRUE, seed=seed).run(30.0)
    for true, fits in ((TRUE @ SE2(0.05, -0.03, math.radians(3.0)), False), (TRUE, True)):
        drive.true, driven = true, drive.lidar.driven
        while drive.used[-1] is not fits:
            drive.run(0.5)
        assert drive.lidar.disagrees is not fits and drive.lidar.driven - driven < 15.0


@pytest.mark.parametrize('seed', SEEDS)
def test_a_drive_that_began_with_wrong_comparisons_does_not_accuse(update, seed):
    """The first comparisons are off by 6 cm, as of a cabinet of which the lidars see different parts."""
    drive = Drive(update, TRUE, seed=seed, path=straight)
    drive.true = TRUE @ SE2(-0.06, 0.0, 0.0)
    drive.run(1.0)
    drive.true = TRUE
    while drive.lidar.driven < 20.0:
        assert not drive.run(0.5).lidar.disagrees
    assert all(drive.used[-200:])


def compared(moved, given, sigma=0.001, late=0.0, fits=False):
    """A lidar that seems to have another mounting, and is named for it unless it `fits`."""
    estimate = RelativePose(moved @ given, late, np.diag([sigma, sigma, 0.5 * sigma, sigma]) ** 2)
    found = Comparison(moved @ given, 1e-6 * np.eye(3), np.zeros(3), np.eye(3), 0)
    return ComparedLidar(given, deque([found] * 30), uses=fits, disagrees=not fits, _estimate=estimate)


WRONG = SE2(0.04, -0.03, math.radians(3.0))


@pytest.mark.parametrize('seed', SEEDS)
def test_of_two_lidars_both_are_named_and_of_three_the_odd_one(seed):
    """Poses as on a robot, at which no lidar is at the origin; estimates with errors as in their covariance."""
    rng = np.random.default_rng(seed)
    first, *others = (SE2(*rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0)) for _ in range(3))
    # Where the base seems to be seen from that base which the wrong mounting gives.
    moved = first @ WRONG.inverse() @ first.inverse()
    pair = [compared(moved @ SE2(*rng.normal(0.0, 0.0005, 3)), each) for each in others]
    found, *rest = named(first, pair)
    assert rest == [None, None] and 'all others' in found.others
    assert found.error == Disagreement(pytest.approx(0.05, abs=0.004), pytest.approx(math.radians(3.0), abs=0.002), 0.0)
    assert found.estimate.pose.as_tuple() == pytest.approx((first @ WRONG).as_tuple(), abs=0.004)
    # Both of two: the values of each are those if the other is right.
    one, other = named(first, pair[:1])
    assert one.estimate.pose.as_tuple() == pytest.approx((first @ WRONG).as_tuple(), abs=0.004)
    assert other.estimate == pair[0].estimate and 'one of both is wrong' in one.others and 'one of both' in other.others
    # One of them agrees with the first, moves otherwise, or is not known yet.
    for second in (compared(SE2(), others[1], fits=True), compared(SE2(0.2, 0.0, 0.0), others[1]), None):
        assert [bool(each) for each in named(first, [pair[0], second])] == [
            False, True, second is not None and second.disagrees]


@pytest.mark.parametrize('late', [-5.0, 5.0, 0.4])
def test_a_lidar_with_another_clock_is_not_used(update, late):
    drive = Drive(update, TRUE, late=late).run(3.0)
    assert not any(drive.used[3:]) and drive.lidar.apart == pytest.approx(late, abs=0.1)
    drive.run(6.0, silent=True)
    assert drive.used[-1] and drive.lidar.apart == 0.0
    # The first one returns, and the clocks are synchronised.
    before = len(drive.used)
    drive.run(2.0)
    assert not any(drive.used[before + 3:]) and drive.lidar.apart != 0.0
    drive.late = 0.0
    drive.run(8.0)
    assert drive.lidar.apart == 0.0 and drive.used[-1]
