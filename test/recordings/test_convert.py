# SPDX-License-Identifier: Apache-2.0
"""Conversion: every format into every other and back, and what must survive."""
import itertools
import math

import numpy as np
import pytest
from bags import SECOND, laser_scan, messages, needs_rosbags, write_bag

from dbscan_reg_ros import RecordingError
from dbscan_reg_ros.commands.convert import main
from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.recordings import conversion, open_recording
from dbscan_reg_ros.recordings.bags.reading import open_reader
from dbscan_reg_ros.recordings.conversion import Gap, Kept, convert
from dbscan_reg_ros.recordings.poses import relative

BAGS = ['lms511/static', pytest.param('urg04lx/exp1', marks=pytest.mark.long), 'ccny_demo/demo.bag']


def stamp_of(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def assert_same_scans(ours, theirs):
    """The same scans in the same order, bit for bit."""
    count = 0
    for a, b in itertools.zip_longest(ours.scans(), theirs.scans()):
        count += 1
        assert a.stamp == b.stamp
        assert a.ranges.tobytes() == b.ranges.tobytes()
        assert (a.valid == b.valid).all()
        assert a.geometry == b.geometry and a.time_increment == b.time_increment and a.frame_id == b.frame_id
    assert count == ours.count


@pytest.mark.parametrize(('log', 'bag', 'storage'), [
    pytest.param('intel/intel.log.gz', 'bag', 'mcap', marks=pytest.mark.long), ('aces/aces.log.gz', 'bag', 'sqlite3'),
    ('aces/aces.log.gz', 'a.bag', 'mcap')])
def test_a_log_becomes_a_bag_and_the_same_log_again(data, tmp_path, log, bag, storage):
    original = open_recording(data / log)
    convert(data / log, tmp_path / bag, storage=storage)
    convert(tmp_path / bag, tmp_path / 'back.log.gz')
    through, back = open_recording(tmp_path / bag), open_recording(tmp_path / 'back.log.gz')
    assert back.topic == 'FLASER'
    for recording in (through, back):
        assert_same_scans(original, recording)
        for ours, theirs in ((original.wheel_odometry(), recording.wheel_odometry()),
                             (original.truth(), recording.truth())):
            assert (ours is None) == (theirs is None)
            if ours:
                assert (ours[0] == theirs[0]).all()
                assert np.abs(relative(ours[1], theirs[1])).max() < 1e-9
        assert recording.problems == []


@pytest.mark.parametrize('bag', BAGS)
def test_a_bag_becomes_a_log_and_a_bag_again(data, tmp_path, bag):
    original = open_recording(data / bag)
    convert(data / bag, tmp_path / 'a.log')
    convert(tmp_path / 'a.log', tmp_path / 'back')
    for recording in (open_recording(tmp_path / 'a.log'), open_recording(tmp_path / 'back')):
        assert_same_scans(original, recording)
        assert (original.wheel_odometry() is None) == (recording.wheel_odometry() is None)
        if original.wheel_odometry():
            stamps, poses = recording.wheel_odometry()
            assert (stamps == original.wheel_odometry()[0]).all()
            assert np.abs(relative(poses, original.wheel_odometry()[1])).max() < 1e-9


@pytest.mark.parametrize('bag', BAGS)
def test_a_bag_changes_its_version_and_back_without_any_loss(data, tmp_path, bag):
    between, back = ('between', 'back.bag') if bag.endswith('.bag') else ('between.bag', 'back')
    convert(data / bag, tmp_path / between)
    convert(tmp_path / between, tmp_path / back, storage='sqlite3')
    original = messages(data / bag)
    for converted in (messages(tmp_path / between), messages(tmp_path / back)):
        assert [(topic, time) for topic, time, _ in converted] == [(topic, time) for topic, time, _ in original]
        for (_, _, a), (_, _, b) in zip(original, converted, strict=True):
            assert stamp_of(a) == stamp_of(b) and a.header.frame_id == b.header.frame_id
            for name in ('ranges', 'intensities', 'angle_min', 'angle_max', 'time_increment', 'scan_time', 'range_max'):
                assert np.array_equal(getattr(a, name, 0), getattr(b, name, 0))
            if hasattr(a, 'twist'):
                assert repr(a.pose) == repr(b.pose) and repr(a.twist) == repr(b.twist)


@pytest.mark.long
def test_record_times_increase_where_the_stamps_of_intel_go_back(data, tmp_path):
    convert(data / 'intel' / 'intel.log.gz', tmp_path / 'bag', Kept(topics=['/scan']))
    scans = messages(tmp_path / 'bag')
    times = np.array([time for _, time, _ in scans])
    stamps = np.array([stamp_of(message) for _, _, message in scans])
    assert len(times) == 5505 and {topic for topic, _, _ in scans} == {'/scan'}
    assert (np.diff(times) > 0).all() and times[0] == stamps[0]
    assert (np.diff(stamps) < 0).sum() == 265
    assert (times >= stamps).all() and (times - stamps).max() < SECOND
    assert stamps.tolist() == open_recording(data / 'intel' / 'intel.log.gz').stamps()


def test_a_time_range_and_topics_are_kept(data, tmp_path):
    counts, _ = convert(data / 'urg04lx' / 'exp1', tmp_path / 'part', Kept(topics=['/scan'], start=10.0, end=20.0))
    whole, kept = messages(data / 'urg04lx' / 'exp1'), messages(tmp_path / 'part')
    expected = [time for topic, time, _ in whole if topic == '/scan' and 10.0 <= (time - whole[0][1]) / SECOND <= 20.0]
    assert [time for _, time, _ in kept] == expected and {topic for topic, _, _ in kept} == {'/scan'}
    assert counts == {'/scan': len(expected)} and 90 < len(expected) < 110


def test_a_part_of_a_bag_has_the_static_transforms_from_before(hall_recording, tmp_path):
    counts, _ = convert(hall_recording, tmp_path / 'part', Kept(start=5.0, end=7.0))
    assert counts['/tf_static'] == 1 and 5 < counts['/scan'] < 12
    assert open_recording(tmp_path / 'part').mounting == open_recording(hall_recording).mounting
    with pytest.raises(RecordingError, match='no message to keep'):
        convert(hall_recording, tmp_path / 'none', Kept(start=1000.0, end=1001.0))


def test_a_lidar_fails_and_comes_back(tmp_path):
    times = [SECOND * k // 2 for k in range(100, 120)]
    write_bag(tmp_path / 'bag', [(topic, time, laser_scan(time)) for time in times for topic in ('/front', '/rear')])
    counts, remarks = convert(tmp_path / 'bag', tmp_path / 'part', Kept(start=1.0, without=[
        Gap('/rear', 2.0, 4.0), Gap('/rear', 8.5, math.inf)]))
    found = {topic: [(time - times[0]) / SECOND for each, time, _ in messages(tmp_path / 'part') if each == topic]
             for topic in ('/front', '/rear')}
    assert found['/front'] == [0.5 * k for k in range(2, 20)]
    assert found['/rear'] == [1.0, 1.5, *(0.5 * k for k in range(9, 17))] and counts == {'/front': 18, '/rear': 10}
    assert remarks == ['/rear: 5 messages from 2 to 4 s left out', '/rear: 3 messages from 8.5 to inf s left out']


def test_what_is_no_scan_passes_from_bag_to_bag(tmp_path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(tmp_path / 'a.bag') as writer:
        chatter = writer.add_connection('/chatter', 'std_msgs/msg/String', typestore=store)
        for time in (100, 200, 200):
            message = store.types['std_msgs/msg/String'](data=f'at {time}')
            writer.write(chatter, time, store.serialize_ros1(message, 'std_msgs/msg/String'))
    convert(tmp_path / 'a.bag', tmp_path / 'b')
    assert [(topic, time, message.data) for topic, time, message in messages(tmp_path / 'b')] == [
        ('/chatter', 100, 'at 100'), ('/chatter', 200, 'at 200'), ('/chatter', 200, 'at 200')]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_messages_of_an_unknown_type_are_copied_byte_by_byte(cases, tmp_path, storage):
    source = cases / 'bags' / 'type_without_definition'
    counts, _ = convert(source, tmp_path / 'bag', storage=storage)
    assert counts == {'/scan': 8, '/custom': 1}
    convert(tmp_path / 'bag', tmp_path / 'again')
    contents = []
    for path in (source, tmp_path / 'bag', tmp_path / 'again'):
        with open_reader(path) as reader:
            contents.append([(c.topic, c.msgtype, time, bytes(raw)) for c, time, raw in reader.messages(
                reader.connections)])
    assert contents[0] == contents[1] == contents[2] and len(contents[0]) == 9
    for path in (source, tmp_path / 'bag'):
        with pytest.raises(RecordingError, match='definition'):
            convert(path, tmp_path / 'old.bag')
        assert not (tmp_path / 'old.bag').exists()


def test_a_scan_that_a_log_can_hardly_hold_keeps_what_counts(tmp_path):
    message = laser_scan(n=9)
    message.ranges[:] = [np.inf, np.nan, -np.inf, 0.0, 0.05, 10.0, 10.5, 1.2345678, 0.1]
    write_bag(tmp_path / 'bag', [('/scan', 1, message)])
    convert(tmp_path / 'bag', tmp_path / 'a.log')
    (before,), (after,) = (open_recording(tmp_path / name).scans() for name in ('bag', 'a.log'))
    assert (before.valid == after.valid).all() and before.valid.sum() == 2
    assert after.ranges[0] == after.ranges[1] == np.inf
    assert before.ranges[2:].tobytes() == after.ranges[2:].tobytes()
    assert after.frame_id == 'front' and after.geometry == before.geometry


def test_a_damaged_message_is_left_out_and_named(tmp_path):
    write_bag(tmp_path / 'bag', [('/scan', 1, laser_scan(1)), ('/scan', 2, b'\0\1\0\0x'), ('/scan', 3, laser_scan(3))])
    counts, problems = convert(tmp_path / 'bag', tmp_path / 'a.bag')
    assert counts == {'/scan': 2} and open_recording(tmp_path / 'a.bag').stamps() == [1, 3]
    assert len(problems) == 1 and problems[0].startswith('bag: damaged message on /scan skipped')
    counts, problems = convert(tmp_path / 'bag', tmp_path / 'a.log')
    assert counts == {'ROBOTLASER1': 2} and len(problems) == 1
    with pytest.raises(RecordingError, match='bag: damaged message on /scan skipped'):
        convert(tmp_path / 'bag', tmp_path / 'none.bag', Kept(start=1e-9, end=1e-9))
    assert not (tmp_path / 'none.bag').exists()


@pytest.mark.parametrize('target', [pytest.param('bag', marks=needs_rosbags), pytest.param(
    'a.bag', marks=(needs_rosbags, pytest.mark.long)), pytest.param('a.log.gz', marks=pytest.mark.long)])
def test_ctrl_c_leaves_a_valid_recording(data, tmp_path, monkeypatch, capsys, target):
    with monkeypatch.context() as patch:
        break_off(patch, 100, KeyboardInterrupt())
        assert main(['intel/intel.log.gz', str(tmp_path / target), '--data', str(data)]) == 130
    assert capsys.readouterr().err == 'convert: interrupted\n'
    assert open_recording(tmp_path / target).stamps() == open_recording(data / 'intel' / 'intel.log.gz').stamps()[:100]


def test_a_conversion_that_fails_leaves_nothing(data, tmp_path, monkeypatch):
    break_off(monkeypatch, 3, OSError(28, 'No space left on device'))
    for target in ('bag', 'a.bag', 'a.log'):
        with pytest.raises(OSError, match='No space left'):
            convert(data / 'aces' / 'aces.log.gz', tmp_path / target)
    assert list(tmp_path.iterdir()) == []


def break_off(patch, count, error):
    """Let the conversion of a log end with `error` after `count` of its records."""
    def ending(*arguments):
        yield from itertools.islice(timed(*arguments), count)
        raise error

    timed = conversion._timed
    patch.setattr(conversion, '_timed', ending)


@pytest.mark.parametrize(('source', 'target', 'options', 'reason'), [
    ('lms511/static', 'there', {}, 'there: exists already'),
    ('lms511/static', 'nowhere/bag', {}, 'nowhere: no such folder'),
    ('lms511/static', 'a.mcap', {}, 'a ROS 2 bag is a folder'),
    ('lms511/static', 'b', {'topics': ['/odom']}, 'no topic /odom; there are /scan'),
    ('lms511/static', 'a.log', {'topic': '/odom'}, "no scans on '/odom'"),
    ('lms511/static', 'a.log', {'topics': ['/scan']}, 'topics to keep \\(/scan\\) apply to bags'),
    ('lms511/static', 'b', {'topic': '/scan'}, '--topic /scan applies to logs'),
    ('lms511/static', 'b', {'start': 50.0, 'end': 10.0},
     'from 50 to 10 s: expected a start of 0 s or later, and an end'),
    ('lms511/static', 'b', {'without': [Gap('/scan', 100.0, math.inf)]}, 'no message on /scan from 100 to inf s'),
    ('lms511/static', 'b', {'without': [Gap('/rear', 1.0, 2.0)]}, 'no topic /rear; there are /scan'),
    ('lms511/static', 'a.log', {'without': [Gap('/scan', 1.0, 2.0)]}, '--without applies to a bag'),
    ('aces/aces.log.gz', 'b', {'start': 1e5}, 'from 100000 to inf s: no message to keep; the recording lasts 1318'),
    ('lms511/static', 'b.log', {'start': math.inf}, 'from inf to inf s: no message to keep; the recording lasts 6'),
])
def test_what_cannot_be_converted_is_refused_and_nothing_is_written(data, tmp_path, source, target, options, reason):
    (tmp_path / 'there').mkdir()
    with pytest.raises(RecordingError, match=reason):
        convert(data / source, tmp_path / target, Kept(**options))
    assert [file.name for file in tmp_path.iterdir()] == ['there']


@needs_rosbags
def test_what_true_poses_a_part_lacks_is_said(tmp_path):
    """Those of a log are laser poses that differ from the wheels, which they do not do at once."""
    whole, part = tmp_path / 'whole.log', tmp_path / 'part.log'
    assert simulate([str(whole), '--world', 'hall', '--speed', '2', '--rate', '4', '--seconds', '4']) == 0
    assert convert(whole, tmp_path / 'copy.log')[1] == [] and open_recording(tmp_path / 'copy.log').truth() is not None
    (tmp_path / 'whole.relations').write_text('')
    assert convert(whole, part, Kept(end=0.3))[1] == [
        'whole.relations beside whole.log, with true motions, is not copied',
        'part.log has no true poses, which whole.log has: in what is kept the poses of the laser do not differ from '
        'those of the wheels']
    assert open_recording(part).truth() is None


def test_the_command_says_what_it_wrote(data, tmp_path, capsys):
    target = tmp_path / 'bag'
    assert main(['aces/aces.log.gz', str(target), '--data', str(data), '--topics', '/scan', '--end', '60']) == 0
    count = len(open_recording(target).stamps())
    remark, written = capsys.readouterr().out.splitlines()
    assert remark.startswith('bag has no true poses, which aces.log.gz has: ')
    assert written == f'{target}  {count} /scan' and 20 < count < 200
    assert main(['aces/aces.log.gz', str(target), '--data', str(data)]) == 2
    assert capsys.readouterr().err == f'convert: {target}: exists already; choose another name, or remove it\n'


@needs_rosbags
def test_the_command_leaves_out_a_part_of_a_topic(data, tmp_path, capsys):
    words = ['lms511/static', str(tmp_path / 'bag'), '--data', str(data)]
    for span in (('2', '1'), ('-1', '2'), ('nan', '2')):
        assert main([*words, '--without', '/scan', *span]) == 2
        assert capsys.readouterr().err == (f'convert: --without /scan {" ".join(span)}: expected TOPIC FROM TO, in s, '
                                           'with FROM before TO\n')
    assert main([*words, '--without', '/scan', '1', '2', '--without', '/scan', '3', 'inf']) == 0
    stamps = np.array(open_recording(tmp_path / 'bag').stamps())
    assert 30 < len(stamps) < 90 and (np.diff(stamps) > 0.9 * SECOND).sum() == 1
    assert capsys.readouterr().out.splitlines()[0].endswith('messages from 1 to 2 s left out')
