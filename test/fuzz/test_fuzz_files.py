# SPDX-License-Identifier: Apache-2.0
"""Damaged and hostile recordings: a named error or fewer scans, in bounded memory."""
import bz2
import gzip
import shutil
import zipfile
from collections import Counter

import numpy as np
import pytest
from bags import every_format, laser_scan, write_bag
from child import in_child
from damage import damaged_bytes, damaged_text

from dbscan_reg_ros import Parameters, RecordingError
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.recordings import load_relations, open_recording, read_csv, read_tum, write_csv, write_tum
from dbscan_reg_ros.recordings.snapshots import Snapshot, SnapshotUpdate, read_snapshot, write_snapshot

MEMORY = 512 * 2**20
BAGS = 'mcap', 'db3'


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """A folder of small recordings without fault, of every format."""
    folder = tmp_path_factory.mktemp('whole')
    every_format(folder)
    return folder


def read(path):
    """All that a recording gives: the number of its scans."""
    recording = open_recording(path)
    count = sum(1 for _ in recording.records())
    recording.wheel_odometry()
    recording.truth()
    assert len(recording.problems) <= 1001
    return count


def write_damaged(whole, folder, seed):
    """One of the recordings in `whole`, damaged; where it is."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(['log', 'log', 'log.gz', 'bag', 'mcap', 'db3', 'folder']))
    if kind == 'log':
        path = folder / 'damaged.log'
        text = (whole / 'log.log').read_text()
        path.write_bytes(damaged_text(text, rng).encode() if rng.random() < 0.7 else
                         damaged_bytes(text.encode(), rng, (whole / 'other.log').read_bytes()))
    elif kind == 'log.gz':
        path = folder / 'damaged.log.gz'
        path.write_bytes(damaged_bytes((whole / 'log.log.gz').read_bytes(), rng))
    elif kind == 'bag':
        path = folder / 'damaged.bag'
        path.write_bytes(damaged_bytes((whole / 'log.bag').read_bytes(), rng, (whole / 'other.log').read_bytes()))
    elif kind in BAGS:
        path = folder / f'damaged.{kind}'
        path.write_bytes(damaged_bytes((whole / kind / f'{kind}.{kind}').read_bytes(), rng,
                                       (whole / 'log.bag').read_bytes()))
    else:
        path = folder / 'damaged'
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(whole / str(rng.choice(BAGS)), path)
        metadata = path / 'metadata.yaml'
        metadata.write_bytes(damaged_bytes(metadata.read_bytes(), rng, b'&a [*a, *a]\n'))
    return path


def read_damaged(whole, folder, seeds):
    """Numbers of damaged recordings that were refused, read in part and read whole."""
    outcomes = Counter()
    for seed in seeds:
        path = write_damaged(whole, folder, seed)
        try:
            count = read(path)
            outcomes['read' if count >= 8 else 'in part'] += 1
        except RecordingError as error:
            assert path.name in str(error) and '\n' not in str(error), (seed, error)
            outcomes['refused'] += 1
        except Exception as error:
            raise AssertionError(f'recording {seed}: {path.name}') from error
    return outcomes


def test_damaged_recordings_are_refused_or_read_in_part_in_bounded_memory(whole, tmp_path, size):
    count = size(150, 5000)
    outcomes, memory = in_child(read_damaged, whole, tmp_path, range(count), timeout=60 + count)
    print(outcomes, f'{memory / 2**20:.0f} MiB')
    assert outcomes['refused'] and outcomes['in part'] and outcomes['read']
    assert memory < MEMORY


MIB = 2**20
TOO_MUCH = 1024
"""Size of what the bombs unpack to [MiB]: twice the memory that is allowed."""


def endless_line(path):
    path.write_bytes(gzip.compress(b'FLASER 180') + TOO_MUCH * gzip.compress(MIB // 4 * b' 1.0'))


def bz2_bomb():
    return TOO_MUCH * bz2.compress(bytes(MIB))


def lz4_bomb():
    from lz4.frame import LZ4FrameCompressor
    stream = LZ4FrameCompressor()
    return b''.join([stream.begin(), *(stream.compress(bytes(MIB)) for _ in range(TOO_MUCH)), stream.flush()])


def zstd_bomb():
    from rosbags.rosbag2.storage_mcap import zstd
    return TOO_MUCH * zstd.compress(bytes(MIB))


def ros1_bomb(path, name, bomb):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[name])
    writer.compressor = lambda _: bomb
    with writer:
        connection = writer.add_connection('/scan', 'sensor_msgs/msg/LaserScan', typestore=store)
        writer.write(connection, 1, bytes(100))


def mcap_bomb(path):
    """The chunk is a bomb, and the index says that it is small."""
    from rosbags.rosbag2 import (
        CompressionFormat,
        CompressionMode,
        StoragePlugin,
        Writer,
    )
    from rosbags.typesys import Stores, get_typestore
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        writer.storage.compressor = lambda _: zstd_bomb()
        connection = writer.add_connection('/scan', 'sensor_msgs/msg/LaserScan',
                                           typestore=get_typestore(Stores.ROS2_JAZZY))
        writer.write(connection, 1, bytes(100))


def message_bomb(path):
    write_bag(path, [('/scan', 1, zstd_bomb())], 'sqlite3')
    metadata = path / 'metadata.yaml'
    text = metadata.read_text()
    for name, value in (('mode', 'message'), ('format', 'zstd')):
        text = text.replace(f"compression_{name}: ''", f'compression_{name}: {value}')
    metadata.write_text(text)


BOMBS = {
    'line.log.gz': endless_line, 'mcap': mcap_bomb, 'message': message_bomb,
    'bz2.bag': lambda path: ros1_bomb(path, 'BZ2', bz2_bomb()), 'lz4.bag': lambda path: ros1_bomb(path, 'LZ4',
                                                                                                  lz4_bomb()),
}


def refusal(path):
    try:
        read(path)
    except RecordingError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('name', BOMBS)
def test_a_compressed_bomb_is_refused_in_bounded_memory(tmp_path, name):
    path = tmp_path / name
    BOMBS[name](path)
    said, memory = in_child(refusal, path, timeout=60)
    assert path.name in said and len(said) < 1000
    assert memory < MEMORY


def test_the_number_and_length_of_reported_problems_are_limited(tmp_path):
    path = tmp_path / 'a.log'
    good, wide = (f'FLASER 2 1.0 {word} 1 2 0.5 1 2 0.5 12.5 host 0.1\n' for word in ('2.0', 5000 * 'x'))
    path.write_text(good + 1500 * '?\n')
    recording = open_recording(path)
    assert recording.stamps() == [12_500_000_000]
    assert len(recording.problems) == 1001
    assert recording.problems[-1] == 'there are more problems than these'
    path.write_text(good + wide)
    recording = open_recording(path)
    assert recording.stamps() == [12_500_000_000]
    [problem] = recording.problems
    assert problem.startswith("a.log:2: damaged FLASER skipped: 'xxx") and problem.endswith('xxx is not a number')
    assert len(problem) < 200


def test_a_definition_in_a_bag_does_not_decide_how_its_scans_are_read(tmp_path):
    bag = write_bag(tmp_path / 'bag', [('/scan', 1, laser_scan())])
    file = next(bag.glob('*.mcap'))
    before, _, after = file.read_bytes().rpartition(b'float32[] ranges')
    file.write_bytes(before + b'float64[] ranges' + after)
    [scan] = open_recording(file).scans()
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


# Trajectories and relations


TRAJECTORIES = {'tum': read_tum, 'csv': read_csv, 'relations': load_relations}


@pytest.mark.parametrize('kind', TRAJECTORIES)
def test_damaged_trajectories_are_refused_or_finite(tmp_path, size, kind):
    path = tmp_path / f'a.{kind}'
    poses = np.cumsum(np.full((5, 3), 0.1), axis=0)
    if kind == 'tum':
        write_tum(path, range(0, 5 * 10**9, 10**9), poses)
    elif kind == 'csv':
        write_csv(path, poses)
    else:
        path.write_text('1.5 2.5 0.1 0.2 0 0 0 0.3\n2.5 3.5 0.1 0.2 0 0 0 0.3\n')
    text = path.read_text()
    outcomes = Counter()
    for seed in range(size(80, 5000)):
        path.write_text(damaged_text(text, np.random.default_rng(seed)))
        try:
            _, values = TRAJECTORIES[kind](path)
        except RecordingError as error:
            assert path.name in str(error) and len(str(error)) < 1000
            outcomes['refused'] += 1
        else:
            assert np.isfinite(values).all()
            outcomes['read'] += 1
    assert len(outcomes) == 2


# Snapshots


@pytest.fixture(scope='module')
def snapshot(drive, tmp_path_factory):
    """The arrays of a snapshot of three scans, and its file."""
    path = tmp_path_factory.mktemp('snapshot') / 'snapshot.npz'
    odometry = Odometry()
    write_snapshot(path,
                   Snapshot(Parameters().flatten(), [SnapshotUpdate.of(odometry.process(s)) for s in drive.scans[:3]]))
    with np.load(path) as arrays:
        return dict(arrays), path.read_bytes()


def test_a_damaged_snapshot_is_refused_or_read(snapshot, tmp_path, size):
    arrays, content = snapshot
    path, outcomes = tmp_path / 'damaged.npz', Counter()
    for seed in range(size(150, 5000)):
        rng = np.random.default_rng(seed)
        if seed % 2:
            path.write_bytes(damaged_bytes(content, rng))
        else:
            text = damaged_text(arrays['snapshot'].tobytes().decode(), rng)
            name = str(rng.choice(list(arrays)))
            np.savez(path,
                     **(arrays | {name: WRONG[rng.integers(len(WRONG))],
                                  'snapshot': np.frombuffer(text.encode(), np.uint8)}))
        try:
            assert all(isinstance(update, SnapshotUpdate) for update in read_snapshot(path).updates), seed
            outcomes['read'] += 1
        except RecordingError as error:
            assert path.name in str(error), seed
            outcomes['refused'] += 1
    assert outcomes['refused']


WRONG = [np.zeros(0), np.full(3, np.nan), np.zeros((3, 3), dtype=np.int8), np.array('text'), np.zeros(10**4)]


def refused_snapshot(path):
    try:
        read_snapshot(path)
    except RecordingError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('shape', ['true', 'claimed'])
def test_a_snapshot_that_unpacks_to_too_much_is_refused_in_bounded_memory(tmp_path, shape):
    path = tmp_path / 'bomb.npz'
    if shape == 'true':
        with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED, compresslevel=1) as archive, archive.open('snapshot.npy',
                                                                                                        'w') as part:
            np.lib.format.write_array_header_1_0(part,
                                                 {'descr': '|u1', 'fortran_order': False, 'shape': (TOO_MUCH * MIB,)})
            for _ in range(TOO_MUCH):
                part.write(bytes(MIB))
    else:
        np.savez(path, snapshot=np.zeros(10, np.uint8))
        path.write_bytes(path.read_bytes().replace(b"'shape': (10,), }         ", b"'shape': (9999999999,), } "))
    said, memory = in_child(refused_snapshot, path, timeout=60)
    assert 'bomb.npz' in said
    assert memory < MEMORY
