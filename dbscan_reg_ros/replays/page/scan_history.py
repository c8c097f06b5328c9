# SPDX-License-Identifier: Apache-2.0
"""Scans of a drive for the page of a replay: returns, segments, covariance and status, in bounded memory."""
import zlib
from typing import NamedTuple

import numpy as np

from ...core.geometry.se2 import SE2, turned
from ...core.registration.records import Status
from .encoding import packed

RESOLUTION = 0.005
"""Resolution of the stored coordinates [m]: with 16 bits they reach 163 m."""
LARGEST = 32767
MOST_SCANS = 20_000
"""Largest number of scans with status OK that are kept."""
MOST_NOT_OK = 60_000
"""Largest number of scans with a status other than OK that are kept."""
MOST_POINTS = 2_500_000
"""Largest total number of points (returns and segment ends) of all scans that are kept."""


class ScanRecord(NamedTuple):
    """Data of one scan that the page shows."""

    number: int
    reference_number: int
    """Numbers of the scan and of its reference among the scans used, from 0; -1: no reference."""
    status: Status
    reason: str
    """Why the status is not ``OK``, or why tracking restarted."""
    overlap: float
    """Fraction of the returns on the reference's surfaces, 0..1; 0 if not registered."""
    key_frame: bool
    covariance: np.ndarray
    """Covariance of the pose (x, y, theta) in the frame of the trajectory [m, m, rad] ``(3, 3)``."""
    points: np.ndarray
    """Returns in the frame of the sensor, in units of `RESOLUTION` ``(P, 2)`` int16."""
    segments: np.ndarray
    """Start and end of each segment, in the same frame and units as `points` ``(K, 4)`` int16."""


class ScanHistory:
    """Collect a `ScanRecord` of each scan; of long drives only every n-th scan and beam.

    Parameters
    ----------
    yaw : float
        Angle [rad] by which `lidars.turned` rotated the scans before the odometry.
    most_scans, most_points : int
        Largest number of OK scans and of returns that are kept; if there are more, every second one is dropped.

    Attributes
    ----------
    scan_step, not_ok_step, beam_step : int
        Every n-th OK scan, every n-th scan with another status and every n-th beam are kept: the three n, powers of
        two.
    """

    def __init__(self, yaw=0.0, most_scans=MOST_SCANS, most_points=MOST_POINTS):
        self._back = SE2(theta=-yaw)
        self._most = {True: most_scans, False: MOST_NOT_OK}
        self._most_points = most_points
        self._steps = {True: 1, False: 1}
        self._counts = {True: 0, False: 0}
        self._seen = {True: 0, False: 0}
        self._records, self._points = [], 0
        self.beam_step = 1

    @property
    def scan_step(self) -> int:
        """Every n-th scan with status OK is kept, where n is this value."""
        return self._steps[True]

    @property
    def not_ok_step(self) -> int:
        """Every n-th scan with a status other than OK is kept, where n is this value."""
        return self._steps[False]

    def add(self, update):
        """Store the `OdometryUpdate` of the next scan for the page."""
        self._take(update.status, update.number, lambda: self._record(update))

    def add_scan(self, number, scan, status=Status.OK):
        """Store the next scan of a method that reports no registration, only a pose and the `status`."""
        self._take(status, number, lambda: ScanRecord(
            number, -1, status, '', 0.0, False, np.zeros((3, 3)), _stored(scan.points[scan.valid])[::self.beam_step],
            np.empty((0, 4), dtype=np.int16)))

    def _take(self, status, number, make_record):
        """Store the record of a scan, unless `scan_step` or `not_ok_step` skips the scan."""
        ok = status is Status.OK
        place = self._seen[ok]
        self._seen[ok] += 1
        if place % self._steps[ok] and number:
            return
        record = make_record()
        self._records.append((place, record))
        self._counts[ok] += 1
        self._points += _size(record)
        if self._counts[ok] > self._most[ok]:
            self._drop_scans(ok)
        if self._points > self._most_points:
            self._drop_beams()

    def records(self) -> list:
        """All stored `ScanRecord` objects, in the order of the scans."""
        return [record for _, record in self._records]

    def _record(self, update):
        registration, segments = update.registration, update.features.segments
        points = update.features.scan.points[update.features.scan.valid]
        if self._back.theta:
            points = self._back.apply(points)
        ends = self._back.apply(np.concatenate((segments.start, segments.end), axis=1).reshape(-1, 2)).reshape(-1, 4)
        return ScanRecord(
            update.number, -1 if update.reference_number is None or registration is None else update.reference_number,
            update.status, (registration.reason if registration else '') or update.restarted,
            registration.overlap if registration else 0.0, update.is_key_frame or registration is None,
            turned(update.covariance, self._back.theta), _stored(points)[::self.beam_step], _stored(ends))

    def _drop_scans(self, ok):
        """Drop every second scan: with `ok` of those with status OK, else of all others."""
        self._steps[ok] *= 2
        self._records = [(place, record) for place, record in self._records if (record.status is Status.OK) is not ok
                         or place % self._steps[ok] == 0 or record.number == 0]
        self._counts[ok] = sum((record.status is Status.OK) is ok for _, record in self._records)
        self._points = sum(_size(record) for _, record in self._records)

    def _drop_beams(self):
        """Drop every second return of all scans."""
        self.beam_step *= 2
        self._records = [(place, record._replace(points=record.points[::2].copy())) for place, record in self._records]
        self._points = sum(_size(record) for _, record in self._records)


def _size(record):
    """Return the number of points in a record: returns and segment ends."""
    return len(record.points) + 2 * len(record.segments)


def _stored(coordinates):
    """Return coordinates ``(..., D)`` [m] in units of `RESOLUTION`, without rows that exceed int16."""
    units = np.rint(coordinates / RESOLUTION)
    return units[(np.abs(units) <= LARGEST).all(axis=-1)].astype(np.int16)


def packed_scans(records) -> str:
    """Return returns and segments of all scans, compressed, as the base64 text of an int16 array.

    The array contains the coordinates of all returns, each as the difference from the previous one, which compresses
    better, and then start and end of all segments.
    """
    points = np.concatenate([np.empty((0, 2), dtype=np.int16), *(record.points for record in records)])
    steps = np.diff(points, axis=0, prepend=np.zeros((1, 2), dtype=np.int16))
    segments = np.concatenate([np.empty((0, 4), dtype=np.int16), *(record.segments for record in records)])
    content = np.concatenate((steps.ravel(), segments.ravel())).astype('<i2')
    return packed(np.frombuffer(zlib.compress(content.tobytes(), 6), dtype=np.uint8), np.uint8)
