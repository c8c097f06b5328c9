# SPDX-License-Identifier: Apache-2.0
"""Which lidars are used and which errors are named, on drives whose truth is known."""
import dataclasses
import itertools
import math
from collections import deque

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.compared_lidar import ComparedLidar, Disagreement
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.core.odometry.calibration.location import Location
from dbscan_reg_ros.core.odometry.calibration.majority import described, error_of_first
from dbscan_reg_ros.core.odometry.calibration.relative_pose import RelativePose
from dbscan_reg_ros.core.odometry.calibration.wheels import Wrong
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.registration.records import Prior
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.simulation import rooms, simulate

TRUE = SE2(-0.7, -0.5, 0.0)
SEEDS = 1, 2, 3
BIAS = 0.003
"""Standard deviation of the error of the map [m]."""


@pytest.fixture(scope='module')
def update():
    """A real update with a registration, whose stamp, pose and sensor the tests replace."""
    from dbscan_reg_ros.simulation import follow
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
    """A drive of two lidars, 12.5 and 15 Hz; the first one may be silent for a while.

    `wheels` returns the motion of the base between two times [s] by the wheels.
    """

    def __init__(self, update, given, late=0.0, seed=1, **kinds):
        self.comparisons = LidarComparisons(calibrate=kinds.get('calibrate', False))
        self._path, self._wheels, self._last = kinds.get('path', pose_at), kinds.get('wheels'), 0.0
        self._update, self.late, self.true = update, late, TRUE
        self.chance = kinds.get('chance')
        self.first, self.rear = Sensor('front'), Sensor('rear', given, 1)
        self._rng, self.used, self.now = np.random.default_rng(seed), [], 0.0

    def _locate(self, update, mounting):
        """Locate a scan with noise, and an error for each metre of the drive."""
        if self.chance is not None:
            return self._by_chance(update, mounting)
        if mounting and math.hypot(mounting.x - self.true.x, mounting.y - self.true.y) > 0.3:
            return None
        seconds = 1e-9 * update.stamp - self.late
        pose, group = self._path(seconds), int(seconds)
        common = np.random.default_rng(group).normal(0.0, BIAS, 3) * [1.0, 1.0, 0.5]
        sigmas = np.array([0.002, 0.002, 0.001])
        found = pose @ self.true @ SE2(*(common + self._rng.normal(0.0, sigmas)))
        return Location(update.stamp, found, np.diag(sigmas ** 2), group, mounting is not None)

    def _by_chance(self, update, mounting):
        """Locate a scan at a random place near a mounting or anywhere, or most often nowhere: its walls are unknown."""
        if self._rng.random() > self.chance:
            return None
        near = self.rear.pose @ SE2(*self._rng.normal(0.0, [0.1, 0.1, 0.03]))
        pose = self._path(1e-9 * update.stamp) @ (near if mounting else SE2(*self._rng.uniform(-3.0, 3.0, 3)))
        return Location(update.stamp, pose, np.diag([0.02, 0.02, 0.01]) ** 2, round(1e-9 * update.stamp),
                        mounting is not None)

    def run(self, seconds, silent=False):
        """Drive on."""
        end = self.now + seconds
        events = [(time, self.first, time) for time in np.arange(0.0, end, 0.08) if time >= self.now and not silent]
        events += [(time + self.late, self.rear, time) for time in np.arange(0.019, end, 1 / 15) if time >= self.now]
        for stamp, sensor, time in sorted(events, key=lambda event: event[2]):
            if not sensor.rank:
                self.comparisons.uses(sensor, round(1e9 * stamp))
            else:
                self.used.append(self.comparisons.uses(self.rear, round(1e9 * stamp)))
            sensor = self.rear if sensor.rank else sensor
            update = dataclasses.replace(self._update, stamp=round(1e9 * stamp), pose=self._path(time), sensor=sensor)
            update, prior = self._with_motion(update, time)
            self.comparisons.add(update, self._locate, prior)
        self.now = end
        return self

    def _with_motion(self, update, time):
        """Return the update of a scan with its motion, and the motion by the wheels, each with noise."""
        if update.sensor.rank and not self.used[-1]:
            return dataclasses.replace(update, registration=None, reference_changed=False), None
        start, self._last, motion = self._last, time, self._path(self._last).inverse() @ update.pose
        twist = (self._path(time - 0.01).inverse() @ self._path(time + 0.01)).as_array() / 0.02
        noise = SE2(*self._rng.normal(0.0, [0.0005, 0.0005, 0.0003]))
        prior = self._wheels and Prior(self._wheels(start, time) @ noise, np.eye(3))
        covariance = np.diag([0.01, 0.01, 0.005]) ** 2
        return dataclasses.replace(update, increment=motion, twist=twist, twist_covariance=covariance), prior

    @property
    def lidar(self):
        """The comparisons of the rear lidar."""
        return self.comparisons.lidars['rear']


