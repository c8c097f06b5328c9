# SPDX-License-Identifier: Apache-2.0
"""Several lidars in one odometry."""
import dataclasses
import heapq
import math
import re

import numpy as np
import pytest

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.registration.records import Prior, Status
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.simulation import Lidar, Path, follow, rooms, simulate

FRONT, REAR = SE2(0.35, 0.25, math.radians(45.0)), SE2(-0.35, -0.25, math.radians(-135.0))
FRONT_SENSOR, REAR_SENSOR = Sensor('front'), Sensor('rear', FRONT.inverse() @ REAR)
RANKED = {'front': FRONT_SENSOR, 'rear': Sensor('rear', REAR_SENSOR.pose, 1)}
SECONDS = 6.0


def scanner(name, mounting, rate, phase):
    """A safety scanner: 270 deg, its scan takes three quarters of its period."""
    return Lidar(361, math.radians(-135.0), math.radians(0.75), 0.05, 25.0, rate, duration=0.75 / rate,
                 mounting=mounting, phase=phase, frame_id=name)


def two_lidars(seed, seconds, noise=(0.01, 0.01), rest=0.0):
    """Simulate the front and the rear lidar on a drive that begins with a `rest` [s]."""
    world = rooms(seed)
    path = follow(world.tour[:4], speed=1.0, pauses={0: rest})
    path = Path(path.times[path.times < seconds], path.poses[path.times < seconds])
    front, rear = scanner('front', FRONT, 12.5, 0.0), scanner('rear', REAR, 15.0, 0.019)
    return tuple(simulate(world, path, dataclasses.replace(lidar, noise=each), number)
                 for lidar, each, number in zip((front, rear), noise, (seed, seed + 9), strict=True))


def in_order(front, rear):
    """Return the scans of both lidars in the order of their stamps."""
    return list(heapq.merge(front.scans, rear.scans, key=lambda scan: scan.stamp))


def truth_of(front):
    """Return the truth of the front lidar by its stamp."""
    return dict(zip(front.stamps.tolist(), front.truth, strict=True))


@pytest.fixture(scope='module', params=[1, 2])
def drive(request):
    """Scans of both lidars on one drive in the order of their stamps, and the truth of the front one by its stamp."""
    front, rear = two_lidars(request.param, SECONDS)
    return in_order(front, rear), truth_of(front)


def updates_of(scans, rear=REAR_SENSOR):
    """Return the updates of both sensors, the front first."""
    odometry = Odometry()
    updates = [odometry.process(scan, None, rear if scan.frame_id == 'rear' else FRONT_SENSOR) for scan in scans]
    return tuple([update for update in updates if update.sensor.name == name] for name in ('front', 'rear'))


def true_motion(truth, first, last):
    """Return the motion between two stamps."""
    return SE2.from_array(truth[first]).inverse() @ SE2.from_array(truth[last])


def largest_error(updates, truth):
    """Return the largest distance from the true motion since the first of the `updates` [m]."""
    return max(distance(update.pose, true_motion(truth, updates[0].stamp, update.stamp)) for update in updates)


def distance(one, other):
    """Return the distance of two poses [m]."""
    return math.hypot(one.x - other.x, one.y - other.y)


def test_two_lidars_follow_the_frame_of_the_first(drive):
    scans, truth = drive
    front, rear = updates_of(scans)
    assert np.mean([update.status is Status.OK for update in front + rear]) > 0.95
    last = front[-1]
    moved = true_motion(truth, front[0].stamp, last.stamp)
    assert math.hypot(moved.x, moved.y) > 2.0
    assert distance(last.pose, moved) < 0.015 and abs(last.pose.theta - moved.theta) < 0.005
    # All but the first scans of the rear lidar are registered, to its own key frames.
    assert sum(update.registration is None for update in rear) <= 3
    assert all(update.reference.scan.points.shape == (361, 2) for update in rear if update.registration)
    offset = rear[-1].pose.inverse() @ rear[-1].scan_pose
    assert np.allclose(offset.as_array(), REAR_SENSOR.pose.as_array())


