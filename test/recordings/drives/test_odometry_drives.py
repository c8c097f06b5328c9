# SPDX-License-Identifier: Apache-2.0
"""Odometry over whole simulated drives: time stamps, lost scans, corridors, circular rooms."""
import dataclasses
import itertools
import math

import numpy as np
import pytest
from benchmarks.odometry.moving_courses import curved
from rooms import outline

from dbscan_reg_ros import SE2, Parameters, Prior, Status
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import as_vectors
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.sensor import FIRST, Sensor
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.replays.odometry import RecordedMotion, replay_odometry
from dbscan_reg_ros.replays.summary import describe_contradictions
from dbscan_reg_ros.replays.trajectory import Trajectory
from dbscan_reg_ros.robot.parameters import NodeParameters
from dbscan_reg_ros.simulation import LIDARS, PRESETS, Lidar, World, corridor, follow, measure, rooms, simulate

SECOND = 1_000_000_000
TENTH = SECOND // 10


def error(update, truth):
    e = truth.inverse() @ update.pose
    return math.hypot(e.x, e.y), abs(e.theta)


@pytest.mark.long
@pytest.mark.parametrize('share', [0.2, 0.5, 0.7])
def test_a_spinning_lidar_whose_scans_are_lost_is_followed(share):
    world = rooms(4)
    result = simulate(world, follow(world.tour[:4]), LIDARS['rplidar_a'], seed=4)
    kept = np.random.default_rng(4).random(len(result.scans)) >= share
    kept[0] = True
    odometry, truth = Odometry(), [SE2(*pose) for pose in result.truth[kept]]
    updates = [odometry.process(scan) for scan, there in zip(result.scans, kept, strict=True) if there]
    off = [math.hypot(*((truth[0].inverse() @ pose).inverse() @ update.pose).as_array()[:2])
           for pose, update in zip(truth, updates, strict=True)]
    assert max(off) < 0.1


@pytest.mark.long
@pytest.mark.parametrize(('name', 'seed'), [('hokuyo_urg04lx', 2), ('lds', 3), ('lds', 4)])
def test_after_a_second_without_scans_the_heading_is_kept_in_a_symmetric_corridor(name, seed):
    """A short symmetric corridor, there and back: only one direction is the heading of the sensor."""
    world = corridor(length=14.0, doors=4, seed=seed)
    result = simulate(world, follow([*world.tour, world.tour[0], world.tour[1]], speed=1.2, acceleration=1.0,
                                    turn_rate=1.6),
                      LIDARS[name], seed=seed)
    odometry, start, off = Odometry(), SE2(*result.truth[0]), []
    for scan, true in zip(result.scans, result.truth, strict=True):
        if (scan.stamp - result.scans[0].stamp) % (3 * SECOND) < 2 * SECOND:
            off.append(error(odometry.process(scan), start.inverse() @ SE2(*true))[1])
    assert math.degrees(max(off)) < 15.0


@pytest.mark.long
@pytest.mark.parametrize('jitter, pace, longer', [(0.05, 1.0, 1.0), (0.0, 0.5, 1.0), (0.0, 1.0, 2.0)])
def test_stamps_by_which_scans_overlap_lead_no_spinning_lidar_astray(jitter, pace, longer):
    """Stamps with jitter, a slow clock, a stated scan duration of twice the true one."""
    world, lidar = rooms(1), LIDARS['rplidar_a']
    result = simulate(world, follow(world.tour[:5], turn_rate=1.2), lidar, seed=1)
    late = np.random.default_rng(1).uniform(-jitter, jitter, len(result.scans))
    stamps = result.stamps[0] + pace * (result.stamps - result.stamps[0]) + 1e9 * late
    odometry, start = Odometry(), SE2(*result.truth[0])
    for scan, stamp, true in zip(result.scans, stamps, result.truth, strict=True):
        update = odometry.process(dataclasses.replace(scan, stamp=int(stamp),
                                                      time_increment=longer * lidar.time_increment))
        assert update.status is Status.OK
        distance, angle = error(update, start.inverse() @ SE2(*true))
        assert distance < 0.15
        assert angle < 0.045


def twist_errors(path, scans, choices):
    """Errors and standard deviations of the twists, of (scan, sensor) pairs of which most are dropped at random.

    Against the mean velocities between the middles of the scans.
    """
    rng, kept = np.random.default_rng(1), [0]
    while kept[-1] + max(choices) + 1 < len(scans):
        kept.append(kept[-1] + int(rng.choice(choices)))
    odometry, off, sigmas, scans = Odometry(), [], [], [scans[index] for index in kept]
    middles = np.array([1e-9 * (scan.stamp - scans[0][0].stamp) + 0.5 * scan.duration for scan, _ in scans])
    poses = [SE2.from_array(pose) for pose in path.poses_at(middles)]
    for number, (scan, sensor) in enumerate(scans):
        update = odometry.process(scan, sensor=sensor)
        if number > 1:
            true = (poses[number - 1].inverse() @ poses[number]).as_array() / (middles[number] - middles[number - 1])
            off.append(np.abs(update.twist - true))
            sigmas.append(np.sqrt(update.twist_covariance.diagonal()))
    return np.array(off), np.array(sigmas)


