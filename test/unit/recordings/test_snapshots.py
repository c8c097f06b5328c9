# SPDX-License-Identifier: Apache-2.0
"""Snapshots: the results of the last scans are written and read without loss."""
import math

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Parameters, Prior, RecordingError, Scan
from dbscan_reg_ros.recordings.snapshots import Snapshot, SnapshotUpdate, read_snapshot, write_snapshot


@pytest.fixture(scope='module')
def updates(drive):
    odometry = Odometry(Parameters())
    scans = [*drive.scans[:4], Scan.from_points(drive.scans[4].points, stamp=drive.scans[4].stamp)]
    pairs = []
    for k, scan in enumerate(scans):
        prior = Prior(pairs[-1][0].increment, np.diag([0.1, 0.1, 0.05]) ** 2) if k == 3 else None
        pairs.append((odometry.process(scan, prior), prior))
    return pairs


@pytest.fixture
def written(updates, tmp_path):
    path = tmp_path / 'snapshot.npz'
    parameters = {name: list(value) if isinstance(value, tuple) else value for name,
                  value in Parameters().flatten().items()}
    write_snapshot(path, Snapshot(parameters, [SnapshotUpdate.of(*pair) for pair in updates]))
    return path


def test_everything_is_read_back_unchanged(written, updates):
    snapshot = read_snapshot(written)
    assert Parameters().replace(snapshot.parameters) == Parameters()
    assert len(snapshot.updates) == len(updates)
    for read, (update, prior) in zip(snapshot.updates, updates, strict=True):
        scan = update.features.scan
        assert read.scan.ranges.tobytes() == scan.ranges.tobytes()
        assert (read.scan.geometry, read.scan.stamp, read.scan.frame_id) == (scan.geometry, scan.stamp, scan.frame_id)
        assert (read.stamp, read.interval, read.pose, read.status) == (
            update.stamp, update.interval, update.pose, update.status)
        np.testing.assert_array_equal(read.covariance, update.covariance)
        assert (read.prior is None) == (prior is None)
        if prior:
            assert read.prior.transform == prior.transform
            np.testing.assert_array_equal(read.prior.covariance, prior.covariance)
        if update.registration is None:
            assert read.registration is read.reference is None
            continue
        assert read.reference.ranges.tobytes() == update.reference.scan.ranges.tobytes()
        for name in ('transform', 'status', 'reason', 'overlap', 'score', 'degenerate_direction',
                     'weakest_information'):
            assert getattr(read.registration, name) == getattr(update.registration, name)
        assert [(h.transform, h.score) for h in read.registration.hypotheses] == [
            (h.transform, h.score) for h in update.registration.hypotheses]
        np.testing.assert_array_equal(read.registration.covariance, update.registration.covariance)
        np.testing.assert_array_equal(read.registration.matches, update.registration.matches)


def test_the_file_needs_no_pickle_and_leaves_no_part_behind(written):
    with np.load(written, allow_pickle=False) as archive:
        assert all(archive[name].dtype != object for name in archive.files)
    assert [path.name for path in written.parent.iterdir()] == ['snapshot.npz']


@pytest.mark.parametrize('content', [b'', b'nonsense', b'PK\x03\x04 broken'])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / 'other.npz'
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r'other\.npz: no snapshot'):
        read_snapshot(path)


def test_other_archives_and_missing_files_are_refused(tmp_path):
    np.savez(tmp_path / 'other.npz', a=np.array([math.pi]))
    with pytest.raises(RecordingError, match='no snapshot'):
        read_snapshot(tmp_path / 'other.npz')
    np.savez(tmp_path / 'newer.npz', snapshot=np.frombuffer(b'{"format": "dbscan_reg_ros snapshot", "version": 9}',
                                                            np.uint8))
    with pytest.raises(RecordingError, match='version 9'):
        read_snapshot(tmp_path / 'newer.npz')
    with pytest.raises(RecordingError, match='cannot be read: No such file'):
        read_snapshot(tmp_path / 'none.npz')
