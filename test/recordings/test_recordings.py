# SPDX-License-Identifier: Apache-2.0
"""Recordings of every format: what is read, what is skipped, what is refused."""
import gzip
import itertools
import math
import shutil
import tracemalloc

import numpy as np
import pytest
from bags import SECOND, laser_scan, write_bag

from dbscan_reg_ros import RecordingError
from dbscan_reg_ros.recordings import data_folder, find_recording, open_recording
from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
from dbscan_reg_ros.recordings.message_fields import pose_only_fields


def flaser(ranges, stamp='12.5', pose='1 2 0.5', odometry='1 2 0.5'):
    return f'FLASER {len(ranges)} {" ".join(map(str, ranges))} {pose} {odometry} {stamp} host 0.1'


def write_log(path, *lines):
    path.write_text('\n'.join(lines) + '\n')
    return path


# CARMEN

def test_intel_keeps_the_order_of_the_file_and_its_stamps_to_the_nanosecond(data):
    recording = open_recording(data / 'intel' / 'intel.log.gz')
    scans = list(recording.scans())
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as log:
        written = [line.split()[-3] for line in log if line.startswith('FLASER ')]
    whole, fraction = zip(*(word.split('.') for word in written), strict=True)
    exact = [int(w + f.ljust(9, '0')) for w, f in zip(whole, fraction, strict=True)]
    assert [scan.stamp for scan in scans] == exact == recording.stamps()
    assert exact[0] == 976052857337530000
    steps = np.diff(exact)
    assert len(scans) == recording.count == 5505
    assert (steps < 0).sum() == 265 and steps.min() == -897325000
    assert ((steps >= 0) & (steps < SECOND // 100)).sum() == 1213
    assert recording.problems == []
    assert (recording.name, recording.topic, recording.frame_id) == ('intel', 'FLASER', 'laser')


def test_aces_has_corrected_poses_beside_its_odometry(data):
    recording = open_recording(data / 'aces' / 'aces.log.gz')
    stamps, corrected = recording.truth()
    odometry_stamps, odometry = recording.wheel_odometry()
    assert len(stamps) == 440 and (stamps == odometry_stamps).all() and stamps.tolist() == recording.stamps()
    assert corrected[1].tolist() == [0.829539, -0.206873, -1.007360]
    assert odometry[1].tolist() == [0.884870, -0.176229, -1.001110]
    assert open_recording(data / 'intel' / 'intel.log.gz').truth() is None, 'its odometry is raw'


def test_a_laser_ahead_of_the_robot_is_no_correction(tmp_path):
    lines = [flaser([1.0] * 4, pose=f'{x + 0.2 * math.cos(a):.6f} {0.2 * math.sin(a):.6f} {a}', odometry=f'{x} 0 {a}')
             for x, a in ((0, 0.0), (1, 0.7), (2, -2.0))]
    assert open_recording(write_log(tmp_path / 'a.log', *lines)).truth() is None


@pytest.mark.parametrize(('n', 'step', 'last'), [(180, 1.0, 89.0), (181, 1.0, 90.0), (361, 0.5, 90.0),
                                                 (360, 0.5, 89.5)])
def test_flaser_spans_180_degrees(tmp_path, n, step, last):
    (scan,) = open_recording(write_log(tmp_path / 'a.log', flaser([2.0] * n))).scans()
    bearings = np.degrees(scan.geometry.bearings)
    assert bearings[0] == pytest.approx(-90.0, abs=1e-4) and bearings[-1] == pytest.approx(last, abs=1e-4)
    assert math.degrees(scan.geometry.angle_increment) == pytest.approx(step, abs=1e-5)


def test_robotlaser_carries_its_own_angles_and_range(tmp_path):
    line = ('ROBOTLASER1 0 -1.2 2.4 0.6 20.0 0.01 0 5 1.0 2.5 20.0 81.9 4.0 2 7 8 '
            '1.1 2.1 0.3 1.0 2.0 0.25 0.5 0.1 0.3 0.2 1e6 1234567890.123456 host 3.5')
    recording = open_recording(write_log(tmp_path / 'a.log', 'PARAM x 1', line))
    (scan,) = recording.scans()
    assert np.allclose(scan.geometry.bearings, [-1.2, -0.6, 0.0, 0.6, 1.2], atol=1e-6)
    assert scan.ranges.tolist() == [1.0, 2.5, math.inf, np.float32(81.9), 4.0]
    assert scan.valid.tolist() == [True, True, False, False, True]
    assert scan.geometry.range_max == np.nextafter(np.float32(20.0), np.float32(0.0))
    assert scan.stamp == 1234567890123456000
    assert recording.wheel_odometry()[1].tolist() == [[1.0, 2.0, 0.25]]
    assert recording.topic == 'ROBOTLASER1'


def test_a_log_with_two_kinds_of_scans_asks_which(tmp_path):
    robotlaser = 'ROBOTLASER1 0 -1 2 1 20 0 0 3 1 2 3 0 0 0 0 0 0 0 0 0 0 0 0 9.25 host 1'
    log = write_log(tmp_path / 'a.log', flaser([1.0, 2.0]), robotlaser)
    with pytest.raises(RecordingError, match='choose one of its 2 topics of scans: FLASER, ROBOTLASER1'):
        open_recording(log)
    assert open_recording(log, 'ROBOTLASER1').stamps() == [9_250_000_000]
    with pytest.raises(RecordingError, match="no scans on '/scan'; topics of scans: FLASER, ROBOTLASER1"):
        open_recording(log, '/scan')


@pytest.mark.parametrize(('damaged', 'reason'), [
    ('FLASER 180 1.0 2.0 3.0', '4 values where 180 readings need 190'),
    ('FLASER', 'too few values'),
    ('FLASER 0 0 0 0 0 0 0 1.0 host 1.0', "number of readings '0': expected a whole number of at least 2"),
    (flaser([1.0, 'wall']), "'wall' is not a number"),
    (flaser([1.0, 2.0], stamp='yesterday'), "stamp 'yesterday' is no number of seconds"),
    (flaser([1.0, 2.0], stamp='-3.0e9'), 'outside -1000000 to 4295967296 s: expected seconds'),
    (flaser([1.0, 2.0], odometry='1 nan 0'), 'expected finite numbers'),
    ('1.0 2.0 3.0 12.5 host 0.1', 'not a CARMEN message'),
])
def test_a_damaged_line_is_named_and_skipped(tmp_path, damaged, reason):
    good = flaser([1.0, 2.0], stamp='1.5'), flaser([1.0, 2.0], stamp='2.5')
    recording = open_recording(write_log(tmp_path / 'a.log', '# CARMEN', good[0], damaged, good[1]))
    assert recording.stamps() == [1_500_000_000, 2_500_000_000]
    (problem,) = recording.problems
    assert problem.startswith('a.log:3: ') and reason in problem


def test_a_cut_gzip_file_gives_what_it_holds(data, tmp_path):
    whole = (data / 'intel' / 'intel.log.gz').read_bytes()
    path = tmp_path / 'cut.log.gz'
    path.write_bytes(whole[:len(whole) // 2])
    recording = open_recording(path)
    stamps = recording.stamps()
    assert 2500 < len(stamps) < 3000
    assert stamps == open_recording(data / 'intel' / 'intel.log.gz').stamps()[:len(stamps)]
    assert any('cannot be read from here on: the gzip file is cut off or damaged' in problem
               for problem in recording.problems)


def test_a_gzip_file_that_is_damaged_at_its_start_is_refused(data, tmp_path):
    whole = (data / 'intel' / 'intel.log.gz').read_bytes()
    path = tmp_path / 'damaged.log.gz'
    for content in (whole[:8], whole[:200] + b'x' * 400 + whole[600:]):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match='the gzip file is cut off or damaged; copy it again from its source'):
            open_recording(path)


def test_problems_are_named_once_however_often_the_log_is_read(tmp_path):
    recording = open_recording(write_log(tmp_path / 'a.log', flaser([1.0, 2.0]), 'FLASER 3 1'))
    for _ in range(3):
        recording.stamps()
    assert len(recording.problems) == 1


def test_reading_a_log_takes_little_memory(data):
    recording = open_recording(data / 'intel' / 'intel.log.gz')
    tracemalloc.start()
    try:
        # As arrays these scans take four times as much as is allowed.
        for _ in itertools.islice(recording.scans(), 1500):
            pass
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 500_000


# Bags

@pytest.mark.parametrize(('path', 'count', 'beams', 'first', 'name'), [
    ('lms511/static', 173, 1141, 4101310801000, 'static'),
    ('lms511/static/static.db3', 173, 1141, 4101310801000, 'static'),
    ('urg04lx/exp1', 756, 682, 212387282000, 'exp1'),
    ('urg04lx/exp1/exp1.mcap', 756, 682, 212387282000, 'exp1'),
    ('ccny_demo/demo.bag', 360, 681, 1282836370970876375, 'demo'),
])
def test_bags_of_all_kinds_are_read(data, path, count, beams, first, name):
    recording = open_recording(data / path)
    scans = list(recording.scans())
    assert len(scans) == recording.count == count
    assert {scan.geometry.size for scan in scans} == {beams}
    assert len({id(scan.geometry) for scan in scans}) == 1
    assert scans[0].stamp == first == recording.stamps()[0]
    assert (recording.name, recording.topic, recording.frame_id) == (name, '/scan', 'laser')
    assert recording.problems == []


def test_a_bag_gives_its_messages_bit_for_bit(data):
    from rosbags.highlevel import AnyReader
    scans = open_recording(data / 'ccny_demo' / 'demo.bag').scans()
    with AnyReader([data / 'ccny_demo' / 'demo.bag']) as reader:
        for scan, (connection, _, raw) in zip(scans, reader.messages(), strict=True):
            message = reader.deserialize(raw, connection.msgtype)
            assert scan.ranges.tobytes() == message.ranges.tobytes()
            assert scan.geometry.angle_min == message.angle_min
            assert scan.geometry.angle_increment == message.angle_increment
            assert scan.time_increment == message.time_increment == pytest.approx(97.7e-6, abs=1e-7)


def test_wheel_odometry_of_a_bag(data):
    stamps, poses = open_recording(data / 'urg04lx' / 'exp1').wheel_odometry()
    assert stamps.shape == (756,) and poses.shape == (756, 3)
    assert poses[-1] == pytest.approx([-5.780807, -2.981989, 1.866315], abs=1e-6)
    assert open_recording(data / 'lms511' / 'static').wheel_odometry() is None


def test_the_beams_are_counted_and_angle_max_is_not_trusted(tmp_path):
    (scan,) = open_recording(write_bag(tmp_path / 'bag', [('/scan', 1, laser_scan())])).scans()
    assert scan.geometry.bearings.tolist() == [-0.5, -0.25, 0.0, 0.25, 0.5]
    assert scan.stamp == 5_000_000_007 and scan.frame_id == 'front'


def test_two_topics_of_scans_ask_which(tmp_path):
    bag = write_bag(tmp_path / 'bag', [('/front', 1, laser_scan(n=3)), ('/rear', 2, laser_scan(n=4))])
    with pytest.raises(RecordingError, match='choose one of its 2 topics of scans: /front, /rear'):
        open_recording(bag)
    assert next(open_recording(bag, '/rear').scans()).geometry.size == 4
    with pytest.raises(RecordingError, match="no scans on '/scan'; topics of scans: /front, /rear"):
        open_recording(bag, '/scan')


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_damaged_message_is_named_and_skipped(tmp_path, storage):
    messages = [laser_scan(1), b'\0\1\0\0short', laser_scan(2, angle_min=math.nan), laser_scan(3, increment=0.0),
                laser_scan(4, n=0), laser_scan(5)]
    bag = write_bag(tmp_path / 'bag', [('/scan', i, message) for i, message in enumerate(messages)], storage)
    recording = open_recording(bag)
    assert recording.stamps() == [1, 5]
    assert [problem.partition(' skipped')[0] for problem in recording.problems] == [
        'bag: damaged message 2 on /scan', 'bag: scan 3 on /scan', 'bag: scan 4 on /scan', 'bag: scan 5 on /scan']


def test_a_bag_whose_every_message_is_damaged_is_refused(tmp_path):
    with pytest.raises(RecordingError, match='no readable scan on /scan: bag: damaged message 1'):
        open_recording(write_bag(tmp_path / 'bag', [('/scan', 1, b'\0\1\0\0')]))


@pytest.mark.parametrize('path', ['lms511/static', 'urg04lx/exp1', 'ccny_demo/demo.bag'])
@pytest.mark.parametrize('kept', [0.01, 0.5])
def test_a_cut_bag_is_refused_or_read_up_to_the_cut(data, tmp_path, path, kept):
    if (data / path).is_dir():
        shutil.copytree(data / path, tmp_path / 'bag')
        (file,) = (file for file in (tmp_path / 'bag').iterdir() if file.name != 'metadata.yaml')
    else:
        file = tmp_path / 'bag.bag'
        shutil.copyfile(data / path, file)
    content = (data / path / file.name if (data / path).is_dir() else data / path).read_bytes()
    file.chmod(0o644)
    file.write_bytes(content[:int(kept * len(content))])
    target = tmp_path / 'bag' if (data / path).is_dir() else file
    try:
        recording = open_recording(target)
        found = recording.stamps()
    except RecordingError as error:
        assert target.name in str(error) and '\n' not in str(error)
    else:
        assert found == open_recording(data / path).stamps()[:len(found)]
        assert recording.problems


# Neither

def test_what_cannot_be_read_is_refused_by_name(tmp_path):
    (tmp_path / 'empty.log').touch()
    (tmp_path / 'empty.bag').touch()
    (tmp_path / 'empty.log.gz').write_bytes(gzip.compress(b''))
    (tmp_path / 'picture.png').write_bytes(b'\x89PNG\r\n\x1a\n\0\0\0\rIHDR')
    (tmp_path / 'broken.log.gz').write_bytes(b'\x1f\x8bnonsense')
    (tmp_path / 'notes.txt').write_text('nothing to see\n')
    (tmp_path / 'folder').mkdir()
    for name, reason in (('empty.log', 'the file is empty'), ('empty.bag', 'the file is empty'),
                         ('empty.log.gz', 'the file is empty'), ('picture.png', 'neither a CARMEN log nor a ROS bag'),
                         ('broken.log.gz', 'cannot be read'), ('notes.txt', 'holds no laser scan'),
                         ('folder', 'no ROS 2 bag'), ('absent.log', 'cannot be read: No such file or directory')):
        with pytest.raises(RecordingError) as caught:
            open_recording(tmp_path / name)
        assert name in str(caught.value) and reason in str(caught.value)


# Where they are

def test_recordings_are_found_here_or_below_the_folder_of_data(tmp_path, monkeypatch):
    """It is the argument, or the variable; one that is named has to exist."""
    for name in 'ab':
        (tmp_path / name).mkdir()
    (tmp_path / 'a' / 'a.log').touch()
    monkeypatch.setenv('DBSCAN_REG_DATA', str(tmp_path / 'b'))
    assert data_folder(tmp_path / 'a') == tmp_path / 'a' and data_folder() == tmp_path / 'b'
    assert find_recording('a.log', tmp_path / 'a') == tmp_path / 'a' / 'a.log'
    with pytest.raises(RecordingError, match=f'^a.log: no such file here or in the folder of recordings {tmp_path}/b'):
        find_recording('a.log')
    monkeypatch.setenv('DBSCAN_REG_DATA', str(tmp_path / 'absent'))
    assert find_recording(tmp_path / 'a' / 'a.log') == tmp_path / 'a' / 'a.log'
    with pytest.raises(RecordingError, match='absent: no such folder of recordings; name it with --data'):
        find_recording('a.log')



@pytest.mark.parametrize(('corrected', 'known'), [(0.5, True), (0.0, False)])
def test_poses_of_the_laser_in_a_bag_are_the_truth_only_where_they_differ_from_the_wheels(tmp_path, corrected, known):
    maker, kind = MessageMaker(), 'nav_msgs/msg/Odometry'
    rows = [('/scan', k * SECOND, laser_scan(k * SECOND)) for k in range(1, 6)]
    for topic, factor in (('/odom', 0.0), ('/laser_pose', corrected)):
        rows += [(topic, k * SECOND, bytes(maker.serialize(kind, pose_only_fields(
            k * SECOND, 'laser', (0.1 * k, factor * k, 0.0))))) for k in range(1, 6)]
    recording = open_recording(write_bag(tmp_path / 'bag', rows, kinds=dict.fromkeys(('/odom', '/laser_pose'), kind)))
    assert recording.wheel_odometry()[1][:, 0] == pytest.approx(0.1 * np.arange(1, 6))
    truth = recording.truth()
    assert (truth is not None) == known
    assert truth is None or truth[1][:, 1] == pytest.approx(corrected * np.arange(1, 6))
