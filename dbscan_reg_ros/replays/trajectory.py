# SPDX-License-Identifier: Apache-2.0
"""Trajectory of the sensor of a recording, as the odometry estimates it."""
from collections import Counter
from dataclasses import dataclass, field
from time import perf_counter, process_time

import numpy as np

from ..core.errors import DbscanRegError, ScanError
from ..core.geometry.se2 import SE2
from ..core.registration.records import Status
from ..evaluation.metrics import duration, errors, path_lengths
from .lidars import turned


@dataclass(eq=False)
class Trajectory:
    """Results of the odometry for the usable scans of a recording, in the order of the file."""

    yaw: float = 0.0
    """Angle [rad] by which `lidars.turned` rotated the scans before the odometry."""
    upside_down: bool = False
    """Whether the laser of the recording is mounted upside down."""
    stamps: list[int] = field(default_factory=list)
    """[ns]"""
    poses: list = field(default_factory=list)
    """list of (x, y, theta) [m, m, rad]: poses of the sensor, in the frame of the first scan."""
    statuses: list = field(default_factory=list)
    """list of Status"""
    milliseconds: list[float] = field(default_factory=list)
    """Processing time of each scan [ms]."""
    processor_seconds: float = 0.0
    """Processor time of all scans together [s]."""
    used: list[bool] = field(default_factory=list)
    """Whether each scan of the recording was used."""
    problems: list[str] = field(default_factory=list)
    """For each scan that was not used, its number, from 0, and the reason."""
    numbers: list[int] = field(default_factory=list)
    """Number of each scan of the recording among those of all lidars, as `ReplayOdometry.numbers`; empty for a single
    lidar."""
    restarts: int = 0
    """Number of restarts of the tracking at the last pose."""
    explanation: str = ''
    """For the trajectory of another program: which scans have a pose in it, and why others have none."""
    interpolated: int = 0
    """For the trajectory of another program: how many poses are interpolated between two of its poses."""
    contradictions: int = 0
    """Number of scans that contradict the wheels."""
    contradicted: tuple[float, str] = (0.0, '')
    """By how much [m] one of them does most, and a sentence about it."""

    def follow(self, scans, odometry):
        """Process `scans` with `odometry`, an `Odometry` or a `ReplayOdometry`; yield each result."""
        turn = SE2(theta=self.yaw)
        for count, scan in enumerate(scans):
            begin, processor = perf_counter(), process_time()
            try:
                update = odometry.process(scan)
            except ScanError as error:
                self.used.append(False)
                self.problems.append(f'scan {self.number(count)} not used: {error}')
                continue
            self.milliseconds.append(1e3 * (perf_counter() - begin))
            self.processor_seconds += process_time() - processor
            self.used.append(True)
            self.stamps.append(scan.stamp)
            pose = turn.inverse() @ update.pose @ turn
            self.poses.append((pose.x, pose.y, pose.theta))
            self.statuses.append(update.status)
            self.restarts += bool(update.restarted) and update.registration is None
            self.contradictions += update.contradicted is not None
            self.contradicted = max(self.contradicted, (update.contradicted_by, update.contradiction))
            yield update

    def number(self, count):
        """Return the number of the scan, among those of all lidars, before which `count` scans of this lidar came."""
        if count < len(self.numbers):
            return self.numbers[count]
        return self.numbers[-1] + 1 if self.numbers else count

    @property
    def used_numbers(self):
        """Numbers ``(N,)`` of the used scans, among the scans of all lidars."""
        return np.array([self.number(count) for count in np.flatnonzero(self.used)], dtype=int)

    @property
    def registered(self):
        """List of bool: whether each used scan was registered; the first scan of all counts as registered."""
        return [status is not Status.FAILED for status in self.statuses]

    def usable(self, scans):
        """Yield the `scans` of the recording that the odometry used, converted to those of an upright laser."""
        upright = turned(scans, 0.0, self.upside_down)
        return (scan for used, scan in zip(self.used, upright, strict=False) if used)

    def pose_array(self):
        """Poses of the used scans ``(N, 3)`` [m, m, rad], in the frame of the first used scan."""
        return np.array(self.poses, dtype=float).reshape(-1, 3)

    def measures(self, jump) -> dict:
        """Count the scans by outcome; measure the time per scan and the distance driven.

        ``skipped`` counts scans that could not be used, ``failed`` scans that were not registered. ``duration_s`` is
        the sum of the steps of the stamps, except ``stamp_jumps`` steps of more than `jump` [s]. ``end_m`` and
        ``end_deg`` are the distance and rotation from the first to the last pose.
        """
        counts = Counter(self.statuses)
        measures: dict[str, float] = {'scans': len(self.used), 'skipped': self.used.count(False)}
        measures |= {status.value: counts[status] for status in Status} | {'restarts': self.restarts}
        if self.poses:
            poses = self.pose_array()
            (end_m,), (end_deg,) = errors(poses[-1:], poses[:1])
            seconds, jumps = duration(self.stamps, jump)
            measures |= {'driven_m': float(path_lengths(poses)[-1]), 'duration_s': seconds, 'stamp_jumps': jumps,
                         'end_m': float(end_m), 'end_deg': float(end_deg)}
        if self.milliseconds:
            measures |= {f'ms_p{q}': float(np.percentile(self.milliseconds, q)) for q in (50, 95, 99)}
            count = self.number(len(self.used) - 1) + 1 if self.numbers else len(self.milliseconds)
            measures['processor_ms_mean'] = 1e3 * self.processor_seconds / count
        return measures


def too_few(recording, trajectory) -> DbscanRegError:
    """Make the error for a recording with fewer than two usable scans."""
    count = len(trajectory.used)
    if count == 1 and trajectory.poses:
        return DbscanRegError(f'{recording.path}: contains one scan; expected at least two, so that '
                              'there is a motion between them')
    usable = 'only one' if trajectory.poses else 'not one'
    return DbscanRegError('; '.join([f'{recording.path}: {usable} of {count} scans could be used',
                                     *trajectory.problems[:1], *recording.watch.lines()]))
