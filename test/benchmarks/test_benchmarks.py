# SPDX-License-Identifier: Apache-2.0
"""The benchmarks: known facts about the recordings, moved scans, measures and bounds."""
import dataclasses
import json
import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks import __main__ as bench
from benchmarks import cost
from benchmarks.__main__ import main
from benchmarks.bounds import Bound, at_least, at_most
from benchmarks.lidars import several, silent, wrong
from benchmarks.odometry import courses, drift
from benchmarks.odometry.course import Course
from benchmarks.odometry.drift import drive
from benchmarks.registration import pairs, relations, speed, synthetic
from benchmarks.registration.covariance import calibration
from benchmarks.report import Report
from benchmarks.sensors import measure
from benchmarks.trials import Outcome, Trial, summarise

from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.registration.records import Prior, Status
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.evaluation.methods import FACTORIES, BenchmarkError, method
from dbscan_reg_ros.evaluation.trackers import PRIORS, Step
from dbscan_reg_ros.recordings import read_csv
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import Lidar, Path, follow, rooms, simulate


def arguments(data, **changes):
    values = {'data': str(data), 'method': None, 'limit': None, 'verbose': False, 'course': None, 'prior': 'none',
              'poses': None, 'benchmark': 'test', 'copies': None, 'processes': None, 'against': None, 'calls': False,
              'honesty': False, 'seeds': None}
    return SimpleNamespace(**(values | changes))


def trial(group='pairs_s1', truth=SE2()):
    scan = Scan(0, np.ones(10), ScanGeometry(0.0, 0.1, 10))
    return Trial(group, '', scan, scan, truth)


def test_pairs_are_those_of_the_file_and_identity_and_icp_do_as_published(data):
    rows = pairs.measure(arguments(data, method=['identity', 'icp'])).metrics
    for name, percents in (('identity', (73, 7, 0.5, 0, 0)), ('icp', (93, 84, 70, 53, 24))):
        found = [100.0 * rows[name][f'pairs_s{s}'] for s in (1, 2, 5, 10, 20)]
        np.testing.assert_allclose(found, percents, atol=3.0)
    assert rows['icp']['median_m'] == pytest.approx(0.025, abs=0.003)


def test_gicp_does_as_published(data):
    pytest.importorskip('small_gicp')
    row = pairs.measure(arguments(data, method=['small_gicp'], limit=60)).metrics['small_gicp']
    assert row['pairs_s1'] >= 0.98
    assert row['pairs_s20'] == pytest.approx(0.62, abs=0.1)
    assert row['median_m'] == pytest.approx(0.0033, abs=0.001)


def test_673_relations_join_neighbours_and_357_close_loops(intel_log):
    groups = [item.group for item in relations.trials(intel_log)]
    assert groups.count('relations_neighbour') == 673
    assert groups.count('relations_loop') == 357


def test_a_scan_shares_all_of_its_view_with_itself_and_less_with_others(intel_log):
    items = relations.trials(intel_log, limit=40)
    scan = items[0].reference
    assert relations.common_view(Trial('', '', scan, scan, SE2())) == 1.0
    views = np.array([relations.common_view(item) for item in items])
    assert 0.0 <= views.min() < 0.6 < np.median(views) <= 1.0


def test_a_moved_scan_lies_on_the_reference_under_the_truth(intel_log):
    for item in synthetic.trials(intel_log, limit=10):
        if item.group.endswith('_0'):
            there = item.current.valid & item.reference.valid
            assert there.sum() > 150
            moved = item.truth.apply(item.current.points[there])
            distance = np.linalg.norm(moved - item.reference.points[there], axis=1)
            assert distance.max() < 0.06
            assert distance.std() < 0.01


def test_noise_and_outliers_of_moved_scans_are_those_asked_for(intel_log):
    rng = np.random.default_rng(0)
    errors, wild = [], []
    for scan in intel_log.scans[:2000:10]:
        ranges = synthetic.disturbed(scan, 0.01, 0.3, rng)
        error = ranges[scan.valid] - scan.ranges[scan.valid]
        wild.append((np.abs(error) > 0.06).mean())
        errors.append(error[np.abs(error) < 0.06])
        assert ranges[np.isfinite(ranges) & ~scan.valid].max(initial=0.0) <= 10.0
    assert np.mean(wild) == pytest.approx(0.29, abs=0.02)
    assert np.concatenate(errors).std() == pytest.approx(0.0105, abs=0.001)


