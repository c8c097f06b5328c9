# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs from other sources: which lines are read, which poses are the truth, and the warnings."""
import gzip
import json
import math

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, RecordingError
from dbscan_reg_ros.commands.compare import main as compare
from dbscan_reg_ros.commands.convert import main as convert_command
from dbscan_reg_ros.commands.register import main as register
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.conversion import convert
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.replays.trajectory import Trajectory

DIFFER = ('the poses of the scans differ from the ODOM lines: they are used as ground truth, the ODOM lines as wheel '
          'odometry')


def write_log(path, *lines):
    path.write_text('\n'.join(lines) + '\n')
    return path


def words(pose):
    return ' '.join(f'{value:.9f}' for value in pose)


def flaser(stamp, pose=(0, 0, 0), odometry=None, kind='FLASER'):
    return f'{kind} 3 1.0 2.0 3.0 {words(pose)} {words(pose if odometry is None else odometry)} {stamp} host 0.1'


def odom(stamp, pose):
    return f'ODOM {words(pose)} 0 0 0 {stamp} host 0.1'


def robotlaser(number, stamp, kind='ROBOTLASER'):
    poses = '1 2 0.25 1 2 0.25 0.5 0.1 0.3 0.2 1e6 ' if kind == 'ROBOTLASER' else ''
    return f'{kind}{number} 0 -1.2 2.4 0.6 20.0 0.01 0 5 1.0 2.5 20.0 3.0 4.0 2 7 8 {poses}{stamp} host 3.5'


# Truth and wheels

def test_poses_of_a_corrected_log_that_differ_from_its_odom_lines_are_the_truth(cases):
    path = cases / 'carmen' / 'corrected_poses_taken_for_wheels.log'
    recording = open_recording(path)
    assert recording.notes == [DIFFER] and recording.problems == []
    lines = [line.split() for line in path.read_text().splitlines()]
    corrected = np.array([line[-9:-6] for line in lines if line and line[0] == 'FLASER'], dtype=float)
    stamps, truth = recording.truth()
    assert stamps.tolist() == recording.stamps() and (truth == corrected).all()

    stamps, wheels = recording.wheel_odometry()
    assert stamps.tolist() == recording.stamps()
    steps = relative(wheels[:-1], wheels[1:])
    expected, last, first = [], None, None
    for line in lines:
        if line and line[0] == 'ODOM':
            last = np.array([line[1:4]], dtype=float)
            first = last if first is None else first
        elif line and line[0] == 'FLASER':
            if first is not None:
                expected.append(relative(first, last)[0])
            first = None
    assert np.abs(steps - np.array(expected[-39:])).max() < 1e-9
    error = np.abs(steps - relative(truth[:-1], truth[1:])).mean(axis=0)
    assert 0.02 < error[0] < 0.03 and 0.02 < error[1] < 0.03 and 0.03 < error[2] < 0.05


@pytest.mark.parametrize(('name', 'truth', 'wheels'), [
    ('equal_stamps.log', True, True), ('negative_stamps.log', True, True),
    ('no_return_32.767_and_zero_stamps.log', True, False), ('leap_behind_a_passer_at_288.log.gz', False, True),
    ('zero_stamps_nan.log', False, True), ('lost_for_six_scans.log', False, False)])
def test_truth_and_wheels_of_public_logs(cases, name, truth, wheels):
    recording = open_recording(cases / 'carmen' / name)
    assert (recording.truth() is not None, recording.wheel_odometry() is not None) == (truth, wheels)
    if truth and not wheels:
        assert any('particle filter' in note for note in recording.notes)


BEND = np.array([(0.3 * k, 0.02 * k * k, 0.05 * k) for k in range(12)])
"""Poses of wheels around a bend."""


def test_odom_lines_beside_corrected_poses_are_the_wheels(tmp_path):
    truth = compose(BEND, np.random.default_rng(3).normal(0.0, 0.05, BEND.shape))
    lines = [line for k in range(12) for line in (odom(k, BEND[k]), flaser(k, truth[k]))]
    recording = open_recording(write_log(tmp_path / 'a.log', *lines))
    assert recording.notes == [DIFFER]
    assert np.abs(recording.wheel_odometry()[1] - BEND).max() < 1e-8
    assert np.abs(recording.truth()[1] - truth).max() < 1e-8