@pytest.mark.parametrize('seed', SEEDS)
def test_a_lidar_that_agrees_is_used_after_ten_comparisons_and_not_accused(update, seed):
    drive = Drive(update, TRUE, seed=seed).run(2.0)
    # Used until the first one has sent scans, then on trial.
    assert drive.used[0] and not any(drive.used[3:8]) and drive.used[-1]
    drive.run(28.0)
    assert drive.lidar.driven > 20.0 and drive.lidar.error is None and np.mean(drive.used[30:]) > 0.95


@pytest.mark.parametrize('seed', SEEDS)
def test_a_wrong_mounting_is_named_after_a_long_drive_and_not_used_before(update, seed):
    drive = Drive(update, TRUE @ SE2(0.04, -0.03, math.radians(3.0)), seed=seed).run(10.0)
    assert drive.lidar.disagrees and drive.lidar.error is None and not any(drive.used[3:])
    error = drive.run(20.0).lidar.error
    assert error.distance == pytest.approx(0.05, abs=0.005) and error.time_offset == 0.0
    assert math.degrees(error.rotation) == pytest.approx(-3.0, abs=0.1)
    assert str(error).startswith('its mounting is off by ') and 'ms' not in str(error)


@pytest.mark.parametrize('seed', SEEDS)
def test_a_mounting_that_is_far_off_is_found_without_a_guess(update, seed):
    drive = Drive(update, TRUE @ SE2(0.8, -0.3, math.pi), seed=seed, calibrate=True).run(10.0)
    assert drive.lidar.error is None and not any(drive.used[3:])
    error = drive.run(30.0).lidar.error
    assert error.distance == pytest.approx(math.hypot(0.8, 0.3), abs=0.005) and error.time_offset == 0.0
    assert abs(math.degrees(error.rotation)) == pytest.approx(180.0, abs=0.1)
    off = drive.true.inverse() @ drive.lidar.used
    assert drive.used[-1] and math.hypot(off.x, off.y) < 0.005 and abs(off.theta) < math.radians(0.1)


@pytest.mark.parametrize('seed', SEEDS)
def test_a_lidar_whose_scans_fit_only_by_chance_is_never_used_and_named_after_a_long_drive(update, seed):
    drive = Drive(update, TRUE, seed=seed, chance=0.2).run(10.0)
    assert drive.lidar.known and not drive.lidar.unfit
    drive.run(40.0)
    assert not any(drive.used[3:]) and (drive.lidar.unfit or drive.lidar.error)


def test_a_lidar_that_is_never_located_is_named_after_a_long_drive(update):
    drive = Drive(update, TRUE, chance=0.0).run(10.0)
    assert not drive.lidar.unfit
    drive.run(20.0)
    assert drive.lidar.unfit and drive.lidar.error is None and not any(drive.used[3:])


@pytest.mark.parametrize('seed', SEEDS)
def test_late_stamps_are_named(update, seed):
    drive = Drive(update, TRUE, late=0.06, seed=seed).run(30.0)
    error = drive.lidar.error
    assert error.time_offset == pytest.approx(-0.06, abs=0.005) and error.distance == 0.0 == error.rotation
    assert str(error) == f'its stamps are off by {-1e3 * error.time_offset:.0f} ms' and not any(drive.used[30:])