def test_moved_scans_are_1800_always_the_same_and_within_their_limits(intel_log):
    first, again = synthetic.trials(intel_log, limit=5), synthetic.trials(intel_log, limit=5)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.current.ranges, b.current.ranges)
        assert a.truth == b.truth
    items = synthetic.trials(intel_log)
    assert len(items) == 1800
    assert all(np.count_nonzero(item.reference.valid) > 150 for item in items)
    limits = {'random': (1.5, 0.5), 'any': (2.5, math.pi)}
    for kind, (translation, rotation) in limits.items():
        truths = np.array([item.truth.as_array() for item in items if item.group.startswith(kind)])
        assert np.abs(truths[:, :2]).max() <= translation and np.abs(truths[:, 2]).max() <= rotation
    assert {item.truth for item in items if item.group.startswith('paper')} == {SE2(-1.5, 0.8, 0.3)}


def test_success_is_10_cm_and_2_deg():
    def success(metres, degrees):
        return Outcome(trial(), SE2(), Status.OK, metres, math.radians(degrees), 0.0).success

    assert success(0.099, 1.99)
    assert not success(0.101, 0.0)
    assert not success(0.0, 2.01)


def test_precision_and_recall_count_what_is_called_ok():
    def outcome(right, status):
        return Outcome(trial(), SE2(), status, 0.01 if right else 1.0, 0.0, 0.002)

    metrics = summarise([outcome(True, Status.OK)] * 6 + [outcome(False, Status.OK)] * 2
                        + [outcome(True, Status.DEGENERATE)] * 2 + [outcome(False, Status.FAILED)] * 3)
    assert metrics['pairs_s1'] == pytest.approx(8 / 13)
    assert metrics['ok_precision'] == pytest.approx(6 / 8)
    assert metrics['ok_recall'] == pytest.approx(6 / 8)
    assert metrics['median_m'] == pytest.approx(0.01)
    assert metrics['ms_p50'] == pytest.approx(2.0)


def test_ours_is_right_and_sure_where_the_motion_is_small(data):
    row = pairs.measure(arguments(data, method=['dbscan'], limit=12)).metrics['dbscan']
    assert row['pairs_s1'] >= 0.9 and row['pairs_s2'] >= 0.9
    assert row['median_m'] < 0.01


@pytest.mark.parametrize('bound, inside, outside, words', [
    (at_least(0.9), 0.9, 0.89, 'at least 0.9'),
    (at_most(2.8), 2.8, 2.81, 'at most 2.8'),
    (Bound(0.9, 0.98), 0.95, 0.99, '0.9 to 0.98'),
])
def test_a_bound_holds_inside_and_never_for_what_was_not_measured(bound, inside, outside, words):
    assert bound.holds(inside)
    assert not bound.holds(outside)
    assert not bound.holds(math.nan)
    assert str(bound) == words


def test_only_ours_is_held_to_the_bounds():
    report = Report()
    report.add('speed', {'dbscan': {'ms_p50': 3.0}, 'icp': {'ms_p50': 9.0}}, {'ms_p50': at_most(2.8)}, prefix='x_')
    assert report.missed == ['x_ms_p50 = 3, expected at most 2.8']
    assert report.metrics == {'dbscan': {'x_ms_p50': 3.0}, 'icp': {'x_ms_p50': 9.0}}


def test_speed_is_measured_on_both_recordings_and_held_to_its_bounds(data, monkeypatch):
    asked = arguments(data, method=['dbscan', 'identity'], limit=2)
    monkeypatch.setattr(speed, 'BOUNDS', {name: at_most(0.0) for name in speed.BOUNDS})
    slow = speed.measure(asked)
    for row in slow.metrics.values():
        assert set(row) == {'ms_p50', 'ms_p95', 'ms_p50_1141'}
        assert row['ms_p95'] >= row['ms_p50'] > 0.0
    assert [line.split(' = ')[0] for line in slow.missed] == ['ms_p50', 'ms_p95', 'ms_p50_1141']
    monkeypatch.setattr(speed, 'BOUNDS', {name: at_most(math.inf) for name in speed.BOUNDS})
    assert not speed.measure(asked).missed