def test_twists_are_right_where_scans_are_dropped_at_random():
    """Even where scans are 0.04 to 1.5 s apart."""
    world, lidar = rooms(0), PRESETS['omron_os32c']
    path = follow(world.tour).until(75.0)
    scans = simulate(world, path, lidar, seed=0).scans
    off, sigmas = twist_errors(path, [(scan, FIRST) for scan in scans], [1, 10, 12, 15, 20, 25, 37])
    assert ((np.hypot(off[:, 0], off[:, 1]) > 0.3) | (off[:, 2] > 0.4)).mean() <= 0.02
    assert (off < 5.0 * sigmas).all()


@pytest.mark.long
def test_twists_are_right_where_scans_of_two_lidars_are_dropped_at_random():
    """Two opposite lidars in one queue: scans are 0.01 to 1.5 s apart, those of one lidar up to 4 s."""
    world, front, rear = rooms(0), PRESETS['omron_os32c'], Sensor('rear', SE2(-0.6, 0.1, math.pi))
    path, behind = follow(world.tour).until(45.0), dataclasses.replace(front, mounting=rear.pose, phase=0.013)
    scans = [(scan, sensor) for sensor, lidar, seed in ((FIRST, front, 0), (rear, behind, 100))
             for scan in simulate(world, path, lidar, seed).scans]
    off, sigmas = twist_errors(path, sorted(scans, key=lambda each: each[0].stamp),
                               [1, 2, 10, 12, 15, 20, 25, 37, 50, 75])
    assert ((np.hypot(off[:, 0], off[:, 1]) > 0.3) | (off[:, 2] > 0.4)).mean() <= 0.02
    assert (off[3:] < 5.0 * sigmas[3:]).all(), 'the robot accelerates at first'


def test_wheels_that_lost_ticks_do_not_win_against_the_scans(cases):
    """A car whose computer stalls for 0.43 s: by the wheels it drove 0.3 m, by the scans and before and after 1.3 m."""
    recording = open_recording(cases / 'wheels_lost' / 'ual_wheels_gap.bag')
    odometry = replay_odometry(NodeParameters(), [], recording.topic, Mounting(),
                               RecordedMotion(recording.wheel_odometry()))
    trajectory = Trajectory()
    updates = list(trajectory.follow(recording.scans(), odometry))
    assert trajectory.statuses.count(Status.OK) >= 104
    assert trajectory.measures(10.0)['driven_m'] == pytest.approx(18.4, abs=0.3)
    worst = max(updates, key=lambda update: update.contradicted_by)
    assert worst.interval == pytest.approx(0.43, abs=0.01)
    assert worst.contradicted_by == pytest.approx(1.0, abs=0.1)
    (_, warning), = describe_contradictions(trajectory)
    assert f'x {worst.pose.x:.2f} m' in warning


@pytest.mark.long
@pytest.mark.parametrize(('asked', 'fewest', 'most'), [(0.0, 2, 18), (10.0, 0, 0)])
def test_after_weak_predictions_few_points_are_not_called_ok_in_a_corridor(data, asked, fewest, most):
    """Eighteen scans of ACES, 0.8 m and 1 s apart, a few of which are registered to the wrong door."""
    recording = open_recording(data / 'aces' / 'aces.log.gz')
    truth, kept = [SE2.from_array(pose) for pose in recording.truth()[1]], [0]
    for number, pose in enumerate(truth):
        motion = truth[kept[-1]].inverse() @ pose
        if math.hypot(motion.x, motion.y) >= 0.8 or abs(motion.theta) >= math.radians(24.0):
            kept.append(number)
    odometry, wrong = Odometry(Parameters().replace({'advanced.decision.weak_prior_information': asked})), 0
    scans, kept = list(recording.scans()), kept[285:303]
    for count, (last, number) in enumerate(itertools.pairwise([kept[0], *kept])):
        update = odometry.process(dataclasses.replace(scans[number], stamp=count * SECOND))
        off = (truth[last].inverse() @ truth[number]).inverse() @ update.increment
        wrong += update.status is Status.OK and math.hypot(off.x, off.y) > 0.15
    assert fewest <= wrong <= most


