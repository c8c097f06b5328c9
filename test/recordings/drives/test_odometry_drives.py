# SPDX-License-Identifier: Apache-2.0
"""Odometry over whole simulated drives: time stamps, lost scans, corridors, circular rooms."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import outline

from dbscan_reg_ros import SE2, Prior, Status
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import as_vectors
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.sensor import FIRST
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


def test_in_a_corridor_without_features_the_prior_decides():
    """The noise of the walls' normals is no motion along them."""
    world = dataclasses.replace(corridor(length=60.0, doors=0), tour=np.array([(15.0, 0.0), (19.0, 0.0)]))
    drive = simulate(world, follow(world.tour), dataclasses.replace(LIDARS['rplidar_s'], range_max=12.0), seed=0)
    truth = [SE2.from_array(pose) for pose in drive.truth]
    odometry, spread = Odometry(), np.diag([0.02, 0.02, 0.01]) ** 2
    odometry.process(drive.scans[0])
    for scan, last, true in zip(drive.scans[1:], truth, truth[1:]):
        update = odometry.process(scan, Prior(last.inverse() @ true, spread))
    way = truth[0].inverse() @ truth[-1]
    assert way.x > 3.9 and abs(update.pose.x - way.x) < 0.05 * way.x


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


def test_in_a_circular_room_translation_and_rotation_follow_the_prior():
    """9.4 m around its middle, 1.5 m off it: any way along the wall is free, with its turn."""
    spread = np.diag((0.02, 0.02, 0.03)) ** 2
    update = around_a_circular_room(Lidar(), lambda motion, expected: Prior(motion, spread))
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