def test_a_lidar_with_a_wrong_mounting_joins_without_a_jump(drive):
    scans, truth = drive
    wrong = Sensor('rear', REAR_SENSOR.pose @ SE2(0.05, 0.0, math.radians(3.0)))
    front, rear = updates_of(scans, wrong)
    joined = next(update for update in rear if update.registration is None and update.is_key_frame)
    before = [update for update in front if update.stamp < joined.stamp][-1]
    moved = true_motion(truth, front[0].stamp, before.stamp)
    assert distance(before.pose, moved) < 0.01
    speed = math.hypot(*joined.twist[:2])
    assert distance(joined.pose, before.pose) < 1.2 * speed * 1e-9 * (joined.stamp - before.stamp) + 0.002


def test_either_lidar_may_stop_and_come_back():
    """Worse than the front lidar alone in no mean over three drives; one drive may be, by chance."""
    errors = {'alone': [], 'front': [], 'rear': []}
    for seed in (1, 2, 3):
        front, rear = two_lidars(seed, SECONDS)
        scans, truth = in_order(front, rear), truth_of(front)
        errors['alone'].append(largest_error(updates_of(front.scans)[0], truth))
        for silent in ('front', 'rear'):
            kept = [scan for scan in scans
                    if scan.frame_id != silent or not 2.0 < 1e-9 * (scan.stamp - scans[0].stamp) < 4.0]
            found = updates_of(kept)
            assert np.mean([update.status is Status.OK for updates in found for update in updates]) > 0.95
            errors[silent].append(largest_error(found[0], truth))
    alone, front, rear = (np.mean(each) for each in errors.values())
    assert max(front, rear) < alone, errors


def repeated(scans, frozen, begin, end):
    """Return the scans; the lidar `frozen` sends its last ranges again and again between two times [s]."""
    latest, found = {}, []
    for scan in scans:
        if scan.frame_id == frozen and begin < 1e-9 * (scan.stamp - scans[0].stamp) < end:
            scan = dataclasses.replace(scan, ranges=latest[frozen])
        latest[scan.frame_id] = scan.ranges
        found.append(scan)
    return found


@pytest.mark.parametrize('frozen', ['front', 'rear'])
def test_a_lidar_that_repeats_a_scan_while_the_robot_drives_is_not_used_until_it_sends_new_ones(frozen):
    """5 s of 11 s. Ranks as in the node: the first lidar counts as right."""
    front, rear = two_lidars(1, 11.0)
    scans = in_order(front, rear)
    undisturbed, _ = updates_of(scans, RANKED['rear'])
    odometry, found, skipped = Odometry(), [], []
    for scan in repeated(scans, frozen, 3.0, 8.0):
        try:
            found.append(odometry.process(scan, None, RANKED[scan.frame_id]))
        except ScanError as error:
            skipped.append((scan, str(error)))
    used = [update for update in found if not update.waits]
    assert np.mean([update.status is Status.OK for update in used]) > 0.98
    error = largest_error([update for update in used if not update.sensor.rank], truth_of(front))
    assert error < largest_error(undisturbed, truth_of(front)) + 0.02
    seconds = np.array([1e-9 * (scan.stamp - scans[0].stamp) for scan, _ in skipped])
    assert {scan.frame_id for scan, _ in skipped} == {frozen} and 3.0 < seconds[0] < 3.4 and 7.85 < seconds[-1] < 8.0
    assert re.fullmatch(r'the lidar repeats the same scan: its 361 ranges are those of [45]\.\d\d s before, but the '
                        r'robot has moved by \d\.\d\d m and \d+ deg', skipped[-1][1])
    assert {update.sensor.name for update in used[-5:]} == {'front', 'rear'}