NOISY = {'lds, 3.5 %': dataclasses.replace(LIDARS['lds'], noise_ratio=0.035),
         '5 cm': Lidar(360, -math.pi, math.radians(1.0), noise=0.05)}


@pytest.mark.long
@pytest.mark.parametrize(('lidar', 'least'), [(lidar, 0.95 if name == '5 cm' else 1.0) for name,
                                              lidar in (LIDARS | NOISY).items()],
                         ids=[*LIDARS, *NOISY])
def test_in_a_bare_corridor_the_degenerate_direction_is_reported_for_every_lidar(lidar, least):
    """Both ends are out of range; large noise between two beams may constrain the direction by chance."""
    world = dataclasses.replace(corridor(length=60.0, doors=0), tour=np.array([(15.0, 0.0), (20.0, 0.0)]))
    drive = simulate(world, follow(world.tour), dataclasses.replace(lidar, range_max=min(lidar.range_max, 12.0)),
                     seed=0)
    odometry = Odometry()
    updates = [odometry.process(scan) for scan in drive.scans][1:]
    along = [update.reference_pose.theta + update.registration.degenerate_direction for update in updates
             if update.registration.degenerate_direction is not None]
    assert len(updates) > 20 and len(along) >= least * len(updates)
    assert np.abs(np.sin(along)).max() < math.sin(math.radians(10.0))
    assert sum(update.status is Status.OK for update in updates) <= (1.0 - least) * len(updates)


@pytest.mark.long
@pytest.mark.parametrize('seed', [0, 1])
def test_in_a_curved_corridor_the_covariance_contains_the_error_along_the_arc(seed):
    """The motion along it is a rotation about the centre of the curve, which no scan constrains."""
    course, = curved(seeds=(seed,))
    odometry, start = Odometry(), SE2.from_array(course.reference[0])
    for scan, true in zip(course.scans[:60], course.reference, strict=False):
        update = odometry.process(scan)
        off, sigma = (start.inverse() @ SE2.from_array(true)).as_array() - update.pose.as_array(), update.covariance
        assert (np.abs(off) < 3.0 * np.sqrt(sigma.diagonal())).all()


@pytest.mark.long
def test_a_speed_that_no_scan_holds_goes_on():
    """A lidar that sees 4 m of a corridor, and a door now and then: noise would bias the distance by a sixth."""
    world = corridor(seed=2)
    result = simulate(world, follow(world.tour), LIDARS['hokuyo_urg04lx'], seed=2)
    odometry, half = Odometry(), len(result.scans) // 2
    for scan in result.scans[:half]:
        update = odometry.process(scan)
    truth = SE2.from_array(result.truth[0]).inverse() @ SE2.from_array(result.truth[half - 1])
    assert abs((truth.inverse() @ update.pose).x) < 0.08 * truth.x


@pytest.mark.parametrize('name', ['rplidar_s'])
def test_in_a_corridor_without_features_the_prior_decides(name):
    """The noise of the walls' normals is no motion along them."""
    world = dataclasses.replace(corridor(length=60.0, doors=0), tour=np.array([(15.0, 0.0), (19.0, 0.0)]))
    drive = simulate(world, follow(world.tour), dataclasses.replace(LIDARS[name], range_max=12.0), seed=0)
    truth = [SE2.from_array(pose) for pose in drive.truth]
    odometry, spread = Odometry(), np.diag([0.02, 0.02, 0.01]) ** 2
    odometry.process(drive.scans[0])
    for scan, last, true in zip(drive.scans[1:], truth, truth[1:]):
        update = odometry.process(scan, Prior(last.inverse() @ true, spread))
    way = truth[0].inverse() @ truth[-1]
    assert way.x > 3.9 and abs(update.pose.x - way.x) < 0.05 * way.x


@pytest.mark.long
def test_along_a_smooth_corridor_the_covariance_says_how_far_the_pose_may_be_off():
    """The sensor starts at rest; no measurement shows that it drives away."""
    recording = simulate(dataclasses.replace(corridor(60.0, doors=0), tour=np.array([(15.0, 0.0), (45.0, 0.0)])),
                         follow([(15.0, 0.0), (30.0, 0.0)]), Lidar(range_max=10.0), seed=2)
    odometry, start = Odometry(), SE2.from_array(recording.truth[0])
    for k, (scan, truth) in enumerate(zip(recording.scans, recording.truth, strict=True)):
        update, pose = odometry.process(scan), start.inverse() @ SE2.from_array(truth)
        speed = 10.0 * (truth - recording.truth[k - 1])[0] if k else 0.0
        assert abs(update.pose.x - pose.x) < 3.0 * math.sqrt(update.covariance[0, 0])
        assert abs(update.twist[0] - speed) < 3.0 * math.sqrt(update.twist_covariance[0, 0])
    assert update.status is Status.DEGENERATE
    assert abs(update.pose.x - pose.x) > 5.0
    assert abs(update.pose.y - pose.y) < 0.05
    assert math.sqrt(update.covariance[2, 2]) < 0.01