def test_odom_lines_between_the_scans_of_a_raw_log_are_no_correction(tmp_path):
    scans = compose(BEND[:-1], 0.5 * relative(BEND[:-1], BEND[1:]))
    lines = [line for k in range(11) for line in (odom(k, BEND[k]), flaser(k + 0.5, scans[k]))]
    recording = open_recording(write_log(tmp_path / 'a.log', *lines, odom(11, BEND[11])))
    assert recording.notes == [] and recording.truth() is None
    assert np.abs(recording.wheel_odometry()[1] - scans).max() < 1e-8


def test_the_wheels_of_a_laser_that_knows_no_pose_are_the_odom_lines_at_its_stamps(tmp_path):
    """Several scans between two lines of the wheels."""
    lines, times = [], np.add.outer(np.arange(10), (0.25, 0.5, 0.75))
    for k, each in enumerate(times):
        lines += [odom(k, (0.2 * k, 0.0, 0.0)), *(robotlaser(1, time, 'RAWLASER') for time in each)]
    recording = open_recording(write_log(tmp_path / 'a.log', *lines, odom(10, (2.0, 0.0, 0.0))))
    stamps, poses = recording.wheel_odometry()
    assert stamps.tolist() == recording.stamps() == (1e9 * times.ravel()).astype(int).tolist()
    assert np.abs(poses[:, 0] - 0.2 * times.ravel()).max() < 1e-9
    assert recording.truth() is None


def test_zero_poses_of_a_sensor_alone_beside_odom_lines_are_no_truth(tmp_path):
    lines = [line for k in range(10) for line in (odom(k, (0.2 * k, 0.0, 0.0)), flaser(k))]
    recording = open_recording(write_log(tmp_path / 'a.log', *lines))
    assert recording.truth() is None and recording.notes == []
    assert recording.wheel_odometry()[1][-1].tolist() == pytest.approx([1.8, 0.0, 0.0])


@pytest.mark.parametrize('name', ['corrected_poses_taken_for_wheels.log', 'no_return_32.767_and_zero_stamps.log'])
def test_truth_and_wheels_are_kept_when_a_log_is_converted(cases, tmp_path, name):
    """The second has no wheels."""
    original = open_recording(cases / 'carmen' / name)
    for target in ('bag', 'a.log'):
        convert(original.path, tmp_path / target)
        recording = open_recording(tmp_path / target)
        for ours, theirs in ((original.truth(), recording.truth()),
                             (original.wheel_odometry(), recording.wheel_odometry())):
            assert (ours is None) == (theirs is None)
            assert ours is None or ((ours[0] == theirs[0]).all() and np.abs(relative(ours[1], theirs[1])).max() < 1e-8)


def test_a_damaged_odom_line_is_named_and_skipped(tmp_path):
    recording = open_recording(write_log(tmp_path / 'a.log', flaser(1.0), 'ODOM 1 2', odom(1.5, (0, 0, 0)),
                                         flaser(2.0)))
    assert recording.stamps() == [10**9, 2 * 10**9]
    assert recording.problems == ['a.log:2: damaged ODOM skipped: 2 values where 9 are needed']


# Lines

def test_rlaser_and_rawlaser_lines_are_read(cases):
    rear = open_recording(cases / 'unclear_bag_messages' / 'rlaser.log')
    assert (rear.topic, len(list(rear.scans())), rear.notes) == ('RLASER', 12, [])
    raw = open_recording(cases / 'unclear_bag_messages' / 'rawlaser.log')
    scans = list(raw.scans())
    assert (raw.topic, len(scans), raw.notes, raw.problems) == ('RAWLASER1', 41, [], [])
    geometry = scans[0].geometry
    assert geometry.size == 720 and math.degrees(geometry.angle_increment) == pytest.approx(-0.5, abs=1e-4)
    assert sum(int(np.isinf(scan.ranges).sum()) for scan in scans) == 1426
    assert sum(int(scan.valid.sum()) for scan in scans) == 41 * 720 - 1426
    assert raw.wheel_odometry() is None and raw.truth() is None