@pytest.mark.parametrize('seed', SEEDS)
def test_late_stamps_are_named_although_the_latest_scans_agree(update, seed):
    """Drives with turns begin and end with a straight part, where late stamps do not show."""
    def path(seconds):
        turning = min(max(seconds - 10.0, 0.0), 25.0)
        last = pose_at(turning)
        return last @ SE2(0.2 * (seconds - turning), 0.0, 0.0)

    drive = Drive(update, TRUE, late=0.035, seed=seed, path=path).run(60.0)
    assert not drive.lidar.disagrees and np.mean(drive.used[-50:]) > 0.9
    assert drive.lidar.error == Disagreement(0.0, 0.0, pytest.approx(-0.035, abs=0.005))


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
def test_few_scans_are_compared_while_the_lidar_agrees_and_a_knock_is_noticed_all_the_same(update, seed):
    drive = Drive(update, TRUE, seed=seed).run(10.0)
    before, driven, turned = len(drive.lidar.comparisons), drive.lidar.driven, drive.lidar.turned
    drive.run(20.0)
    motion = drive.lidar.driven - driven + drive.lidar.turned - turned
    assert drive.used[-1] and len(drive.lidar.comparisons) - before < 1.5 * motion
    # It is knocked by 6 cm and 3 deg; the given mounting stays.
    drive.true, driven = TRUE @ SE2(0.05, -0.03, math.radians(3.0)), drive.lidar.driven
    while drive.used[-1]:
        drive.run(0.5)
    assert drive.lidar.disagrees and drive.lidar.driven - driven < 15.0


@pytest.mark.parametrize('seed', SEEDS)
def test_a_straight_drive_that_began_with_wrong_comparisons_does_not_accuse(update, seed):
    """The first comparisons are off by 6 cm along the drive; position and time offset are not observable together."""
    drive = Drive(update, TRUE, seed=seed, path=straight)
    drive.true = TRUE @ SE2(-0.06, 0.0, 0.0)
    drive.run(1.0)
    drive.true = TRUE
    drive.run(6.0)
    before = len(drive.used)
    drive.run(40.0)
    assert drive.lidar.driven > 20.0 and drive.lidar.error is None and all(drive.used[before:])


@pytest.mark.parametrize('seed', SEEDS)
def test_the_estimated_mounting_is_used_in_place_of_a_wrong_one_if_that_is_wanted(update, seed):
    given = TRUE @ SE2(0.04, -0.03, math.radians(3.0))
    drive = Drive(update, given, seed=seed, calibrate=True)
    assert drive.comparisons.mounted(drive.run(10.0).rear) is drive.rear and not any(drive.used[3:])
    while drive.lidar.error is None:
        drive.run(0.5)
    assert drive.lidar.driven == pytest.approx(20.0, abs=5.0)
    poses = [drive.comparisons.mounted(drive.run(0.5).rear).pose for _ in range(40)]
    # It is used, and the error of the given mounting stays known. Changes while it is used are small.
    assert all(drive.used[-300:]) and drive.lidar.error.distance == pytest.approx(0.05, abs=0.005)
    for pose, following in itertools.pairwise(poses):
        assert math.hypot(following.x - pose.x, following.y - pose.y) < 0.0021
    off = TRUE.inverse() @ poses[-1]
    assert math.hypot(off.x, off.y) < 0.005 and abs(off.theta) < math.radians(0.1)
    # It is knocked back to where the given mounting has it.
    drive.true = given
    drive.run(60.0)
    off = given.inverse() @ drive.comparisons.mounted(drive.rear).pose
    assert drive.used[-1] and math.hypot(off.x, off.y) < 0.015 and drive.lidar.error is None


@pytest.mark.parametrize('seed', SEEDS)
def test_a_mounting_that_is_right_or_not_observable_is_never_replaced(update, seed):
    drive = Drive(update, TRUE, seed=seed, calibrate=True).run(40.0)
    assert drive.lidar.driven > 20.0 and drive.lidar.used == TRUE
    drive = Drive(update, TRUE @ SE2(0.06, 0.0, 0.0), seed=seed, path=straight, calibrate=True).run(40.0)
    assert drive.lidar.driven > 20.0 and drive.lidar.used == drive.lidar.given


def compared(moved, given, sigma=0.001, late=0.0):
    """Comparisons of a lidar that seem to show another mounting, accused for it."""
    estimate = RelativePose(moved @ given, late, np.diag([sigma, sigma, 0.5 * sigma, sigma]) ** 2)
    return ComparedLidar(given, deque(), estimate=estimate, error=Disagreement(0.05, 0.05, late))