@pytest.mark.parametrize('lidar', [Lidar(), LIDARS['hokuyo_utm30lx']], ids=['plain', 'utm30lx'])
def test_in_the_centre_of_a_circular_room_the_heading_is_reported_unobservable(lidar):
    world = World(outline(as_vectors(6.0 * np.exp(2j * math.pi / 180 * np.arange(180)))), np.zeros((1, 2)))
    rng = np.random.default_rng(4)
    odometry, lidar = Odometry(), dataclasses.replace(lidar, duration=0.0)
    updates = [odometry.process(measure(world, np.array([(0.0, 0.0, 0.05 * k)]), lidar, rng, k * TENTH))
               for k in range(1, 30)]
    unsure = [update.registration.rotation_unobservable for update in updates[1:]]
    assert np.mean(unsure) > 0.9
    assert Status.OK not in {update.status for update in updates[1:] if update.registration.rotation_unobservable}
    assert max(math.hypot(update.pose.x, update.pose.y) for update in updates) < 0.1
    for k, update in enumerate(updates):
        assert abs(update.pose.theta - 0.05 * k) < 3.0 * math.sqrt(update.covariance[2, 2])


@pytest.mark.parametrize('name', ['plain'])
def test_in_a_circular_room_translation_and_rotation_follow_the_prior(name):
    """9.4 m around its middle, 1.5 m off it: any way along the wall is free, with its turn."""
    spread = np.diag((0.02, 0.02, 0.03)) ** 2
    update = around_a_circular_room(LIDARS.get(name, Lidar()), lambda motion, expected: Prior(motion, spread))
    distance, turn = error(update, SE2())
    assert distance < 0.94 and turn < 0.63
    assert turn < 3.0 * math.sqrt(update.covariance[2, 2])


def test_in_a_circular_room_a_gyroscope_gives_the_motion_along_the_wall():
    """By the rotation and the wall on one side, against the constant velocity straight ahead."""
    update = around_a_circular_room(LIDARS['rplidar_s'], lambda motion,
                                    expected: expected and expected.with_rotation(motion.theta, 0.01))
    distance, turn = error(update, SE2())
    assert distance < 0.94 and turn < 0.63


def around_a_circular_room(lidar, prior_of):
    """Update of the last of 120 scans; the prior of each is ``prior_of(motion, predicted)``."""
    world = World(outline(as_vectors(3.0 * np.exp(2j * math.pi / 180 * np.arange(180)))), np.zeros((1, 2)))
    rng, lidar = np.random.default_rng(1), dataclasses.replace(lidar, duration=0.0)
    angles = np.linspace(0.0, 2.0 * math.pi, 120)
    poses = [SE2(1.5 * math.cos(angle), 1.5 * math.sin(angle), angle + 0.5 * math.pi) for angle in angles]
    odometry, before = Odometry(), poses[0]
    for k, pose in enumerate(poses):
        prior = prior_of(before.inverse() @ pose, odometry.predict_motion(k * TENTH))
        update, before = odometry.process(measure(world, pose.as_array()[None], lidar, rng, k * TENTH), prior), pose
    return update


def test_a_lidar_that_loses_four_beams_of_five_is_followed():
    world = rooms(seed=1)
    recording = simulate(world, follow(world.tour[:4]),
                         Lidar(beams=720, angle_min=-math.pi, angle_increment=math.radians(0.5),
                               range_max=12.0, dropouts=0.8), seed=1)
    odometry = Odometry()
    for scan in recording.scans:
        update = odometry.process(scan)
    start, end = (SE2.from_array(recording.truth[k]) for k in (0, -1))
    distance, turn = error(update, start.inverse() @ end)
    assert distance < 0.05 and turn < 0.01


@pytest.mark.long
def test_after_gaps_in_symmetric_corridors_the_heading_is_kept(data):
    """Key frames a metre apart, with two to four seconds between them, along corridors that look the same both ways."""
    recording = open_recording(data / 'aces' / 'aces.log.gz')
    truth, odometry, off = recording.truth()[1], Odometry(), []
    for scan, (_, _, theta) in zip(recording.scans(), truth[:60], strict=False):
        update = odometry.process(scan)
        off.append(math.remainder(update.pose.theta - theta + truth[0, 2], 2.0 * math.pi))
    assert np.degrees(np.abs(off).max()) < 5.0