def test_speed_beside_gicp_is_a_ratio(data):
    pytest.importorskip('small_gicp')
    rows = speed.measure(arguments(data, limit=2)).metrics
    assert set(rows) == set(speed.METHODS)
    assert rows['dbscan']['ratio_gicp'] == rows['dbscan']['ms_p50'] / rows['small_gicp']['ms_p50']
    assert rows['small_gicp']['ratio_gicp'] == 1.0


def test_calls_of_a_tracked_scan_are_counted(data, monkeypatch):
    monkeypatch.setattr(cost, 'FIRST', 3)
    monkeypatch.setattr(cost, 'LAST', 5)
    row = speed.measure(arguments(data, calls=True)).metrics['dbscan']
    assert 0 < row['objects_count'] < row['functions_count'] <= row['calls_count']


def test_fine_scans_have_1141_beams_and_are_moved_by_a_known_motion(data):
    for item in speed.fine_trials(data, limit=2):
        assert item.reference.geometry.size == item.current.geometry.size == 1141
        assert max(abs(item.truth.x), abs(item.truth.y)) <= 1.5 and abs(item.truth.theta) <= 0.5
        both = item.reference.valid & item.current.valid
        off = item.truth.apply(item.current.points[both]) - item.reference.points[both]
        assert np.median(np.abs(off)) < 0.02


def test_standing_still_scores_on_intel_as_published(data):
    row = drift.measure(arguments(data, method=['identity'], course=['intel'])).metrics['identity']
    assert row['relations'] == 1030
    assert row['frozen'] == 1.0
    assert row['relations_neighbour_mean_m'] == pytest.approx(0.30, abs=0.005)
    assert row['relations_all_mean_m'] == pytest.approx(0.49, abs=0.005)
    assert row['rpe_1m_mean_m'] == pytest.approx(0.92, abs=0.005)
    assert row['rpe_5m_mean_m'] == pytest.approx(4.1, abs=0.05)
    assert row['ate_m'] == pytest.approx(10.0, abs=0.2)


def test_a_method_without_motion_does_not_drift_at_rest(data):
    row = drift.measure(arguments(data, method=['identity'], course=['lms511'])).metrics['identity']
    assert row['lms511_drift_m'] == row['lms511_drift_deg'] == 0.0


def test_dropped_scans_are_a_fifth_and_noise_scans_do_not_count(data):
    whole, = courses.intel(data)
    fewer, = courses.dropped(data)
    noisy, = courses.noise(data)
    assert len(fewer.scans) / len(whole.scans) == pytest.approx(0.8, abs=0.02)
    assert np.all(np.diff(fewer.indices) > 0)
    np.testing.assert_array_equal(fewer.reference, whole.reference[fewer.indices])
    assert (~noisy.judged).sum() == (len(whole.scans) - 1) // 50
    assert noisy.judged[0]


def test_a_gyroscope_gives_rotations_and_wheels_motions():
    poses = [SE2()]
    for turn in np.linspace(-0.5, 0.5, 40):
        poses.append(poses[-1] @ SE2(0.2, 0.0, float(turn)))
    reference = np.array([pose.as_array() for pose in poses])
    course = courses.Course([None] * len(poses), reference=reference, wheels=reference)
    before = Prior(SE2(0.1, 0.0, 0.0), np.diag([0.3, 0.3, 0.4]) ** 2)
    first, *gyroscope = PRIORS['imu'](course)
    priors = [each(before) for each in gyroscope]
    turns = np.array([each.transform.theta for each in priors])
    assert first is None and np.abs(turns - 1.01 * np.linspace(-0.5, 0.5, 40)).max() < 0.012
    assert np.ptp(turns - 1.01 * np.linspace(-0.5, 0.5, 40)) > 0.003
    assert all(math.hypot(each.transform.x, each.transform.y) == pytest.approx(0.1) for each in priors)
    assert all(each.translation_sigma == pytest.approx(0.3) for each in priors)
    first, *wheels = PRIORS['wheel'](course)
    steps = [each(before).transform.as_array() for each in wheels]
    assert first is None and np.allclose(steps, [(0.2, 0.0, turn) for turn in np.linspace(-0.5, 0.5, 40)])
    assert PRIORS['wheel'](courses.Course([None] * 3)) == PRIORS['none'](courses.Course([None] * 3)) == [None] * 3


