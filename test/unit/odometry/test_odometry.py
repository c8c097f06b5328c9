# SPDX-License-Identifier: Apache-2.0
"""The odometry: tracking, priors, time, faults."""
import contextlib
import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters, Prior, Scan, ScanError, ScanGeometry, Status
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.returns import deskew
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.odometry.references import search_parameters
from dbscan_reg_ros.simulation import LIDARS, World, follow, measure, simulate
from dbscan_reg_ros.simulation.raycasting import cast
from dbscan_reg_ros.simulation.worlds import sides

ROOM = outline(L_ROOM)
BOX = outline([(0.9, -0.3), (1.1, 0.1), (1.0, 0.4), (1.4, 0.3), (1.4, -0.3)])
PARALLEL = outline([(-50.0, -1.0), (50.0, -1.0), (50.0, 1.2), (-50.0, 1.2)])[::2]
SECOND = 1_000_000_000
TENTH = SECOND // 10


def drive(steps, speed=0.3, turn=0.3):
    """Poses [m, rad] ten times a second on an arc, from the origin."""
    pose, poses = SE2(), []
    for _ in range(steps):
        poses.append(pose)
        pose = pose @ SE2(0.1 * speed, 0.0, 0.1 * turn)
    return poses


def scan_at(pose, index, geometry=FULL, noise=0.01):
    return dataclasses.replace(look(ROOM, pose, geometry, noise, index), stamp=index * TENTH)


COARSE = ScanGeometry(-math.pi, math.radians(3.0), 120)


def noise_at(stamp, rng, geometry=FULL):
    return Scan(stamp, rng.uniform(0.3, 8.0, geometry.size), geometry)


def error(update, truth):
    e = truth.inverse() @ update.pose
    return math.hypot(e.x, e.y), abs(e.theta)


def run(odometry, poses, first=0):
    return [odometry.process(scan_at(pose, first + i)) for i, pose in enumerate(poses)]


@pytest.mark.parametrize('reference', ['previous', 'keyframe', 'window'])
def test_an_arc_is_followed(reference):
    poses = drive(60)
    updates = run(Odometry(Parameters().replace({'odometry.reference': reference})), poses)
    assert [u.status for u in updates] == [Status.OK] * 60
    distance, angle = error(updates[-1], poses[-1])
    assert distance < 0.03
    assert angle < 0.01


def test_standing_still_is_still():
    updates = run(Odometry(), [SE2()] * 100)
    assert max(error(u, SE2())[0] for u in updates) < 0.004
    assert max(error(u, SE2())[1] for u in updates) < 0.003
    late = np.array([u.pose.as_array() for u in updates[50:]]).mean(axis=0)
    early = np.array([u.pose.as_array() for u in updates[1:50]]).mean(axis=0)
    assert late == pytest.approx(early, abs=5e-4)


def test_the_pose_covariance_grows_along_the_path():
    updates = run(Odometry(), drive(60))
    size = [np.trace(u.covariance[:2, :2]) for u in updates]
    assert size[59] > 2.0 * size[5] > 0.0
    assert all((np.linalg.eigvalsh(u.covariance) > 0.0).all() for u in updates)
    assert all((np.linalg.eigvalsh(u.twist_covariance) > 0.0).all() for u in updates)


def test_a_prior_from_elsewhere_that_lies_does_not_beat_the_scans():
    odometry, poses = Odometry(), drive(40)
    for i, pose in enumerate(poses):
        lie = Prior(SE2(0.4, 0.2, -0.3), np.diag([0.01, 0.01, 0.01]) ** 2) if i else None
        update = odometry.process(scan_at(pose, i), lie)
    distance, angle = error(update, poses[-1])
    assert distance < 0.03
    assert angle < 0.02