@pytest.mark.parametrize('seed', SEEDS)
def test_the_first_of_three_lidars_is_named_if_the_others_agree_with_each_other(seed):
    """Poses as on a robot, at which no lidar is at the origin; estimates with errors as in their covariance."""
    rng = np.random.default_rng(seed)
    first, *others = (SE2(*rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0)) for _ in range(3))
    wrong = SE2(0.04, -0.03, math.radians(3.0))
    # Where the base seems to be seen from that base which the wrong mounting gives.
    moved = first @ wrong.inverse() @ first.inverse()
    found = error_of_first(first, [compared(moved @ SE2(*rng.normal(0.0, 0.0005, 3)), each, late=0.06)
                                   for each in others])
    assert found.error.distance == pytest.approx(0.05, abs=0.004)
    assert math.degrees(found.error.rotation) == pytest.approx(3.0, abs=0.1)
    assert found.error.time_offset == pytest.approx(-0.06)
    true = first @ wrong
    assert found.estimate.pose.as_tuple() == pytest.approx(true.as_tuple(), abs=0.004)
    # One of them agrees with the first, moves otherwise, or is not known yet.
    one = compared(moved, others[0])
    agreeing = ComparedLidar(others[1], deque(), estimate=RelativePose(others[1], 0.0, one.estimate.covariance))
    for other in (agreeing, compared(SE2(0.05, 0.0, 0.0), others[1]), ComparedLidar(others[1], deque())):
        assert error_of_first(first, [one, other]) is None
    assert error_of_first(first, [one]) is None


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
    drive.run(3.0)
    assert drive.lidar.apart == 0.0 and drive.used[-1]


WRONG = SE2(0.04, -0.03, math.radians(3.0))


def wheels(moved=SE2(), late=0.0):
    """Return the wheels of a base that is moved against the first lidar, with errors of 2 %; they slip now and then."""
    def measured(start, end):
        motion = moved @ pose_at(start - late).inverse() @ pose_at(end - late) @ moved.inverse()
        slip = 1.4 if start % 10.0 < 2.0 else 1.02
        return SE2(slip * motion.x, slip * motion.y, 0.98 * motion.theta)
    return measured


@pytest.mark.parametrize('seed', SEEDS)
def test_wheels_show_that_the_first_of_two_lidars_is_wrong(update, seed):
    drive = Drive(update, WRONG @ TRUE, seed=seed, wheels=wheels(WRONG)).run(20.0)
    assert drive.lidar.wrong is Wrong.FIRST and not any(drive.used[3:])
    found = error_of_first(SE2(), [drive.lidar])
    assert found.error.distance == pytest.approx(0.05, abs=0.005) and found.wrong is Wrong.FIRST
    assert math.degrees(found.error.rotation) == pytest.approx(3.0, abs=0.1)
    assert 'the other lidar, which agrees with the wheels' in described(found, is_first=True)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize(('late', 'wrong'), [(0.0, Wrong.FURTHER), (-0.06, Wrong.FIRST)])
def test_wheels_show_whose_stamps_are_late(update, late, wrong, seed):
    """The stamps of the further lidar are 60 ms before those of the first; the wheels have those of one of them."""
    drive = Drive(update, TRUE, late=-0.06, seed=seed, wheels=wheels(late=late)).run(20.0)
    found = error_of_first(SE2(), [drive.lidar])
    assert drive.lidar.wrong is wrong and bool(found) is (wrong is Wrong.FIRST)
    assert found is None or str(found.error).startswith('its stamps are off by ')


@pytest.mark.parametrize('seed', SEEDS)
def test_wheels_show_that_the_further_of_two_lidars_is_wrong(update, seed):
    drive = Drive(update, TRUE @ WRONG, seed=seed, wheels=wheels()).run(10.0)
    assert drive.lidar.wrong is Wrong.FURTHER and drive.lidar.error is None
    drive.run(20.0)
    assert drive.lidar.wrong is Wrong.FURTHER and error_of_first(SE2(), [drive.lidar]) is None
    assert described(drive.lidar, is_first=False).startswith('disagrees with the first lidar, which agrees with the ')


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('bad', [wheels(SE2(-0.12, 0.1, math.radians(-6.0))), wheels(SE2(0.02, -0.015, 0.026))])
def test_wheels_that_agree_with_neither_lidar_do_not_decide(update, bad, seed):
    drive = Drive(update, WRONG @ TRUE, seed=seed, wheels=bad).run(30.0)
    assert drive.lidar.wrong is Wrong.UNKNOWN and drive.lidar.error and error_of_first(SE2(), [drive.lidar]) is None


@pytest.mark.parametrize('seed', SEEDS)
def test_wheels_do_not_accuse_lidars_that_agree(update, seed):
    drive = Drive(update, TRUE, seed=seed, wheels=wheels(WRONG)).run(30.0)
    assert drive.lidar.wrong is Wrong.UNKNOWN and drive.lidar.error is None