def test_the_person_hides_a_part_of_the_view_and_adds_no_range(data):
    whole, = courses.intel(data)
    walked, *others = (courses.strolled(whole.scans[:200], seed) for seed in courses.SEEDS)
    assert not any(np.array_equal(other[0].ranges, walked[0].ranges) for other in others)
    hidden = 0
    for before, after in zip(whole.scans[:200], walked, strict=True):
        both = before.valid & after.valid
        assert np.all(after.ranges[both] <= before.ranges[both])
        changed = both & (after.ranges < before.ranges)
        hidden += changed.sum() / len(before.ranges)
        assert np.all(after.ranges[changed] > 0.7)
    assert 0.02 < hidden / 200 < 0.3


def test_wheels_keep_the_heading_where_a_person_holds_what_little_is_seen(data):
    """A robot turns on the spot; with a person in front of it a few points also fit a pose 100 deg off."""
    whole = courses.intel(data)[0].take(slice(4300))
    walked = dataclasses.replace(whole, scans=courses.strolled(whole.scans, 11))
    for begin in (4000, 4100, 4150):
        poses = drift.drive('dbscan', walked.take(np.arange(begin, 4300)), 'Intel', 'wheel').poses
        found, true = (np.unwrap(each[:, 2]) for each in (np.asarray(poses), whole.reference[begin:]))
        assert np.degrees(np.abs(found - found[0] - true + true[0]).max()) < 10.0


def test_the_poses_written_are_those_that_count(data, tmp_path):
    path = tmp_path / 'poses.csv'
    drift.measure(arguments(data, method=['dbscan'], course=['noise'], limit=120, poses=path))
    indices, poses = read_csv(path)
    assert len(indices) == len(poses) == 118
    assert not {50, 100} & set(indices)
    assert path.read_text().startswith('index,x,y,theta,ms\n')


def test_in_a_smooth_corridor_the_axis_is_what_counts_as_named(data):
    course = courses.featureless(data)[0]
    drive = drift.Drive(course)
    for pose in course.reference:
        step = SE2.from_array(course.reference[0]).inverse() @ SE2.from_array(pose)
        drive.steps.append(Step(step, Status.DEGENERATE, math.pi))
        drive.milliseconds.append(1.0)
    metrics = drift.judge(drive)
    assert metrics['named'] == 1.0
    assert metrics['across_m'] < 1e-9
    assert metrics['ok'] == 0.0


def test_right_covariances_are_called_right_and_others_not():
    rng = np.random.default_rng(0)
    root = np.diag((0.01, 0.02, 0.003)) @ np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [-0.3, 0.2, 1.0]])
    errors = rng.normal(size=(4000, 3)) @ root.T
    right = calibration([(error, root @ root.T) for error in errors])
    assert right['within'] == pytest.approx(0.95, abs=0.01)
    assert right['nees'] == pytest.approx(1.0, abs=0.05)
    assert right['x_spread'] == pytest.approx(1.0, abs=0.05)
    assert right['t_spread'] == pytest.approx(1.0, abs=0.05)
    assert calibration([(error, 0.25 * root @ root.T) for error in errors])['within'] < 0.6
    assert calibration([(error, 4.0 * root @ root.T) for error in errors] + [None] * 4000)['counted'] == 0.5


def test_a_run_prints_a_table_writes_json_and_ends_with_0(data, tmp_path, capsys):
    path = tmp_path / 'rates.json'
    assert main(['relations', '--data', str(data), '--method', 'icp', '--limit', '10', '--json', str(path)]) == 0
    output = capsys.readouterr().out
    assert 'numpy' in output and 'icp' in output
    metrics = json.loads(path.read_text())
    assert {'relations_neighbour', 'relations_loop', 'median_m', 'median_deg', 'ok_precision', 'ok_recall',
            'view_70_100'} <= set(metrics['icp'])


