# SPDX-License-Identifier: Apache-2.0
"""Playback of the topics of a recording besides its scans."""
from typing import Any, NamedTuple

from ..core.errors import RecordingError

ODOMETRY, IMU, TRANSFORMS = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/Imu', 'tf2_msgs/msg/TFMessage'
RENAMED = {'tf/msg/tfMessage': TRANSFORMS}
"""Message type in old bags -> its name today."""
NOT_MEASURED = -1.0
"""First element of a covariance in a ``sensor_msgs/Imu`` that marks a quantity as not measured."""
USUAL_IMU = '/imu', '/imu/data'
"""If a recording has several IMU topics, the first one of these is played."""


class Channel(NamedTuple):
    """A topic of a recording that can be played."""

    recorded: str
    """Name of the topic in the recording."""
    kind: str
    """The message type."""
    latched: bool = False
    """Whether late subscribers also receive the last message of the topic."""
    input: str = ''
    """The input topic of the node that accepts these messages, such as ``wheel_odom``; empty if there is none."""

    @property
    def topic(self) -> str:
        """The topic on which the messages of this channel are published."""
        return self.input or f'/{self.recorded.lstrip("/")}'


class Played(NamedTuple):
    """A scan, or a message of a channel, that is played."""

    content: Any
    """Scan, bytes or dict: a scan; or another message, as the bytes that ROS 2 sends or as its fields."""
    time: int | None = None
    """Record time of the scan or message [ns]."""
    channel: Channel | None = None
    """None for a scan."""


def inputs_of(kinds, wheels, scans='/scan') -> dict:
    """Return topic of a recording -> input topic of the node that accepts its messages.

    `kinds` has the message type of each topic; `wheels` is the topic of the wheel odometry or None, `scans` that of the
    scans.
    """
    found = {wheels: 'wheel_odom', imu_topic({topic: kinds[topic] for topic in of_robot(kinds, kinds, scans)}): 'imu'}
    found |= {topic_of_transforms(kinds, name, scans): name for name in ('/tf', '/tf_static')}
    return {topic: name for topic, name in found.items() if topic}


def of_robot(topics, kinds, scans) -> list:
    """Return the `topics` without those of another robot than that of the `scans`.

    A topic is one of another robot if it shares its namespace with scans of the same type, but not with these scans.
    `kinds` has the message type of each topic.
    """
    others = {_robot(topic) for topic, kind in kinds.items() if kind == kinds.get(scans)} - {'', _robot(scans)}
    return [topic for topic in topics if _robot(topic) not in others]


def _robot(topic):
    """Return the outermost namespace of a topic; empty if it has none."""
    return topic.strip('/').rpartition('/')[0].partition('/')[0]


def imu_topic(kinds):
    """Return the only IMU topic; of several, the first one of `USUAL_IMU` that is recorded; else None."""
    imus = [topic for topic, kind in kinds.items() if kind == IMU]
    return only(imus) or next((topic for topic in USUAL_IMU if topic in imus), None)


def topic_of_transforms(kinds, name, scans):
    """Return the topic of transforms called `name` for the robot with these `scans`; None if there is none.

    That in its namespace, else `name` itself, else the only one whose name ends with `name`. `kinds` has the message
    type of each topic.
    """
    alike = [topic for topic in of_robot(kinds, kinds, scans)
             if RENAMED.get(kinds[topic], kinds[topic]) == TRANSFORMS and f'/{topic}'.endswith(name)]
    own = only(topic for topic in alike if _robot(topic) == _robot(scans) != '')
    return own or (name if name in alike else only(alike))


def choose(channels, topics=(), everything=False) -> list:
    """Return the channels to play: those that the node accepts and those recorded on `topics`, or all if `everything`.

    Raises a RecordingError when one of the `topics` is not in the recording.
    """
    held = sorted({channel.recorded for channel in channels})
    if missing := sorted(set(topics) - set(held)):
        raise RecordingError(f'no topic {", ".join(missing)}; besides the scans there is '
                             f'{", ".join(held) or "nothing"}')
    return [channel for channel in channels if everything or channel.input or channel.recorded in topics]


def only(names):
    """Return the only element of `names`; None if there are none or several."""
    names = list(names)
    return names[0] if len(names) == 1 else None


RESTART = 10_000_000_000
"""A step back of the stamps by this or more [ns] is no jitter: the recording was looped, or its clock was set."""


class Schedule:
    """Makes the stamps of a recording monotone, one at a time, without changing the order of the messages.

    A stamp that goes back is given the last time; after a step back of 10 s or more, time continues from the last one.
    """

    def __init__(self):
        self._last = None
        self._offset = 0

    def time(self, stamp) -> int:
        """Return the time [ns] at which a message with this `stamp` [ns] is due; times never decrease."""
        if self._last is not None and stamp + self._offset <= self._last - RESTART:
            self._offset = self._last - stamp
        time = stamp + self._offset
        self._last = time if self._last is None else max(time, self._last)
        return self._last


class Timeline:
    """Times from the start of a playback at which messages are due.

    Scans are due by their stamps; other messages as long after the last scan, or the first message, as recorded.

    Attributes
    ----------
    start : int or None
        Stamp [ns] that a scan would have at the start; None before the first scan.
    """

    def __init__(self):
        self.start = None
        self._schedule = Schedule()
        self._due, self._recorded = 0, None

    def due(self, played) -> int:
        """Return the time [ns] from the start at which the next `Played` is due."""
        if played.channel is None:
            stamp = self._schedule.time(played.content.stamp)
            if self.start is None:
                self.start = stamp - self._after_last(played)
            self._due, self._recorded = stamp - self.start, played.time
        elif self._recorded is None and not played.channel.latched:
            self._recorded = played.time
        return self._after_last(played)

    def _after_last(self, played):
        """Return when a message is due that was recorded at its time; latched ones may be much older than the rest."""
        return self._due if self._recorded is None else self._due + max(0, played.time - self._recorded)