def test_a_line_without_its_angular_step_has_that_of_its_view(tmp_path):
    lines = [robotlaser(1, stamp).replace(' 0.6 20.0', ' 0 20.0') for stamp in (1.5, 2.5)]
    scan = next(open_recording(write_log(tmp_path / 'a.log', *lines)).scans())
    assert scan.geometry.bearings == pytest.approx((-1.2, -0.6, 0.0, 0.6, 1.2))


def test_a_laser3_line_has_readings_and_no_pose(tmp_path):
    recording = open_recording(write_log(tmp_path / 'a.log', 'LASER3 3 1.0 2.0 3.0 4.5 host 0.1'))
    (scan,) = recording.scans()
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0] and scan.stamp == 4_500_000_000


def test_of_several_scanners_the_front_one_is_taken_and_the_others_are_named(tmp_path):
    log = write_log(tmp_path / 'a.log', flaser(1.0), flaser(1.0, kind='RLASER'), robotlaser(1, 1.0, 'RAWLASER'),
                    flaser(2.0))
    recording = open_recording(log)
    assert recording.topic == 'FLASER' and recording.count == 2
    assert recording.notes == ['scans are taken from the FLASER lines; other lines with scans: RAWLASER1, RLASER']
    assert open_recording(log, 'RLASER').count == 1 and open_recording(log, 'RLASER').notes == []


# Missing returns and stamps in public logs

def test_no_return_at_32_767_is_found_from_the_log(cases):
    recording = open_recording(cases / 'carmen' / 'no_return_32.767_and_zero_stamps.log')
    ranges = np.concatenate([scan.ranges for scan in recording.scans()])
    assert np.isinf(ranges).sum() == 1 + 42 + 53 and ranges[np.isfinite(ranges)].max() == np.float32(32.598)
    assert sum('no return' in note for note in recording.notes) == 1


@pytest.mark.parametrize(('log', 'missing'), [('intel/intel.log.gz', 48459), ('aces/aces.log.gz', 620)])
def test_intel_and_aces_are_read_unchanged(data, log, missing):
    recording = open_recording(data / log)
    assert recording.notes == [] and recording.problems == []
    with gzip.open(data / log, 'rt') as file:
        lines = [line.split() for line in file if line.startswith('FLASER ')]
    expected = np.array([line[2:182] for line in lines], dtype=float).astype(np.float32)
    assert (expected >= 50.0).sum() == missing
    expected[expected >= 50.0] = np.inf
    ranges = np.array([scan.ranges for scan in recording.scans()])
    assert ranges.tobytes() == expected.tobytes()


@pytest.mark.parametrize(('name', 'fewest', 'first'), [
    ('equal_stamps.log', 39, 1_018_930_000), ('negative_stamps.log', 37, 1)])
def test_at_the_steady_guess_nearly_all_scans_of_logs_without_usable_stamps_register(cases, name, fewest, first):
    recording = open_recording(cases / 'carmen' / name)
    assert [note for note in recording.notes if 'stamps' in note] == [
        'stamps are of no use (fewer than half are later than the one before): scans are assumed to be 1 s apart']
    assert recording.stamps() == [(first + k) * 10**9 for k in range(recording.count)]
    assert recording.stamps() == [scan.stamp for scan in recording.scans()]
    trajectory = Trajectory()
    assert len(list(trajectory.follow(recording.scans(), Odometry()))) == sum(trajectory.used)
    registered = sum(status in (Status.OK, Status.DEGENERATE) for status in trajectory.statuses)
    assert registered >= fewest, trajectory.statuses
    assert recording.problems == [] and recording.watch.lines() == []


def test_negative_stamps_of_a_log_are_shifted(tmp_path):
    recording = open_recording(write_log(tmp_path / 'a.log', *(flaser(stamp) for stamp in ('-3.0', '-2.5', '1.5'))))
    assert recording.stamps() == [1_000_000_000, 1_500_000_000, 5_500_000_000]
    assert recording.notes == ['stamps from -3.000 s on are shifted to start at 1 s'] and recording.problems == []