@pytest.mark.parametrize('words, message', [
    (['pairs', '--method', 'guessing'], "unknown method 'guessing'"),
    (['odometry', '--course', 'moon'], "unknown course 'moon'"),
    (['odometry', '--limit', '1'], '--limit 1: a drive of one scan'),
])
def test_unknown_names_are_reported_in_one_line(data, capsys, words, message):
    assert main([*words, '--data', str(data)]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_the_help_names_every_method_and_course():
    assert list(bench.METHODS) == list(FACTORIES) and list(bench.COURSES) == list(courses.COURSES)


def test_a_limit_of_nothing_is_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        main(['odometry', '--limit', '0'])
    assert stop.value.code == 2 and "'0': expected a whole number above 0" in capsys.readouterr().err


def test_missing_data_are_reported_in_one_line(tmp_path, capsys):
    assert main(['pairs', '--method', 'identity', '--data', str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert 'pairs.csv' in error and error.count('\n') == 1


def test_verbose_lists_every_failure(data, capsys):
    main(['pairs', '--data', str(data), '--method', 'identity', '--limit', '5', '--verbose'])
    lines = [line for line in capsys.readouterr().out.splitlines() if 'WRONG' in line]
    assert 15 <= len(lines) <= 25
    assert all('pairs_s' in line and 'deg' in line for line in lines)


@pytest.mark.parametrize('words', [*([name, '--method', 'icp'] for name in ('node', 'soak', 'silent', 'covariance')),
                                   *([name, '--data', '.'] for name in ('node', 'soak', 'covariance'))])
def test_what_a_benchmark_would_ignore_is_refused(words, capsys):
    with pytest.raises(SystemExit, match='2'):
        main([*words, '--limit', '1'])
    assert f'unrecognized arguments: {words[1]} {words[2]}' in capsys.readouterr().err


def test_the_file_of_a_lidar_is_compared_with_the_defaults_and_all_other_files(tmp_path, capsys):
    path = tmp_path / 'figures.json'
    status = main(['sensors', '--sensor', 'lds_01', '--seeds', '1', '--seconds', '5', '--limit', '22', '--processes',
                   '1', '--json', str(path)])
    figures = json.loads(path.read_text())['dbscan']
    assert figures['lds_01_drives_count'] == 3 and status == ('missed' in capsys.readouterr().out)
    own, defaults, certain, best = (figures[f'lds_01_{name}_m'] for name in ('rpe_1m', 'defaults', 'certain', 'best'))
    # The driver of this lidar reverses the beams, which only some files know.
    assert best <= certain and own < 0.8 * defaults
    assert figures['lds_01_ratio_defaults'] == pytest.approx(own / defaults)
    assert figures['lds_01_ratio_best'] == pytest.approx(certain / best)
    with pytest.raises(BenchmarkError, match='absent: expected hokuyo_urg04lx, '):
        measure(SimpleNamespace(sensor=['absent']))


def test_the_script_runs_with_the_chosen_python(root, data):
    done = subprocess.run([root / 'scripts' / 'bench', 'pairs', '--data', data, '--method', 'identity', '--limit', '2'],
                          env={'PYTHON': sys.executable, 'PATH': '/usr/bin:/bin'}, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stderr
    assert 'identity' in done.stdout


def test_every_method_answers_with_a_transform_and_a_status(intel_log):
    item = pairs.trials(intel_log, limit=1)[0]
    for name in ('dbscan', 'icp', 'idc', 'icl', 'identity'):
        result = method(name)(item.reference, item.current)
        assert isinstance(result.transform, SE2) and isinstance(result.status, Status)


def test_the_second_scanner_is_used_besides_the_first_and_by_our_odometry_alone():
    """Two seconds of a course: the poses are those of the front scanner, and differ from those that it finds alone."""
    world = rooms(seed=1)
    path = follow(world.tour)
    path = Path(path.times[path.times < 2.0], path.poses[path.times < 2.0])
    front, rear = (simulate(world, path, Lidar(271, math.radians(-135.0), math.radians(1.0), rate=rate, mounting=at,
                                               phase=phase), seed)
                   for seed, (rate, at, phase) in enumerate(((12.5, courses.FRONT, 0.0), (15.0, courses.REAR, 0.019))))
    alone = Course(front.scans, reference=front.truth)
    both = dataclasses.replace(alone, others=((Sensor('rear', courses.FRONT.inverse() @ courses.REAR), rear.scans),))
    found, other = drive('dbscan', both, 'both'), drive('dbscan', alone, 'alone')
    assert found.poses.shape == other.poses.shape == (len(front.scans), 3)
    assert not np.allclose(found.poses, other.poses, atol=1e-5)
    off = found.poses - relative(front.truth[:1], front.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.02
    with pytest.raises(BenchmarkError, match='several lidars take no other method than dbscan'):
        drive('small_gicp', both, 'both')


def test_a_merged_scan_has_the_nearest_return_of_both_scanners():
    """At rest and without noise: in each beam one of the returns, at most half a beam from its middle."""
    lidars = [Lidar(271, math.radians(-135.0), math.radians(1.0), noise=0.0, mounting=at)
              for at in (courses.FRONT, courses.REAR)]
    world = rooms(seed=1)
    path = Path(np.array([0.0, 0.1]), np.tile(follow(world.tour).poses[0], (2, 1)))
    front, rear = (simulate(world, path, lidar, 0).scans[0] for lidar in lidars)
    whole = courses.merged(front, rear)
    points = np.concatenate([at.apply(scan.points[scan.valid])
                             for at, scan in ((courses.FRONT, front), (courses.REAR, rear))])
    ranges, bearings = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
    assert 271 < whole.valid.sum() <= len(points)
    for k in np.flatnonzero(whole.valid):
        near = np.abs(wrap(bearings - whole.geometry.bearings[k])) <= math.radians(0.25) + 1e-9
        assert whole.ranges[k] == pytest.approx(ranges[near].min(), abs=1e-6)


def test_own_body_and_cross_talk_change_the_scans_of_both_lidars_only_where_they_are(monkeypatch):
    monkeypatch.setattr(several, 'SECONDS', 2.0)
    plain, body, talk = (several.seen_by(2, 'rooms', 1, **changes)
                         for changes in ({}, *several.DISTURBED.values()))
    masked = several.masked(plain)
    for pick in (lambda course: course.scans, lambda course: course.others[0][1]):
        ranges, own, wild, left = (np.array([scan.ranges for scan in pick(each)])
                                   for each in (plain, body, talk, masked))
        bearings = np.degrees(pick(plain)[0].geometry.bearings)
        # The beams at the ends of the sector may be in it or not.
        inside, outside = np.abs(bearings - 110.0) < 9.9, np.abs(bearings - 110.0) > 10.1
        assert len(ranges) > 20 and inside.sum() == 39 and outside.sum() == 500
        for others in (own, left):
            assert np.array_equal(ranges[:, outside], others[:, outside])
        assert np.abs(own[:, inside] - 0.3).max() < 0.06 and np.isnan(left[:, inside]).all()
        assert 0.005 < np.mean(wild != ranges) < 0.015


def test_the_named_table_of_lidars_compares_the_same_drives(monkeypatch):
    monkeypatch.setattr(several, 'SECONDS', 8.0)
    monkeypatch.setattr(several, 'KINDS', {'hall': several.KINDS['hall']})
    report = wrong.measure(SimpleNamespace(only=['body'], seeds=2, limit=None, processes=1))
    assert len(report.tables) == 1
    row = report.metrics['dbscan']
    for name in ('body', 'masked', 'talk'):
        assert 0.0 < row[f'all_{name}_m'] < 0.01
        assert row[f'all_ratio_{name}'] == pytest.approx(row[f'all_{name}_m'] / row['all_without_m'])
        assert 0.0 < row[f'hall_ratio_{name}_error'] < 1.0


@pytest.mark.parametrize('rank', silent.CASES.values(), ids=silent.CASES)
def test_the_other_lidar_goes_on_while_one_is_silent(rank):
    figures = silent.judged('hall', 0, rank, 80)
    assert figures.keys() == silent.BOUNDS.keys() and all(figures.values())
    assert all(bound.holds(figures[name]) for name, bound in silent.BOUNDS.items())


def test_the_error_of_a_ratio_is_the_scatter_of_ratios_of_other_drives():
    rng = np.random.default_rng(0)
    others = rng.gamma(4.0, 1.0, (2000, 25))
    values = 1.2 * others + rng.normal(0.0, 0.5, others.shape)
    ratios, found = np.transpose([several.ratio_of_means(*pair) for pair in zip(values, others, strict=True)])
    assert ratios.mean() == pytest.approx(1.2, abs=0.005)
    assert found.mean() == pytest.approx(ratios.std(), rel=0.1)
    assert several.ratio_of_means(2.0 * others[0], others[0]) == (2.0, 0.0)
    assert math.isnan(several.ratio_of_means(values[0, :1], others[0, :1])[1])


def test_three_lidars_drive_with_all_their_scans(monkeypatch):
    monkeypatch.setattr(several, 'SECONDS', 2.0)
    three = several.seen_by(3, 'hall', 1)
    assert [sensor.rank for sensor, _ in three.others] == [1, 2]
    error, seconds, count = several.followed(three.take(slice(10)))
    last = three.scans[9].stamp
    assert count == 10 + sum(scan.stamp < last for _, scans in three.others for scan in scans) > 25
    assert seconds > 0.0 and math.isnan(error)