@pytest.mark.parametrize('noise', [(0.0, 0.0), (0.0, 0.01)])
def test_lidars_that_repeat_scans_at_rest_are_not_accused(noise):
    """Without noise a lidar at rest sends equal scans: of both lidars, or of one. Then the robot drives."""
    front, rear = two_lidars(1, 7.0, noise, rest=3.0)
    odometry = Odometry()
    found = [odometry.process(scan, None, RANKED[scan.frame_id]) for scan in in_order(front, rear)]
    used = [update for update in found if not update.waits]
    assert largest_error([update for update in used if not update.sensor.rank], truth_of(front)) < 0.02
    assert {update.sensor.name for update in used[-5:]} == {'front', 'rear'}


def test_a_scan_that_comes_too_late_is_refused_and_changes_nothing(drive):
    scans, _ = drive
    odometry, other = Odometry(), Odometry()
    for scan in scans[:20]:
        sensor = REAR_SENSOR if scan.frame_id == 'rear' else FRONT_SENSOR
        odometry.process(scan, None, sensor)
        other.process(scan, None, sensor)
    late = next(scan for scan in reversed(scans[:12]) if scan.frame_id != scans[19].frame_id)
    with pytest.raises(ScanError, match='older than the last one of another sensor'):
        odometry.process(late, None, REAR_SENSOR if late.frame_id == 'rear' else FRONT_SENSOR)
    sensor = REAR_SENSOR if scans[20].frame_id == 'rear' else FRONT_SENSOR
    expected, found = other.process(scans[20], None, sensor), odometry.process(scans[20], None, sensor)
    assert found.pose == expected.pose and np.array_equal(found.covariance, expected.covariance)


def test_scans_out_of_order_are_used_at_their_own_time(drive):
    scans, truth = drive
    # Each scan of the front lidar comes after the next one of the rear lidar.
    disordered = sorted(scans, key=lambda scan: scan.stamp + 70_000_000 * (scan.frame_id == 'front'))
    assert [scan.stamp for scan in disordered] != [scan.stamp for scan in scans]
    (ordered, _), (front, rear) = updates_of(scans), updates_of(disordered)
    assert min(update.interval for update in front) < -0.01
    assert np.mean([update.status is Status.OK for update in front + rear]) > 0.95
    assert largest_error(front, truth) < 1.5 * largest_error(ordered, truth)


def test_stamps_that_go_back_restart_the_track_once(drive):
    scans, _ = drive
    front, rear = updates_of(scans[:75] + scans[:30])
    restarted = [update for update in front + rear if update.restarted]
    assert len(restarted) == 1 and 'went back' in restarted[0].restarted


def test_priors_and_covariances_are_transformed_as_the_motions_are():
    sensor, rng = Sensor('rear', SE2(-0.7, 0.4, 2.0)), np.random.default_rng(3)
    motion = SE2(0.3, -0.1, 0.4)
    root = np.diag((1e-4, 2e-4, 3e-4)) @ rng.normal(size=(3, 3))
    prior = Prior(motion, root @ root.T, root @ root.T)
    of_sensor = sensor.prior_of(prior)
    assert np.allclose((sensor.pose @ of_sensor.transform).as_array(), (motion @ sensor.pose).as_array())
    errors = [(of_sensor.transform.inverse() @ sensor.pose.inverse() @ motion @ SE2.from_array(root @ normal)
               @ sensor.pose).as_array() for normal in rng.normal(size=(20000, 3))]
    assert np.allclose(np.cov(np.transpose(errors)), of_sensor.covariance, rtol=0.05, atol=2e-9)
    back = sensor.first_prior(of_sensor)
    assert np.allclose(back.transform.as_array(), motion.as_array())
    assert np.allclose(back.covariance, prior.covariance) and np.allclose(back.velocity_change, prior.velocity_change)
    twist = np.array((0.5, -0.2, 0.7))
    step = sensor.pose.inverse() @ SE2.from_array(1e-6 * twist) @ sensor.pose
    assert np.allclose(1e6 * step.as_array(), sensor.twist_of(twist), atol=1e-5)
    assert np.allclose(sensor.first_twist(sensor.twist_of(twist)), twist)
    pose = SE2(3.0, 1.0, -2.0)
    assert np.allclose(sensor.first_at(sensor.pose_at(pose)).as_array(), pose.as_array())