# Text

@pytest.mark.parametrize('rewrite', [
    lambda text: '\ufeff' + text.replace('\n', '\r\n'), lambda text: text.replace(' ', ' \t'),
    lambda text: '# caf\u00e9\n\n  \n' + text.replace('\n', '\n#comment\n').replace(' 2.0 ', ' 2.0e+00 ')])
def test_a_log_that_an_editor_or_a_script_has_rewritten_is_read_as_before(tmp_path, rewrite):
    path = write_log(tmp_path / 'a.log', odom(0, (0, 0, 0)), *(flaser(k, (0.1 * k, 0, 0)) for k in range(4)))
    before = list(open_recording(path).records())
    path.write_bytes(rewrite(path.read_text()).encode())
    recording = open_recording(path)
    assert recording.problems == [] and recording.count == len(before) == 4
    for was, now in zip(before, recording.records(), strict=True):
        assert was[1:] == now[1:] and was.scan.stamp == now.scan.stamp
        assert was.scan.ranges.tobytes() == now.scan.ranges.tobytes()


@pytest.mark.parametrize(('text', 'held'), [
    ('\n\n# comment\n', 'none that is known'), (f'{"x" * 3000}\nODOM\nODOM\n', '2 ODOM; first problem'),
    ('hello\tworld\n', '1 hello')])
def test_a_file_without_scans_names_the_kinds_of_its_lines_only(tmp_path, text, held):
    path = tmp_path / 'a.log'
    path.write_text(text)
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    message = str(caught.value)
    assert 'holds no laser scan; lines that are read: FLASER, RLASER, ' in message
    assert f'lines of the file: {held}' in message and len(message) < 600


# Warnings

@pytest.mark.parametrize(('kind', 'limit'), [('FLASER', ''), ('ROBOTLASER1', '20.0')])
def test_millimetres_in_a_log_are_named_whatever_its_kind_of_lines(tmp_path, kind, limit):
    readings = ' '.join(['10', *(str(1500 + 100 * k) for k in range(10))])
    line = (f'FLASER {readings} 0 0 0 0 0 0' if kind == 'FLASER' else
            f'ROBOTLASER1 0 -1.2 2.4 0.3 {limit} 0.01 0 {readings} 0 0 0 0 0 0 0 0.5 0.1 0.3 0.2 1e6')
    recording = open_recording(write_log(tmp_path / 'a.log', *(f'{line} {k} host 0.1' for k in range(3))))
    (warning,) = recording.look_through().lines()
    assert warning.startswith('the ranges look like millimetres') and '(3 of 3 scans, first scan 0)' in warning


def test_register_convert_and_compare_tell_once_what_was_assumed(cases, tmp_path, capsys):
    path = cases / 'carmen' / 'no_return_32.767_and_zero_stamps.log'
    notes = open_recording(path).notes
    assert len(notes) == 3
    for command, arguments in ((register, [str(path), '0', '1', '--out', str(tmp_path / 'pair')]),
                               (convert_command, [str(path), str(tmp_path / 'copy.log')]),
                               (compare, ['defaults', 'defaults', str(path), '--processes', '1', '--out',
                                          str(tmp_path / 'c')])):
        assert command(arguments) in (0, 1)
        said = ''.join(capsys.readouterr())
        assert [said.count(note) for note in notes] == [1, 1, 1]


def test_replay_tells_once_what_was_assumed(cases, tmp_path, capsys):
    path = cases / 'carmen' / 'zero_stamps_nan.log'
    notes = open_recording(path).notes
    assert replay([str(path), '--out', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    (folder,) = (folder for folder in next(tmp_path.iterdir()).iterdir() if not folder.is_symlink())
    assert json.loads((folder / 'metrics.json').read_text())['notes'] == notes
    page = (folder / 'report.html').read_text()
    for note in notes:
        assert output.count(note) == 1 and page.count(note) == 1
