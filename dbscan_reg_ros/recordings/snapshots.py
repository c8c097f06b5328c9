# SPDX-License-Identifier: Apache-2.0
"""Snapshots: the last scans of a running odometry and its results for them, in one file.

The file is an ``.npz`` archive of plain numpy arrays, read without pickle:

``snapshot``
    uint8, the bytes of a JSON text (UTF-8)::

        {"format": "dbscan_reg_ros snapshot", "version": 1, "package": "0.1.0",
         "parameters": {"group.field": value, ...},
         "scans": [{"stamp": ns, "frame_id": "laser", "time_increment": s, "angle_min": rad, "angle_increment": rad,
                    "range_min": m, "range_max": m or null}, ...],
         "updates": [{"scan": index, "reference": index or null, "stamp": ns, "interval": s, "pose": [x, y, theta],
                      "reference_pose": [x, y, theta], "status": "ok", "restarted": "", "prior": [x, y, theta] or null,
                      "registration": null or {"transform": [x, y, theta], "status": "ok", "reason": "",
                          "overlap": 0..1, "score": 0..1, "degenerate_direction": rad or null,
                          "weakest_information": points or null, "rotation_unobservable": bool,
                          "confidence": 0..1}}, ...]}

    ``updates`` are in order of time; ``scan`` and ``reference`` are indices of ``scans``, which also contains
    references that are older than the oldest update. Poses are those of the sensor in the odometry frame, m and rad;
    ``prior`` is the motion since the previous update.
``ranges_I``
    float32 (N,) [m], the ranges of scan I.
``bearings_I``
    float64 (N,) [rad], the bearings of scan I, only if they are not uniform.
``hypotheses_K``
    float64 (H, 4): x [m], y [m], theta [rad] and score of each hypothesis of update K, best first.
``covariance_K``, ``registration_covariance_K``, ``prior_covariance_K``
    float64 (3, 3), as in `OdometryUpdate`, `Registration` and `Prior`.
``twist_K``
    float64 (3,), as in `OdometryUpdate`.
``matches_K``
    int64 (M, 2), as in `Registration`.
"""
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..core.errors import RecordingError
from ..core.features.returns import deskew
from ..core.geometry.array_types import FloatArray
from ..core.geometry.se2 import SE2
from ..core.registration.records import Hypothesis, Prior, Registration, Status
from ..core.scan import Scan
from .archives import Archive, scan_fields, scans_of
from .trajectories import finite_numbers

ARCHIVE = Archive('snapshot', 'dbscan_reg_ros snapshot', 1, '~/snapshot', RecordingError)