def test_a_scan_of_noise_is_coasted_over():
    odometry, poses = Odometry(), drive(40)
    rng = np.random.default_rng(5)
    for i, pose in enumerate(poses):
        wild = i in (15, 25)
        scan = noise_at(i * TENTH, rng) if wild else scan_at(pose, i)
        update = odometry.process(scan)
        if wild:
            assert update.status is not Status.OK
            assert not update.is_key_frame
            assert error(update, pose)[0] < 0.03
    assert update.status is Status.OK
    assert error(update, poses[-1])[0] < 0.03


def test_a_prediction_can_be_requested_and_changes_nothing():
    asked, other = Odometry(), Odometry()
    assert asked.predict_motion(0) is None
    for i, pose in enumerate(drive(20)):
        asked.predict_motion(i * TENTH)
        assert asked.process(scan_at(pose, i)).pose == other.process(scan_at(pose, i)).pose
    expected = asked.predict_motion(20 * TENTH)
    noise = noise_at(20 * TENTH, np.random.default_rng(6))
    coasted, given = asked.process(noise), other.process(noise, expected)
    assert coasted.pose == given.pose
    assert coasted.increment.as_array() == pytest.approx(expected.transform.as_array(), abs=1e-12)
    assert np.array_equal(coasted.covariance, given.covariance)
    late = asked.predict_motion(60 * TENTH)
    assert late.transform.x < 0.8 * 40 * expected.transform.x and late.transform.theta == 0.0, 'the velocity decays'
    assert late.translation_sigma > 5.0 * expected.translation_sigma


@pytest.mark.parametrize(('before', 'turn'), [(0.2, 0.5), (-0.2, 0.2), (0.4, 0.0)])
def test_a_measured_rotation_bends_the_arc_and_keeps_its_covariance(before, turn):
    """The same way along another arc; the chord of an arc of length s that turns by t is s sin(t / 2) / (t / 2)."""
    def arc(turned):
        chord = 0.5 * np.sinc(0.5 * turned / np.pi)
        return SE2(chord * math.cos(0.5 * turned), chord * math.sin(0.5 * turned), turned)
    own = Prior(arc(before), np.diag([0.1, 0.1, 0.5]) ** 2, np.diag([0.05, 0.05, 0.3]) ** 2, False)
    bent = own.with_rotation(turn, 0.02)
    assert bent.transform.as_array() == pytest.approx(arc(turn).as_array(), abs=0.006)
    assert np.allclose(bent.covariance, np.diag([0.1, 0.1, 0.02]) ** 2)
    assert np.allclose(bent.velocity_change, np.diag([0.05, 0.05, 0.0]) ** 2) and not bent.measures_translation
    measured = Prior(own.transform, own.covariance).with_rotation(turn, 0.02)
    assert measured.velocity_change is None and measured.measures_translation


def test_a_lost_sensor_coasts_then_stands_then_restarts():
    odometry = Odometry(Parameters().replace({'advanced.odometry.restart_time': 3.0}))
    run(odometry, drive(20))
    rng = np.random.default_rng(6)
    updates = [odometry.process(noise_at((20 + i) * TENTH, rng)) for i in range(36)]
    moving = [math.hypot(u.increment.x, u.increment.y) > 0.015 for u in updates]
    assert all(moving[:8])
    assert not any(moving[12:25])
    started = [i for i, u in enumerate(updates) if u.restarted]
    assert started[0] == pytest.approx(30, abs=2)
    assert np.trace(updates[25].covariance) > 10.0 * np.trace(updates[0].covariance)


