# SPDX-License-Identifier: Apache-2.0
"""The interface of a recording of scans."""
import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import RecordingError
from ..core.geometry.mounting import Mounting
from ..core.scan import Scan
from .checks.scan_checks import ScanWatch
from .message_fields import pose_only_fields
from .playback import ODOMETRY, Channel, Played, Schedule

MOST_PROBLEMS = 1000
"""Maximum number of damaged parts of a recording that are named."""
LONGEST_PROBLEM = 300
"""Maximum length of the text on one damaged part [characters]."""


StampedPoses: TypeAlias = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad]."""


class Record(NamedTuple):
    """A scan with the poses recorded for it: x [m], y [m], theta [rad]; zero where no pose was recorded."""

    scan: Scan
    laser_pose: tuple[float, float, float]
    robot_pose: tuple[float, float, float]


class Recording:
    """Recorded scans, read from the disk at every pass and one at a time.

    Attributes
    ----------
    path : Path
    name : str
        Name of the file without its endings and without dots at either end, so that it can name a folder.
    topic : str
        The topic, or CARMEN message, from which the scans are read.
    frame_id : str
        The coordinate frame of the first scan.
    count : int
        Number of scans according to the recording, damaged ones included.
    mounting : Mounting or None
        Mounting of scans that have the axes of the base, as they were made of point clouds; None: the scans are in the
        frame of the lidar.
    """

    topic: str
    frame_id: str
    count: int
    mounting: Mounting | None = None

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        whole = self.path.resolve().name if self.path.is_dir() else self.path.name
        stem = whole if self.path.is_dir() else whole.removesuffix('.gz').rpartition('.')[0] or whole
        self.name = stem.strip('.') or 'recording'
        self._problems: dict[str, None] = {}
        self._notes: dict[str, None] = {}
        self._watch = ScanWatch()

    def __len__(self) -> int:
        return self.count

    def __repr__(self) -> str:
        """Return one line."""
        return f'{type(self).__name__}({str(self.path)!r}, {self.count} scans on {self.topic})'

    @property
    def notes(self) -> list[str]:
        """One line for each assumption that was made to read the recording; damage is listed in `problems`."""
        return list(self._notes)

    @property
    def problems(self) -> list[str]:
        """One line for each damaged part that was skipped so far, up to `MOST_PROBLEMS`."""
        return list(self._problems)

    @property
    def watch(self) -> ScanWatch:
        """Warnings about the scans, from the pass that read the most scans."""
        return self._watch

    def look_through(self, most: int | None = None) -> ScanWatch:
        """Read all scans, or the first `most`, unless a pass has read them already; return the warnings about them."""
        if self._watch.seen < (self.count if most is None else min(self.count, most)):
            for _ in islice(self.scans(), most):
                pass
        return self._watch

    def scans(self) -> Iterator[Scan]:
        """Return an iterator over the scans in the order of the file, which is that of measurement; stamps may go back.

        Scans with equal beam angles share one `ScanGeometry`.
        """
        raise NotImplementedError

    def records(self) -> Iterator[Record]:
        """Return an iterator over the `Record` of each scan, in the order of `scans`."""
        raise NotImplementedError

    def stamps(self) -> list[int]:
        """Return the stamps of all scans [ns], in the order of the file."""
        return [scan.stamp for scan in self.scans()]

    def wheel_odometry(self) -> StampedPoses | None:
        """Return raw wheel odometry: stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad] of the base, or None."""
        return None

    def yaw_rates(self) -> StampedPoses | None:
        """Return the yaw rates of a gyroscope: stamps ``(N,)`` [ns] and rates ``(N,)`` [rad/s], or None."""
        return None

    def truth(self) -> StampedPoses | None:
        """Return ground-truth poses of the laser: stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad], or None."""
        return None

    def mounting_on(self, base_frame: str) -> Mounting:
        """Return the mounting of the lidar on `base_frame` according to the recording.

        Raises a MountingError when the recording does not contain it.
        """
        raise NotImplementedError

    def lidar_topics(self, _base_frame: str) -> list[str]:
        """Return `topic`, or TOPIC:FRAME for each frame of the scans, if the mountings of several are recorded."""
        return [self.topic]

    def channels(self) -> list[Channel]:
        """Return the `Channel` of every topic except the topic of the scans."""
        return [Channel('wheel_odom', ODOMETRY, input='wheel_odom')] if self.wheel_odometry() else []

    def play(self, channels):
        """Yield `Played`: the scans in the order of `scans`, and between them the messages of the `channels`."""
        wheels = _wheels(*self.wheel_odometry(), channels[0]) if channels else iter(())
        schedule, ahead = Schedule(), next(wheels, None)
        for scan in self.scans():
            now = schedule.time(scan.stamp)
            while ahead and ahead.time <= now:
                yield ahead
                ahead = next(wheels, None)
            yield Played(scan, now)

    def note(self, assumption):
        """Add a line to `notes`."""
        self._notes[assumption] = None

    def _report(self, problem):
        if len(self._problems) >= MOST_PROBLEMS:
            problem = 'there are more problems than these'
        self._problems[problem if len(problem) <= LONGEST_PROBLEM else f'{problem[:LONGEST_PROBLEM]}...'] = None

    def _look(self, watch, fields, further=()):
        """Check the next scan of a pass with the `ScanWatch` of that pass; `further` are other warnings about it."""
        watch.look(fields, further)
        if watch.seen > self._watch.seen:
            self._watch = watch

    def _choose(self, counts, topic):
        """Set `topic` and `count` from `counts` (topic -> number of scans), which must contain a given `topic`."""
        held = ', '.join(sorted(counts)) or 'none'
        if not counts:
            raise RecordingError(f'{self.path}: holds no laser scan')
        if topic is not None and topic not in counts:
            raise RecordingError(f'{self.path}: no scans on {topic!r}; topics of scans: {held}')
        filled = [topic] if topic is not None else _with_scans(counts)
        if len(filled) > 1 and not any(counts.values()):
            raise RecordingError(f'{self.path}: none of its topics of scans holds a message: {held}')
        if len(filled) > 1:
            raise RecordingError(f'{self.path}: choose one of its {len(filled)} topics of scans: {", ".join(filled)} '
                                 '(--topic; most commands take it more than once, for several lidars)')
        self.topic = filled[0]
        if topic is None and len(counts) > 1:
            self.note(f'scans are taken from {self.topic}; of the topics of scans ({held}) no other holds a message')
        self.count = counts[self.topic]


def _with_scans(counts):
    """Return the topics with at least one scan, in alphabetical order; all topics if none has a scan."""
    return [topic for topic in sorted(counts) if counts[topic]] or sorted(counts)


def _wheels(stamps, poses, channel):
    """Yield the wheel odometry as `Played` messages, in the order of the file."""
    schedule = Schedule()
    for stamp, pose in zip(map(int, stamps), poses, strict=True):
        yield Played(pose_only_fields(stamp, 'base_link', pose), schedule.time(stamp), channel)