@dataclass(frozen=True, eq=False)
class SnapshotUpdate:
    """Result of the odometry for one scan, with the attributes of `OdometryUpdate`, but scans instead of features."""

    measured: Scan
    """The scan as it was measured."""
    motion: FloatArray | None
    """Velocity [m/s, m/s, rad/s] with which it was deskewed ``(3,)``."""
    reference: Scan | None
    stamp: int
    interval: float
    pose: SE2
    covariance: np.ndarray
    twist: np.ndarray
    reference_pose: SE2
    status: Status
    registration: Registration | None
    prior: Prior | None
    """External prior of the motion since the previous update."""
    restarted: str

    @classmethod
    def of(cls, update, prior=None) -> 'SnapshotUpdate':
        """Make a `SnapshotUpdate` from an `OdometryUpdate` and the external `Prior` of that update."""
        features = update.features
        return cls(features.measured, features.twist, update.reference.scan if update.reference else None, update.stamp,
                   update.interval, update.scan_pose, update.covariance, update.twist, update.reference_pose,
                   update.status, update.registration, prior, update.restarted)

    @cached_property
    def scan(self) -> Scan:
        """The scan, deskewed."""
        return self.measured if self.motion is None else deskew(self.measured, self.motion)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The last scans of an odometry."""

    parameters: dict
    """Full name -> value of every parameter."""
    updates: list
    """list of SnapshotUpdate: oldest first."""


def write_snapshot(path, snapshot: Snapshot):
    """Write `snapshot` to the file at `path`; the file appears complete or not at all."""
    arrays: dict[str, np.ndarray] = {}
    scans: dict[int, Scan] = {}
    for update in snapshot.updates:
        scans |= {id(scan): scan for scan in filter(None, (update.reference, update.scan))}
    indices = {number: index for index, number in enumerate(scans)}
    fields = scan_fields(scans.values(), arrays)
    updates = [_update_fields(update, k, indices, arrays) for k, update in enumerate(snapshot.updates)]
    ARCHIVE.write(path, {'parameters': snapshot.parameters, 'scans': fields, 'updates': updates}, arrays)


def read_snapshot(path) -> Snapshot:
    """Return the snapshot in the file at `path`.

    Raises a RecordingError when the file cannot be read or is no snapshot.
    """
    return ARCHIVE.read(path, _snapshot)


def _snapshot(fields, arrays):
    """Return the snapshot of the JSON `fields` and the `arrays` of an archive."""
    scans = scans_of(fields['scans'], arrays)
    return Snapshot(fields['parameters'], [_update(each, k, scans, arrays) for k, each in enumerate(fields['updates'])])


def _update_fields(update, k, indices, arrays):
    arrays[f'covariance_{k}'], arrays[f'twist_{k}'] = update.covariance, np.asarray(update.twist)
    if update.prior:
        arrays[f'prior_covariance_{k}'] = update.prior.covariance
    return {'scan': indices[id(update.scan)], 'reference': indices[id(update.reference)] if update.reference else None,
            'stamp': update.stamp, 'interval': float(update.interval), 'pose': _numbers(update.pose),
            'reference_pose': _numbers(update.reference_pose), 'status': update.status.value,
            'restarted': update.restarted, 'prior': _numbers(update.prior.transform) if update.prior else None,
            'registration': _registration_fields(update.registration, k, arrays) if update.registration else None}


def _registration_fields(registration, k, arrays):
    arrays[f'registration_covariance_{k}'] = registration.covariance
    arrays[f'matches_{k}'] = np.asarray(registration.matches, dtype=np.int64).reshape(-1, 2)
    arrays[f'hypotheses_{k}'] = np.array([[*_numbers(h.transform), h.score] for h in registration.hypotheses],
                                         dtype=float).reshape(-1, 4)
    direction, weakest = registration.degenerate_direction, registration.weakest_information
    return {'transform': _numbers(registration.transform), 'status': registration.status.value,
            'reason': registration.reason, 'overlap': float(registration.overlap), 'score': float(registration.score),
            'degenerate_direction': None if direction is None else float(direction),
            'weakest_information': None if weakest is None else float(weakest),
            'rotation_unobservable': registration.rotation_unobservable,
            'confidence': float(registration.confidence)}


def _update(fields, k, scans, arrays):
    prior = registration = None
    if fields['prior'] is not None:
        prior = Prior(_pose(fields['prior']), arrays[f'prior_covariance_{k}'])
    if (found := fields['registration']) is not None:
        hypotheses = tuple(Hypothesis(SE2(x, y, theta), score)
                           for x, y, theta, score in arrays[f'hypotheses_{k}'].tolist())
        registration = Registration(
            _pose(found['transform']), arrays[f'registration_covariance_{k}'], Status(found['status']),
            found['overlap'], found['score'], hypotheses, found['degenerate_direction'],
            partial(np.asarray, arrays[f'matches_{k}']), found['reason'], found['weakest_information'],
            found.get('rotation_unobservable', False), found.get('confidence', 0.0))
    reference = None if fields['reference'] is None else scans[fields['reference']]
    return SnapshotUpdate(scans[fields['scan']], None, reference, fields['stamp'], fields['interval'],
                          _pose(fields['pose']), arrays[f'covariance_{k}'], arrays[f'twist_{k}'],
                          _pose(fields['reference_pose']), Status(fields['status']), registration, prior,
                          fields['restarted'])


def _pose(numbers):
    x, y, theta = finite_numbers(numbers)
    return SE2(x, y, theta)


def _numbers(pose):
    return [float(pose.x), float(pose.y), float(pose.theta)]
