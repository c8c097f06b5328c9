# SPDX-License-Identifier: Apache-2.0
"""One interface to recorded scans, and the function that finds out what a file holds."""
import gzip
import shlex
import zlib
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from ..core.errors import RecordingError
from ..core.scan import Scan
from ..message_fields import pose_only_fields
from ..paths import check_file
from ..scan_checks import ScanWatch
from .bag_faults import kind_of, unpacking_advice
from .playback import ODOMETRY, Channel, Played
from .schedule import Schedule

MOST_PROBLEMS = 1000
"""So many damaged parts of a recording are named."""
LONGEST_PROBLEM = 300
"""In so many characters each: damaged parts may be large."""


def open_recording(path, topic=None) -> 'Recording':
    """The recording at `path`: a CARMEN log (plain or gzip), a ROS 1 bag, a ROS 2 bag (folder, sqlite3 or mcap file).

    Parameters
    ----------
    path : str or Path
    topic : str, optional
        The topic of the scans; for a CARMEN log the name of its message. Needed where there are several.

    Raises
    ------
    RecordingError
        When `path` cannot be read, is empty or of no known format, holds no scan, or several topics
        of scans and none was chosen.
    """
    path = Path(path)
    if is_bag(path):
        from .bag import Bag
        return Bag(path, topic)
    from .carmen import CarmenLog
    return CarmenLog(path, topic)


def is_bag(path) -> bool:
    """Whether `path` is a bag; otherwise it may be a CARMEN log.

    Raises
    ------
    RecordingError
        When it cannot be read, is empty, or can be neither.
    """
    if path.is_dir():
        if not (path / 'metadata.yaml').exists():
            raise RecordingError(f'{path}: a folder without metadata.yaml is no ROS 2 bag; name a file in it, or have its '
                                 f'metadata.yaml written: ros2 bag reindex {shlex.quote(str(path.absolute()))}')
        return True
    check_file(path, RecordingError)
    try:
        packed, start = _starts_of(path)
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(f'{path}: cannot be read: {getattr(error, "strerror", None) or error}') from error
    if not start:
        raise RecordingError(f'{path}: the file is empty')
    kind = kind_of(start)
    if kind and packed == start:
        return True
    if kind or (advice := unpacking_advice(path, start)):
        raise RecordingError(unpacking_advice(path, packed) if kind else advice)
    if b'\0' in start:
        raise RecordingError(f'{path}: neither a CARMEN log nor a ROS bag')
    return False


class Record(NamedTuple):
    """A scan with the poses that were recorded along with it: x [m], y [m], theta [rad]; zero where there are none."""

    scan: Scan
    laser_pose: tuple
    robot_pose: tuple


class Recording:
    """Recorded scans, read from the disk anew at every pass and one at a time.

    Attributes
    ----------
    path : Path
    name : str
        The file's name without its endings, nor dots around it: a folder of that name lies where it is made.
    topic : str
        Where the scans are taken from.
    frame_id : str
        The coordinate frame of the first scan.
    count : int
        How many scans the recording claims to hold, damaged ones included.
    """

    topic: str
    frame_id: str
    count: int

    def __init__(self, path):
        self.path = Path(path)
        whole = self.path.resolve().name if self.path.is_dir() else self.path.name
        stem = whole if self.path.is_dir() else whole.removesuffix('.gz').rpartition('.')[0] or whole
        self.name = stem.strip('.') or 'recording'
        self._problems = {}
        self._notes = {}
        self._watch = ScanWatch()

    @property
    def notes(self) -> list:
        """One line for each thing that had to be assumed to read the recording; nothing in it is damaged."""
        return list(self._notes)

    @property
    def problems(self) -> list:
        """One line for each damaged part met so far and skipped, up to `MOST_PROBLEMS`."""
        return list(self._problems)

    @property
    def watch(self) -> ScanWatch:
        """What is odd about the scans, of the pass that went farthest."""
        return self._watch

    def look_through(self, most=None) -> ScanWatch:
        """`watch`, of all scans or of the first `most`."""
        if self._watch.seen < (self.count if most is None else min(self.count, most)):
            for _ in islice(self.scans(), most):
                pass
        return self._watch

    def scans(self):
        """Iterator of `Scan`, in the order of the file, which is the physical one; stamps may go back.

        Scans whose beams point the same way share one `ScanGeometry`.
        """
        raise NotImplementedError

    def records(self):
        """Iterator of `Record`, as `scans`."""
        raise NotImplementedError

    def stamps(self) -> list:
        """The stamps of all scans [ns], in the order of the file."""
        return [scan.stamp for scan in self.scans()]

    def wheel_odometry(self):
        """Raw odometry: stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad] of the base, or None."""

    def truth(self):
        """Corrected poses: stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad], or None."""

    def channels(self) -> list:
        """The `Channel` of every topic besides that of the scans."""
        return [Channel('wheel_odom', ODOMETRY, input='wheel_odom')] if self.wheel_odometry() else []

    def play(self, channels):
        """Iterator of `Played`: the scans as from `scans`, and between them what the channels carry."""
        wheels = _wheels(*self.wheel_odometry(), channels[0]) if channels else iter(())
        schedule, ahead = Schedule(), next(wheels, None)
        for scan in self.scans():
            now = schedule.time(scan.stamp)
            while ahead and ahead.time <= now:
                yield ahead
                ahead = next(wheels, None)
            yield Played(scan, now)

    def _note(self, assumption):
        self._notes[assumption] = None

    def _report(self, problem):
        if len(self._problems) >= MOST_PROBLEMS:
            problem = 'there are more problems than these'
        self._problems[problem if len(problem) <= LONGEST_PROBLEM else f'{problem[:LONGEST_PROBLEM]}...'] = None

    def _look(self, watch, fields):
        """Look at the next scan of a pass that has a `watch` of its own."""
        watch.look(fields)
        if watch.seen > self._watch.seen:
            self._watch = watch

    def _choose(self, counts, topic):
        """Set `topic` and `count` from how many scans each topic holds."""
        held = ', '.join(sorted(counts)) or 'none'
        if not counts:
            raise RecordingError(f'{self.path}: holds no laser scan')
        if topic is not None and topic not in counts:
            raise RecordingError(f'{self.path}: no scans on {topic!r}; topics of scans: {held}')
        filled = [topic] if topic is not None else [name for name in sorted(counts) if counts[name]] or sorted(counts)
        if len(filled) > 1:
            raise RecordingError(f'{self.path}: choose one of its {len(filled)} topics of scans: {", ".join(filled)}')
        self.topic = filled[0]
        if topic is None and len(counts) > 1:
            self._note(f'scans are taken from {self.topic}; of the topics of scans ({held}) no other holds a message')
        self.count = counts[self.topic]


def _starts_of(path, size=512):
    """The first bytes of a file as they are, and unpacked where it is gzip."""
    with open(path, 'rb') as file:
        start = file.read(size)
    if start.startswith(b'\x1f\x8b'):
        with gzip.open(path) as file:
            return start, file.read1(size)
    return start, start


def _wheels(stamps, poses, channel):
    """The odometry of the wheels as `Played`, in the order of the file."""
    schedule = Schedule()
    for stamp, pose in zip(map(int, stamps), poses, strict=True):
        yield Played(pose_only_fields(stamp, 'base_link', pose), schedule.time(stamp), channel)
