# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs, text files with one message on each line."""
import gzip
import re
from collections import Counter, defaultdict
from functools import partial

import numpy as np

from ...core.errors import RecordingError, ScanError
from ...core.geometry.mounting import Mounting, MountingError
from ..checks.scan_checks import ScanFields, ScanWatch
from ..files import UNREADABLE, reason_of
from ..recording import Record, Recording
from .lines import FRONT, KINDS, SETTINGS, read_line, read_odometry, set_parameter
from .survey import Survey

LONGEST_LINE = 2**22
"""Reading stops at a line of this many characters or more, because no line of a log is that long."""
MOST_KINDS = 20
"""Number of kinds of lines that the error message names if no line contains a scan."""

_MESSAGE = re.compile(r'[A-Za-z_][A-Za-z_0-9]{0,39}')


class CarmenLog(Recording):
    """A CARMEN log, plain or gzip.

    ``FLASER``, ``RLASER`` and ``LASER3`` hold no angles: their n beams span 180 degrees from -90 on, 180 / n apart for
    even n and 180 / (n - 1) for odd n. In ``ROBOTLASER1``, ``RAWLASER1`` and so on a reading of the maximum range is a
    missing return. The stamp of a scan is the ipc_timestamp, the third value from the end of the line.

    Properties of the whole log are determined once, when it is opened: which stamps are usable, which reading means a
    missing return, and which poses are the ground truth.
    """

    def __init__(self, path, topic=None):
        super().__init__(path)
        counts, others, surveys = self._survey()
        if not counts:
            damage = f'; first problem: {self.problems[0]}' if self.problems else ''
            raise RecordingError(f'{self.path}: holds no laser scan; lines that are read: {", ".join(KINDS)}; lines of '
                                 f'the file: {_named(others)}{damage}')
        front = {kind: count for kind, count in counts.items() if kind in FRONT}
        self._choose(front if front and topic is None else counts, topic)
        if topic is None and len(front) not in (0, len(counts)):
            rest = ', '.join(sorted(counts.keys() - front.keys()))
            self.note(f'scans are taken from the {self.topic} lines; other lines with scans: {rest}')
        self._found = surveys[self.topic].findings('NEFF' in others)
        for note in self._found.notes:
            self.note(note)
        first = next(self.scans(), None)
        if first is None:
            raise RecordingError(f'{self.path}: no readable scan; first problem: {self.problems[0]}')
        self.frame_id = first.frame_id

    def scans(self):
        """Yield each `Scan` of the chosen kind of lines, in the order of the file."""
        for record in self.records():
            yield record.scan

    def records(self):
        """Yield each `Record` of the chosen kind of lines: the scan, and the poses of laser and robot in its line."""
        geometry, found, watch = None, self._found, ScanWatch()
        given = zip(found.stamps, found.laser, found.robot, strict=True)
        for (_, line, settings), (stamp, laser, robot) in zip(self._messages((self.topic,)), given, strict=False):
            scan = line.scan(settings, geometry, stamp, found.no_return)
            geometry = scan.geometry
            ranges = np.where(line.missing & (line.ranges <= line.range_max), np.inf, line.ranges)
            if found.no_return is not None:
                ranges = scan.ranges
            self._look(watch, ScanFields.from_scan(scan)._replace(ranges=ranges))
            yield Record(scan, tuple(laser.tolist()), tuple(robot.tolist()))

    def stamps(self):
        """Return the stamps of all scans [ns], corrected by `stamps.mend`, without reading the file again."""
        return list(self._found.stamps)

    def wheel_odometry(self):
        """Return stamps and poses of the wheel odometry; None if all poses are zero, as in logs without a robot."""
        return self._poses(self._found.robot) if self._found.robot.any() else None

    def truth(self):
        """Return stamps and poses of the laser if its poses were corrected afterwards (see `Findings`), else None."""
        return self._poses(self._found.laser) if self._found.corrected else None

    def mounting_on(self, base_frame) -> Mounting:
        """Return the pose of the laser on the robot by the poses in its lines; raise a MountingError without one."""
        if self._found.mounting is None:
            raise MountingError('its lines have no poses of the laser with a constant offset from those of the robot')
        return Mounting(self._found.mounting)

    def _poses(self, poses):
        return np.array(self._found.stamps, dtype=np.int64), poses.copy()

    def _survey(self):
        """Return kind -> number of lines with scans, kind -> number of other lines, and kind -> `Survey`."""
        counts, others = Counter(), Counter()
        surveys, odometry = defaultdict(Survey), None
        for kind, message, _ in self._messages((*KINDS, 'ODOM'), counts, others):
            if kind == 'ODOM':
                odometry = message
                for survey in surveys.values():
                    survey.wheels.add_odometry(*odometry)
                continue
            if odometry and kind not in surveys:
                surveys[kind].wheels.add_odometry(*odometry)
            surveys[kind].add(message)
        return counts, others, surveys

    def _messages(self, wanted, counts=None, others=None):
        """Yield kind, content (`Line`; for ``ODOM`` stamp and pose) and settings of the lines of the kinds `wanted`.

        Damaged lines are skipped. If `counts` and `others` are given, the number of lines of each kind is added to
        them, damaged lines included: to `counts` for lines with scans, to `others` for all other lines.
        """
        settings = dict(SETTINGS)
        for number, kind, words in self._lines():
            if counts is not None:
                (counts if kind in KINDS else others)[kind] += 1
            try:
                if kind == 'PARAM':
                    set_parameter(settings, words.split())
                elif kind in wanted:
                    yield kind, _read(kind, words.split(), settings), settings
            except IndexError:
                self._report(f'{self.path.name}:{number}: damaged {kind} skipped: too few values')
            except (ScanError, ValueError) as error:
                self._report(f'{self.path.name}:{number}: damaged {kind} skipped: {error}')

    def _lines(self):
        """Yield line number, kind and the remaining text of every message."""
        number = 0
        open_text = gzip.open if _is_gzip(self.path) else open
        with open_text(self.path, 'rt', encoding='utf-8-sig', errors='replace') as file:
            try:
                for number, line in enumerate(iter(partial(file.readline, LONGEST_LINE), ''), 1):
                    if len(line) == LONGEST_LINE:
                        self._report(f'{self.path.name}:{number}: cannot be read from here on: '
                                     f'the line has {LONGEST_LINE} characters or more')
                        return
                    kind, words = (*line.split(None, 1), '', '')[:2]
                    if _MESSAGE.fullmatch(kind):
                        yield number, kind, words
                    elif kind and not kind.startswith('#'):
                        self._report(f'{self.path.name}:{number}: not a CARMEN message, skipped')
            except UNREADABLE as error:
                self._report(f'{self.path.name}:{number + 1}: cannot be read from here on: {reason_of(error)}')


def _named(counts):
    """Return the most frequent kinds of lines as text, with the number of lines of each kind."""
    kinds = counts.most_common(MOST_KINDS)
    return ', '.join(f'{count} {kind}' for kind, count in kinds) or 'none that is known'


def _read(kind, words, settings):
    if kind == 'ODOM':
        return read_odometry(words)
    line = read_line(kind, words)
    line.geometry(settings)
    return line


def _is_gzip(path):
    with open(path, 'rb') as file:
        return file.read(2) == b'\x1f\x8b'