def test_a_lost_sensor_follows_the_external_prior():
    odometry, rng, prior = Odometry(), np.random.default_rng(2), Prior(SE2(0.03, 0.0, 0.03),
                                                                       np.diag((0.005, 0.005, 0.005)) ** 2)
    for update in run(odometry, drive(10)):
        last = update
    for i in range(10, 40):
        update = odometry.process(noise_at(i * TENTH, rng, COARSE), prior)
        last_pose, last = last.pose, update
        assert update.status is not Status.OK
        assert error(update, last_pose @ prior.transform) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_after_a_gap_a_lost_sensor_restarts_at_the_external_prior():
    """The robot moved on while no scan was received; the next one matches no key frame."""
    odometry, prior = Odometry(), Prior(SE2(0.8, 0.1, 1.3), np.diag((0.05, 0.05, 0.05)) ** 2)
    *_, last = run(odometry, drive(10))
    update = odometry.process(noise_at(20 * SECOND, np.random.default_rng(2)), prior)
    assert update.restarted and update.status is Status.FAILED
    assert error(update, last.pose @ prior.transform) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert update.increment.as_array() == pytest.approx(prior.transform.as_array())


@pytest.mark.parametrize(('memory', 'least', 'most'), [(300.0, 0.0, 0.3), (0.0, 0.8, 1.2)])
def test_the_wheel_calibration_corrects_the_prior_while_lost(memory, least, most):
    """Wheels 5 % too large and unequal, a sensor 8 cm from its stated mounting; then 0.9 s without a usable scan."""
    odometry = Odometry(Parameters().replace({'advanced.prior.calibration_distance': memory}))
    poses, rng = drive(160), np.random.default_rng(7)
    step = poses[0].inverse() @ poses[1]
    prior = Prior(SE2(1.05 * step.x, -0.08 * step.theta, step.theta + 0.05 * step.x), np.diag((0.02, 0.02, 0.03)) ** 2)
    for i, pose in enumerate(poses):
        scan = scan_at(pose, i, noise=0.005) if i < 151 else noise_at(i * TENTH, rng, COARSE)
        update = odometry.process(scan, prior if i else None)
        assert (update.status is Status.OK) == (i < 151)
    by_wheels = poses[150]
    for _ in range(9):
        by_wheels = by_wheels @ prior.transform
    wrong = math.hypot(*(poses[-1].inverse() @ by_wheels).as_array()[:2])
    assert least * wrong <= error(update, poses[-1])[0] <= most * wrong


def test_slipping_wheels_are_rejected_where_few_points_constrain_the_motion():
    """Half a metre at once, between two walls with a box at one of them."""
    walls = np.concatenate((PARALLEL, outline([(3.0, -1.0), (3.4, -1.0), (3.4, -0.4), (3.0, -0.4)])))
    odometry, spread = Odometry(), np.diag((0.02, 0.02, 0.03)) ** 2
    for i in range(40):
        pose, slip = SE2(0.05 * i - 1.5), 0.5 if i == 20 else 0.0
        scan = dataclasses.replace(look(walls, pose, FULL, 0.005, i), stamp=i * TENTH)
        update = odometry.process(scan, Prior(SE2(0.05 + slip), spread) if i else None)
        assert update.pose.x == pytest.approx(0.05 * i, abs=0.03)
        assert not i or update.registration.weakest_information < Parameters().decision.weak_prior_information


def test_a_wall_that_is_seen_first_after_unknown_motion_is_no_place_that_is_known():
    """A smooth tunnel; its end is in sight after 9 m, of which the scans show nothing."""
    lidar = dataclasses.replace(LIDARS['sick_lms200'], rate=5.0)
    walls = sides(np.array([(-2.0, -1.1), (32.0, -1.1), (32.0, 1.1), (-2.0, 1.1)]))
    drive = simulate(World(walls, np.zeros((1, 2))), follow(np.array([(0.0, 0.0), (16.0, 0.0)]), speed=1.0), lidar)
    odometry = Odometry()
    updates = [odometry.process(scan) for scan in drive.scans]
    errors = [update.pose.x - x for update, (x, _, _) in zip(updates, drive.truth - drive.truth[0], strict=True)]
    assert updates[-1].status is Status.OK and abs(errors[-1]) > 5.0
    assert all(abs(error) < 3.0 * math.sqrt(update.covariance[0, 0])
               for update, error in zip(updates, errors, strict=True))


