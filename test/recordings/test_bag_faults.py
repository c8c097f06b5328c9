# SPDX-License-Identifier: Apache-2.0
"""Bags that cannot be read: what they are and what helps, in one line and in our own words."""
import os
import shutil
import socket

import pytest
from bags import laser_scan, text, write_bag
from child import in_child

from dbscan_reg_ros import DbscanRegError, ParameterError, RecordingError
from dbscan_reg_ros.recordings import load_relations, open_recording, read_csv, read_tum
from dbscan_reg_ros.recordings.snapshots import read_snapshot
from dbscan_reg_ros.robot.parameter_files import read_parameters

LIBRARY = ('Error', 'magic', 'please report', 'Unrecognized', 'frame descriptor', 'weakref', 'Exception')
"""Texts of libraries, which do not say what to do."""


def refusal(path):
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    message = str(caught.value)
    assert message.startswith(f'{path}: ') and '\n' not in message
    assert not [word for word in LIBRARY if word in message.removeprefix(str(path))]
    return message


@pytest.mark.parametrize(('name', 'what', 'help'), [
    ('cut_off_by_power_loss.mcap', 'a recording that was not closed', 'mcap recover'),
    ('cut.bag', 'a ROS 1 bag whose index is damaged or missing', 'rosbag reindex'),
    ('index_count.bag', 'a ROS 1 bag whose index is damaged or missing', 'rosbag reindex'),
    ('alone.mcap.zstd', 'a file compressed with zstd', 'zstd -d'),
    ('alone.db3.zstd', 'a file compressed with zstd', 'name its folder'),
    ('unpacked_by_hand', 'says that mcap_FILE.mcap is compressed with zstd, it is a plain mcap file',
     'name the file itself'),
    ('storage_identifier_empty', "says storage '', mcap_plain.mcap is an mcap file", 'name the file itself'),
    ('only_multi_echo', '/echoes (sensor_msgs/msg/MultiEchoLaserScan)', 'laser_proc'),
])
def test_unreadable_public_bags_are_refused_with_cause_and_remedy(cases, name, what, help):
    message = refusal(cases / 'unclear_bag_messages' / name)
    assert what in message and help in message


def test_a_bag_that_is_still_recorded_asks_for_its_index(cases, tmp_path):
    path = tmp_path / 'drive.bag.active'
    shutil.copyfile(cases / 'unclear_bag_messages' / 'cut.bag', path)
    assert f'not closed; mend it with ROS 1: rosbag reindex {path}' in refusal(path)


def small_bag(path, storage='mcap'):
    return write_bag(path, [('/scan', stamp, laser_scan(stamp)) for stamp in (1, 2)], storage)


def change_metadata(folder, old, new):
    metadata = folder / 'metadata.yaml'
    content = metadata.read_text()
    assert old in content
    metadata.write_text(content.replace(old, new))


@pytest.mark.parametrize(('storage', 'old', 'new', 'reason'), [
    ('mcap', 'storage_identifier: mcap', 'storage_identifier: sqlite3',
     "says storage 'sqlite3', bag.mcap is an mcap file"),
    ('sqlite3', 'storage_identifier: sqlite3', 'storage_identifier: mcap',
     "says storage 'mcap', bag.db3 is an sqlite3 file"),
    ('mcap', '- bag.mcap', '- other.mcap', 'names other.mcap, which is not there'),
    ('mcap', 'rosbag2_bagfile_information', 'something_else', 'its metadata.yaml is damaged'),
    ('mcap', 'version: 9', 'version: 99', 'or of a version that is not known here'),
    ('sqlite3', 'topics_with_message_count', 'topics', 'its metadata.yaml is damaged'),
])
def test_a_metadata_file_that_is_wrong_names_the_file_to_name_instead(tmp_path, storage, old, new, reason):
    folder = small_bag(tmp_path / 'bag', storage)
    change_metadata(folder, old, new)
    message = refusal(folder)
    (file,) = folder.glob('bag.*')
    assert reason in message and f'name the file itself: {file}' in message
    assert open_recording(file).stamps() == [1, 2]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_file_of_a_bag_under_another_name_asks_for_its_ending(tmp_path, storage):
    (file,) = small_bag(tmp_path / 'bag', storage).glob('bag.*')
    renamed = file.rename(tmp_path / 'drive.data')
    assert f'holds {storage} data, and its name does not end with {file.suffix}' in refusal(renamed)


