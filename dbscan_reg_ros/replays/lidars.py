# SPDX-License-Identifier: Apache-2.0
"""Several lidars of one recording: the odometry follows the first, the others help."""
import dataclasses
import math
from dataclasses import dataclass

from ..core.errors import RecordingError, ScanError
from ..core.geometry.mounting import Mounting, MountingError
from ..core.geometry.se2 import SE2
from ..core.odometry.sensor import Sensor
from ..recordings import open_recording
from ..recordings.bags.static_transforms import static_mounting
from ..recordings.opening import is_bag
from ..recordings.recording import Recording
from .sensor_mounting import turned

UPSIDE_DOWN = 'upside_down'
"""Fifth word of a mounting on the command line."""


def parse_mountings(given) -> dict:
    """Return topic -> `Mounting` of mountings on the command line: NAME X Y DEG [upside_down].

    Raises
    ------
    MountingError
        When one has another form.
    """
    mountings = {}
    for name, *words in given or ():
        try:
            x, y, degrees = map(float, words[:3])
            if words[3:] not in ([], [UPSIDE_DOWN]) or not all(map(math.isfinite, (x, y, degrees))):
                raise ValueError
        except ValueError:
            raise MountingError(f'--mounting {" ".join((name, *words))}: expected NAME X Y DEG, in m and deg, and '
                                f'{UPSIDE_DOWN} for a lidar that is mounted so') from None
        mountings[name] = Mounting(SE2(x, y, math.radians(degrees)), bool(words[3:]))
    return mountings


def mounting_in(recording: Recording, mountings, base_frame) -> Mounting:
    """Return the mounting of the lidar of a `recording`: the given one of its topic, else that on ``/tf_static``.

    Raises
    ------
    MountingError
        When it is neither given nor recorded.
    """
    if recording.topic in mountings:
        return mountings[recording.topic]
    found = static_mounting(recording.path, base_frame, recording.frame_id) if is_bag(recording.path) else None
    if found is None:
        raise MountingError(f'{recording.path}: the mounting of the lidar on {recording.topic} is not known: no '
                            f'transform from {base_frame!r} to {recording.frame_id!r} is on /tf_static; give it: '
                            f'--mounting {recording.topic} X Y DEG')
    return found


@dataclass(frozen=True, eq=False)
class FurtherLidar:
    """A lidar besides the first.

    Attributes
    ----------
    recording : Recording
        Of its topic.
    mounting : Mounting
    """

    recording: Recording
    mounting: Mounting

    def sensor(self, first: Mounting) -> Sensor:
        """Return the sensor of its scans, which are rotated by the yaw of its mounting, as those of the first lidar."""
        offset = first.aligned_pose.inverse() @ self.mounting.aligned_pose
        return Sensor(self.recording.topic, offset)

    def scans(self):
        """Yield its scans, rotated to those of a lidar that looks along the base."""
        return turned(self.recording.scans(), self.mounting.pose.theta, self.mounting.upside_down)


def further_lidars(first: Recording, topics, mountings, base_frame) -> list:
    """Open the other `topics` of the recording `first`; return a `FurtherLidar` for each.

    Raises
    ------
    RecordingError
        When a topic is given twice or holds no scans.
    MountingError
        When the mounting of one is not known.
    """
    if len({first.topic, *topics}) <= len(topics):
        raise RecordingError(f'{first.path}: expected each topic once: {", ".join((first.topic, *topics))}')
    opened = [open_recording(first.path, topic) for topic in topics]
    return [FurtherLidar(recording, mounting_in(recording, mountings, base_frame)) for recording in opened]


class OdometryWithOthers:
    """An odometry that takes the scans of the other lidars before each scan of the first, by their stamps.

    The updates are those of the scans of the first lidar, and are numbered as if there were no others.

    Parameters
    ----------
    odometry : Odometry
    others : list of FurtherLidar
    first : str
        Topic of the first lidar.
    mounting : Mounting
        Of the first lidar.

    Attributes
    ----------
    used : dict
        Topic -> number of scans that were used.
    problems : dict
        Topic -> reason why the last scan that could not be used was left out.
    """

    def __init__(self, odometry, others, first, mounting):
        self._odometry, self._first = odometry, Sensor(first)
        self._others = [(other.sensor(mounting), other.scans()) for other in others]
        self._next = [next(scans, None) for _, scans in self._others]
        self.used = {sensor.name: 0 for sensor, _ in self._others}
        self.problems: dict[str, str] = {}
        self._numbers: dict[int, int] = {}

    def lines(self) -> list:
        """Return the lines of a summary about the lidars, as (name, text) pairs."""
        used = ', '.join(f'{count} scans of {topic}' for topic, count in self.used.items())
        return [('lidars', f'poses are those of the lidar on {self._first.name}; {used} used besides'),
                *(('warning', f'{topic}: the last scan that was left out: {problem}')
                  for topic, problem in self.problems.items())]

    def process(self, scan):
        """Process a `scan` of the first lidar, after those of the others that are older; return its update."""
        while self._take_older(scan.stamp):
            pass
        update = self._odometry.process(scan, None, self._first)
        number = self._numbers[update.number] = len(self._numbers)
        reference = self._numbers.get(update.reference_number)
        return dataclasses.replace(update, number=number, reference_number=reference)

    def _take_older(self, stamp):
        """Process the oldest waiting scan of the other lidars, if it is older than `stamp` [ns]; return whether."""
        waiting = [(scan.stamp, k) for k, scan in enumerate(self._next) if scan is not None]
        if not waiting or min(waiting)[0] >= stamp:
            return False
        _, k = min(waiting)
        sensor, scans = self._others[k]
        scan, self._next[k] = self._next[k], next(scans, None)
        if self._numbers:
            self._process(scan, sensor)
        return True

    def _process(self, scan, sensor):
        """Process a scan of another `sensor`."""
        try:
            self._odometry.process(scan, None, sensor)
            self.used[sensor.name] += 1
        except ScanError as error:
            self.problems[sensor.name] = str(error)