def test_increments_add_up_to_the_pose_also_after_a_rest_and_a_restart():
    odometry, pose, stamp = Odometry(), SE2(), 0
    for i in range(45):
        stamp += -10 * SECOND if i == 40 else TENTH
        update = odometry.process(dataclasses.replace(scan_at(SE2(), i, noise=0.02), stamp=stamp))
        pose = pose @ update.increment
        assert error(update, pose) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert bool(update.restarted) == (i == 40)


def test_an_update_is_the_callers_own():
    odometry = Odometry()
    run(odometry, drive(3))[-1].twist[:] = 99.0
    assert abs(odometry.process(scan_at(drive(4)[-1], 3)).twist).max() < 2.0


@pytest.mark.parametrize('copied', [copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
def test_a_copy_goes_on_with_equal_bits(copied):
    odometry, poses = Odometry(), drive(20)
    run(odometry, poses[:10])
    one, other = (run(each, poses[10:], first=10)[-1] for each in (copied(odometry), odometry))
    assert one.pose == other.pose and np.array_equal(one.covariance, other.covariance)


def test_a_bad_scan_changes_nothing():
    poses = drive(20)
    clean, disturbed = Odometry(), Odometry()
    expected = run(clean, poses)
    for i, pose in enumerate(poses):
        if i == 10:
            with pytest.raises(ScanError):
                disturbed.process(Scan(i * TENTH, np.full(FULL.size, np.nan), FULL))
        update = disturbed.process(scan_at(pose, i))
        assert update.pose == expected[i].pose


def test_stamps_far_in_the_past_restart_and_keep_the_pose():
    odometry, poses = Odometry(), drive(30)
    last = run(odometry, poses)[-1]
    update = odometry.process(dataclasses.replace(scan_at(poses[0], 0), stamp=-10 * SECOND))
    assert update.restarted.startswith('stamps went back by')
    assert update.pose == last.pose


def test_a_changed_number_of_beams_goes_on():
    odometry, poses = Odometry(), drive(40)
    coarse = ScanGeometry(-math.pi, 2.0 * FULL.angle_increment, FULL.size // 2)
    for i, pose in enumerate(poses):
        update = odometry.process(scan_at(pose, i, coarse if i >= 20 else FULL))
    assert update.status is Status.OK
    assert error(update, poses[-1])[0] < 0.03


def test_every_beam_is_moved_by_the_motion_since_the_stamp():
    scan = Scan(5, [1.0, 2.0, 3.0], ScanGeometry(0.2, 1.0, 3), 0.1, 'laser')
    found = deskew(scan, [1.0, 2.0, 0.5])
    expected = [SE2(0.1 * k, 0.2 * k, 0.05 * k).apply(scan.points[k]) for k in range(3)]
    np.testing.assert_allclose(found.points, expected, atol=1e-6)
    assert (found.stamp, found.frame_id, found.time_increment) == (5, 'laser', 0.0)
    clockwise = Scan(0, [1.0, 2.0, 3.0], ScanGeometry(0.2, -1.0, 3), 0.1)
    assert deskew(clockwise, [1.0, 2.0, 0.5]).geometry.angle_increment == -1.0


def test_an_error_of_the_twist_dies_where_a_scan_takes_the_whole_interval():
    """The sensor accelerates from rest in one step; each scan is deskewed by the twist of the scan before."""
    odometry, speed, increment = Odometry(), 0.5, 0.1 / FULL.size
    for i in range(20):
        way = speed * np.maximum(0.1 * (i - 5) + increment * np.arange(FULL.size), 0.0)
        places = np.column_stack((way, np.zeros(FULL.size)))
        ranges = cast(places, FULL.directions, ROOM, np.empty((0, 3)))
        update = odometry.process(Scan(i * TENTH, ranges, FULL, increment))
        if i >= 15:
            assert update.twist == pytest.approx([speed, 0.0, 0.0], abs=0.01)
            assert update.pose.as_array() == pytest.approx([way[0], 0.0, 0.0], abs=0.01)


@pytest.mark.parametrize(('lidar', 'off', 'turned'), [('rplidar_a', 0.015, 0.005), ('rplidar_s', 0.015, 0.005),
                                                      ('lds', 0.05, 0.015)])
@pytest.mark.parametrize(('speed', 'turn'), [(0.8, 1e-6), (0.5, 0.8)])
def test_a_start_in_motion_leaves_no_offset(lidar, off, turned, speed, turn):
    """A scan takes the whole interval; the motion within the first one is known from the second on."""
    lidar, rng, odometry, world = LIDARS[lidar], np.random.default_rng(1), Odometry(), World(ROOM, np.zeros((1, 2)))
    for i in range(8):
        angle = turn * (i / lidar.rate + lidar.time_increment * np.arange(lidar.beams))
        poses = np.column_stack((speed / turn * np.sin(angle), speed / turn * (1.0 - np.cos(angle)), angle))
        update = odometry.process(measure(world, poses, lidar, rng, round(i / lidar.rate * SECOND)))
        if i >= 2:
            distance, angle = error(update, SE2(*poses[0]))
            assert distance < off
            assert angle < turned


@pytest.mark.parametrize('jump', [-50, 3])
def test_after_a_jump_of_the_stamps_a_scan_is_not_deskewed(jump):
    """The sensor turns, then the stamps jump and it rests."""
    odometry, increment, updates = Odometry(), 0.1 / FULL.size, []
    for i in range(40):
        turning = i < 30
        turned = np.minimum(0.1 * i + increment * np.arange(FULL.size) * turning, 3.0)
        angles = FULL.bearings + turned
        ranges = cast(np.zeros((FULL.size, 2)), np.stack((np.cos(angles), np.sin(angles)), axis=1), ROOM,
                      np.empty((0, 3)))
        stamp = (i + 500) * TENTH + (0 if turning else jump * SECOND)
        updates.append(odometry.process(Scan(stamp, ranges, FULL, increment)))
    assert updates[30].restarted
    for update in updates[30:]:
        distance, angle = error(update, updates[30].pose)
        assert distance < 0.002
        assert angle < 0.002


def test_a_scan_left_out_takes_twice_the_time_and_no_speed():
    """However the stamps jitter."""
    odometry, rng, speed = Odometry(), np.random.default_rng(0), 0.5
    for i in range(60):
        stamp = i * TENTH + round(rng.normal(0.0, 1e5))
        if i % 7 != 6:
            update = odometry.process(dataclasses.replace(scan_at(SE2(0.05 * i - 1.5), i, noise=0.002), stamp=stamp))
        if i > 7:
            assert update.twist[0] == pytest.approx(speed, abs=0.15)


def test_the_twist_after_a_scan_that_was_not_found_is_as_before():
    """At a steady speed, with scans that take the whole interval."""
    odometry, speed, increment, noise = Odometry(), 0.5, 0.1 / FULL.size, noise_at(0, np.random.default_rng(3)).ranges
    for i in range(12):
        way = speed * (0.1 * i + increment * np.arange(FULL.size))
        ranges = cast(np.column_stack((way, np.zeros(FULL.size))), FULL.directions, ROOM, np.empty((0, 3)))
        update = odometry.process(Scan(i * TENTH, noise if i == 10 else ranges, FULL, increment))
        assert (update.status is Status.FAILED) == (i == 10)
    assert update.twist == pytest.approx([speed, 0.0, 0.0], abs=0.02)


def test_a_stamp_that_comes_twice_says_nothing_of_the_speed():
    odometry, poses = Odometry(), drive(20)
    last = run(odometry, poses)[-1]
    again = odometry.process(scan_at(poses[-1], 19))
    assert again.twist.tolist() == last.twist.tolist()
    assert again.interval == pytest.approx(0.1)


def test_a_reset_starts_at_the_pose_given():
    odometry = Odometry()
    run(odometry, drive(10))
    odometry.reset(SE2(3.0, 2.0, 1.0))
    update = odometry.process(scan_at(SE2(), 50))
    assert update.pose == SE2(3.0, 2.0, 1.0)
    assert update.registration is None
    assert update.is_key_frame


def test_a_sensor_at_rest_stays_nearer_to_its_place_than_its_noise():
    """A motion after the standstill is followed at once."""
    rng = np.random.default_rng(8)
    odometry, steady = Odometry(Parameters().replace({'advanced.odometry.zero_velocity_gate': 0.0})), Odometry()
    scans = [dataclasses.replace(scan_at(SE2(), i), ranges=scan_at(SE2(), i).ranges + rng.normal(0.0, 0.01, FULL.size))
             for i in range(60)]
    turns = np.array([[o.process(scan).pose.theta for scan in scans] for o in (odometry, steady)])
    assert np.abs(turns[1]).max() < np.abs(turns[0]).max()
    assert np.ptp(turns[1, 30:]) < 0.3 * np.ptp(turns[0, 30:])
    moved = SE2(0.05, 0.02, 0.03)
    assert error(steady.process(scan_at(moved, 60)), moved)[0] < 0.01


@pytest.fixture(scope='module')
def short_drives():
    """Five scans of a room with a movable box, and of two bare walls."""
    return [[dataclasses.replace(look(walls, pose, FULL, 0.01, i), stamp=i * TENTH) for i, pose in enumerate(drive(5))]
            for walls in (np.concatenate((ROOM, BOX)), PARALLEL)]


@pytest.mark.parametrize('name', [each.name for each in Parameters.describe() if each.minimum is not None])
def test_a_parameter_may_have_its_least_value(short_drives, name):
    least = {each.name: each.minimum for each in Parameters.describe()}
    for scans in short_drives:
        odometry = Odometry(Parameters().replace({each: least[each]
                                                  for each in {name, name.replace('_max', '_min')} & set(least)}))
        for scan in scans:
            with contextlib.suppress(ScanError):
                update = odometry.process(scan)
                assert np.isfinite(update.pose.as_array()).all()
                for covariance in (update.covariance, update.twist_covariance):
                    assert np.linalg.eigvalsh(covariance).min() > 0.0


@pytest.mark.parametrize(('single', 'gated'), [(0.4, 0.0), (0.95, 0.9), (1.0, 1.0)])
def test_the_gate_allows_twice_the_probability_of_an_error(single, gated):
    asked = Parameters().replace({'advanced.decision.min_confidence': single})
    assert search_parameters(asked).decision.min_confidence == pytest.approx(gated)


@pytest.mark.parametrize('guess', [True, False])
def test_a_scan_is_located_where_it_was_taken_and_one_of_somewhere_else_is_not(guess):
    """With 0.1 m and 0.05 rad of error of the prediction, and no effect on the track."""
    odometry, poses = Odometry(), drive(20)
    updates = run(odometry, poses)
    there, elsewhere = SE2(0.1, 0.03, 0.05), outline([(-1.3, -1.0), (0.8, -1.4), (1.2, 0.9), (-0.9, 1.6)])
    seen = extract_features(scan_at(poses[-1] @ there, 20))
    found = odometry.locate(dataclasses.replace(updates[-1], features=seen), guess)
    off = (poses[-1] @ there).inverse() @ found.pose
    assert math.hypot(off.x, off.y) < 0.03 and abs(off.theta) < 0.02
    other = extract_features(dataclasses.replace(look(elsewhere, SE2(), FULL, 0.01, 1), stamp=20 * TENTH))
    assert odometry.locate(dataclasses.replace(updates[-1], features=other), guess) is None
    assert error(odometry.process(scan_at(poses[-1], 20)), poses[-1])[0] < 0.03