def test_a_damaged_sqlite_file_says_how_to_save_what_it_holds(tmp_path):
    (file,) = small_bag(tmp_path / 'a bag', 'sqlite3').glob('*.db3')
    file.write_bytes(file.read_bytes()[:6000])
    assert f"sqlite3 '{file}' .recover" in refusal(file)


def test_an_mcap_file_whose_index_is_damaged_says_how_to_mend_it(tmp_path):
    folder = small_bag(tmp_path / 'bag')
    (file,) = folder.glob('*.mcap')
    content = file.read_bytes()
    file.write_bytes(content[:-40] + bytes(30) + content[-10:])
    for path in (file, folder):
        assert f'a damaged mcap file; mend it: mcap recover {file}' in refusal(path)
    file.write_bytes(b'xx' + content[2:])
    assert 'bag.mcap is no file of a bag, or its start is damaged' in refusal(folder)


def test_damage_within_a_bag_is_named_without_the_words_of_a_library(tmp_path):
    raw = [('/scan', stamp, b'\0\1\0\0abc' if stamp > 2 else laser_scan(stamp)) for stamp in (1, 2, 3)]
    recording = open_recording(write_bag(tmp_path / 'bag', raw))
    assert recording.stamps() == [1, 2]
    assert recording.problems == ['bag: damaged message 3 on /scan skipped']
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    content = file.read_bytes()
    file.write_bytes(content[:len(content) // 3] + bytes(200) + content[len(content) // 3 + 200:])
    assert refusal(file).endswith('messages from number 1 of /scan cannot be read, the bag is damaged')


def test_messages_that_damage_has_hidden_are_counted(tmp_path):
    folder = write_bag(tmp_path / 'bag', [('/scan', stamp, laser_scan(stamp)) for stamp in range(1, 31)])
    (file,) = folder.glob('*.mcap')
    content = file.read_bytes()
    record = content.index((11).to_bytes(8, 'little') * 2) - 15
    file.write_bytes(content[:record] + bytes(9) + content[record + 9:])
    recording = open_recording(file)
    read = len(recording.stamps())
    assert 0 < read < 30
    assert recording.problems[-1] == f'bag.mcap: {read} of 30 messages of /scan can be read, the bag is damaged'


def split_bag(folder, storage):
    """A bag of three files with four scans each, at 1, 2, 3, ... ns."""
    parts = [write_bag(folder.parent / f'part_{k}', [('/scan', stamp, laser_scan(stamp))
                                                     for stamp in range(1 + 4 * k, 5 + 4 * k)], storage)
             for k in range(3)]
    folder.mkdir()
    files = [next(file for file in part.iterdir() if file.suffix != '.yaml') for part in parts]
    for file in files:
        shutil.copy(file, folder)
    metadata = (parts[0] / 'metadata.yaml').read_text()
    names = ''.join(f'  - {file.name}\n' for file in files)
    (folder / 'metadata.yaml').write_text(metadata.replace(f'  - {files[0].name}\n', names).replace(
        'message_count: 4', 'message_count: 12'))
    return [folder / file.name for file in files]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('damage', ['missing', 'start', 'within'])
def test_of_a_split_bag_the_sound_files_are_read_and_the_other_is_named(tmp_path, storage, damage):
    file = split_bag(tmp_path / 'bag', storage)[1]
    content = file.read_bytes()
    if damage == 'missing':
        file.unlink()
    elif damage == 'start':
        file.write_bytes(bytes(50) + content[50:])
    else:
        middle = len(content) // 3 if storage == 'mcap' else content.rindex(b'front') // 4096 * 4096
        file.write_bytes(content[:middle] + b'\x05' * 200 + content[middle + 200:])
    recording = open_recording(tmp_path / 'bag')
    stamps = recording.stamps()
    assert set(range(1, 13)) - set(range(5, 9)) <= set(stamps)
    assert any(file.name in problem for problem in recording.problems)


@pytest.mark.parametrize(('start', 'command'), [(b'BZh91AY', 'bunzip2'), (b'\xfd7zXZ\0', 'unxz'),
                                                (b'PK\x03\x04', 'unzip'),
                                                (b'\x04\x22\x4d\x18', 'lz4 -d'), (b'7z\xbc\xaf\x27\x1c', '7z x')])
def test_compressed_files_say_how_to_unpack_them(tmp_path, start, command):
    (tmp_path / 'drive.log.x').write_bytes(start + b'\0' * 20)
    assert f'unpack it, {command} {tmp_path / "drive.log.x"}' in refusal(tmp_path / 'drive.log.x')


def test_a_gzip_file_of_a_bag_says_how_to_unpack_it(data, tmp_path):
    import gzip
    path = tmp_path / 'demo.bag.gz'
    path.write_bytes(gzip.compress((data / 'ccny_demo' / 'demo.bag').read_bytes()[:5000]))
    assert 'unpack it, gunzip' in refusal(path)


def test_a_bag_without_scans_names_what_it_holds(tmp_path):
    message = refusal(write_bag(tmp_path / 'bag', [('/chatter', 1, text('hello'))]))
    assert 'holds no sensor_msgs/msg/LaserScan; there are /chatter (std_msgs/msg/String)' in message


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize(('topics', 'message'), [
    ([], 'holds no sensor_msgs/msg/LaserScan; there is no topic at all'),
    (['/a'], 'no readable scan on /a: there is no message'),
    (['/a', '/b'], 'none of its topics of scans holds a message: /a, /b')])
def test_a_bag_without_messages_is_refused_with_its_topics(tmp_path, storage, topics, message):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for topic in topics:
            writer.add_connection(topic, 'sensor_msgs/msg/LaserScan', typestore=get_typestore(Stores.ROS2_JAZZY))
    assert refusal(tmp_path / 'bag').endswith(message)


def test_the_one_topic_that_has_messages_is_taken_and_said(cases):
    recording = open_recording(cases / 'topic_without_messages')
    assert recording.topic == '/scan_back' and len(recording.stamps()) == 15
    assert recording.notes == ['scans are taken from /scan_back; of the topics of scans (/scan_back, /scan_front) no '
                               'other '
                               'holds a message']
    with pytest.raises(RecordingError, match='no readable scan on /scan_front: there is no message'):
        open_recording(cases / 'topic_without_messages', '/scan_front')


@pytest.fixture(params=['pipe', 'socket', 'device', 'folder'])
def no_file(request, tmp_path):
    path = tmp_path / 'metadata.yaml'
    if request.param == 'pipe':
        os.mkfifo(path)
    elif request.param == 'socket':
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(str(path))
            yield request.param, path
        return
    elif request.param == 'folder':
        path.mkdir()
    else:
        path = '/dev/zero'
    yield request.param, path


def refused(path, *readers):
    """The error that each reader raises; run in a child, which can be ended when it waits for ever."""
    return [error_of(read, path) for read in readers]


def error_of(read, path):
    try:
        read(path)
    except DbscanRegError as error:
        return type(error), str(error)
    return type(None), ''


def test_what_is_no_file_is_refused_at_once(no_file):
    kind, path = no_file
    readers = [(read_parameters, ParameterError), (load_relations, RecordingError), (read_csv, RecordingError),
               (read_tum, RecordingError), (read_snapshot, RecordingError)]
    if kind != 'folder':
        readers.append((open_recording, RecordingError))
    errors, _ = in_child(refused, path, *(read for read, _ in readers), timeout=60)
    for (_, expected), (error, message) in zip(readers, errors, strict=True):
        assert issubclass(error, expected)
        assert f'{path}: expected a file, and it is a {kind}' in message


def test_a_pipe_in_the_folder_of_a_bag_is_refused_at_once(tmp_path):
    folder = small_bag(tmp_path / 'bag')
    (folder / 'bag.mcap').unlink()
    os.mkfifo(folder / 'bag.mcap')
    ((error, message),), _ = in_child(refused, folder, open_recording, timeout=60)
    assert error is RecordingError and 'bag.mcap: expected a file, and it is a pipe' in message
    (folder / 'metadata.yaml').unlink()
    os.mkfifo(folder / 'metadata.yaml')
    ((error, message),), _ = in_child(refused, folder, open_recording, timeout=60)
    assert error is RecordingError and 'expected a file, and it is a pipe' in message
