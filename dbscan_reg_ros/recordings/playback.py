# SPDX-License-Identifier: Apache-2.0
"""What is played of a recording besides its scans."""
from typing import Any, NamedTuple

from ..core.errors import RecordingError

ODOMETRY, IMU, TRANSFORMS = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/Imu', 'tf2_msgs/msg/TFMessage'
RENAMED = {'tf/msg/tfMessage': TRANSFORMS}
"""Message types of old bags -> what they are called now."""
USUAL_IMU = '/imu', '/imu/data'
"""Of several topics of an IMU the first of these is played."""


class Channel(NamedTuple):
    """A topic of a recording that can be played.

    Attributes
    ----------
    recorded : str
        Its name in the recording.
    kind : str
        The message type.
    latched : bool
        Whether late subscribers receive its last message, too.
    input : str
        The name of the topic of the node that it fits, such as ``wheel_odom``; empty where there is none.
    """

    recorded: str
    kind: str
    latched: bool = False
    input: str = ''

    @property
    def topic(self) -> str:
        """The name that it is published on."""
        return self.input or f'/{self.recorded.lstrip("/")}'


class Played(NamedTuple):
    """A scan, or what a channel carries.

    Attributes
    ----------
    content : Scan, bytes or dict
        A scan; else the bytes of a message as ROS 2 sends them, or its fields.
    time : int
        When it was recorded [ns].
    channel : Channel or None
        None for a scan.
    """

    content: Any
    time: int | None = None
    channel: Channel | None = None


def inputs_of(kinds, wheels) -> dict:
    """Topic of a recording -> topic of the node that it fits.

    Parameters
    ----------
    kinds : dict
        Topic -> message type.
    wheels : str or None
        The topic of the wheels' odometry.
    """
    found = {wheels: 'wheel_odom', _imu(kinds): 'imu'}
    found |= {_transforms(kinds, name): name for name in ('/tf', '/tf_static')}
    return {topic: name for topic, name in found.items() if topic}


def _imu(kinds):
    """Return the topic of the only IMU, else the first of `USUAL_IMU` that is recorded, or None."""
    imus = [topic for topic, kind in kinds.items() if kind == IMU]
    return only(imus) or next((topic for topic in USUAL_IMU if topic in imus), None)


def _transforms(kinds, name):
    """Return the topic of transforms called `name`, else the only one whose name ends with it, or None."""
    alike = [topic for topic, kind in kinds.items()
             if RENAMED.get(kind, kind) == TRANSFORMS and f'/{topic}'.endswith(name)]
    return name if name in alike else only(alike)


def choose(channels, topics=(), everything=False) -> list:
    """Return the channels to play: what the node can use, those recorded on `topics`, or all.

    Raises
    ------
    RecordingError
        When a topic is missing.
    """
    held = sorted({channel.recorded for channel in channels})
    if missing := sorted(set(topics) - set(held)):
        raise RecordingError(f'no topic {", ".join(missing)}; besides the scans there is '
                             f'{", ".join(held) or "nothing"}')
    return [channel for channel in channels if everything or channel.input or channel.recorded in topics]


def only(names):
    """Return the one of `names` where there is just one, else None."""
    names = list(names)
    return names[0] if len(names) == 1 else None
