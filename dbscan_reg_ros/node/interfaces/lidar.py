# SPDX-License-Identifier: Apache-2.0
"""Lidars that the node subscribes to, and the choice of the lidar whose scans trigger the published odometry."""
import dataclasses
from collections.abc import Callable
from typing import NamedTuple

from rclpy.node import Node

from ...core.geometry.mounting import Mounting
from ...core.parameters.features import ScanParameters
from ...core.scan import Scan
from ...core.sensor import FIRST, Sensor
from ...recordings.checks.scan_checks import Kind, ScanWarning
from ...robot.parameter_groups import LASER_SCAN, InputParameters
from ...robot.parameters import NodeParameters
from ...robot.scan_buffer import RecentStamps, ScanBuffer
from ...robot.sensors import name_in_frame
from ..counters import Counters
from ..throttled_log import ThrottledLog
from .scan_input import ScanInbox, ScanTopic, StampFilter
from .scan_reader import MountingSource, ScanMessage, ScanReader
from .topics import TYPES


class Callbacks(NamedTuple):
    """What is done with the scans of the lidars."""

    patience: Callable[['Lidar', ScanMessage], float]
    handle: Callable[['Lidar', ScanMessage], None]
    passed: Callable[['Lidar'], None]
    """As in `ScanInbox`, with the lidar as the first argument."""
    lidar_of: Callable[['Lidar', str], 'Lidar']
    """``lidar_of(lidar, frame)`` returns the lidar of a further frame on the topic of `lidar`: it, or another."""
    buffer: ScanBuffer[tuple[ScanMessage, float]]
    """As in `ScanTopic`."""


class Lidar:
    """One lidar: its `topic`, its scans, and the checks of its messages.

    With `several` lidars the odometry estimates the pose of the base instead of that of the lidar. `shares` is the
    lidar that is subscribed to the topic, if this is another lidar on it.

    Attributes
    ----------
    rank : int
        Number of the lidar, from 0; `Sensor.rank`.
    frame : str
        Frame of its scans, if there are other lidars on its topic; else empty.
    frames : dict
        Frame of scans on its topic -> their lidar; first the frame of its own.
    input : InputParameters
        Selection of its scans, with the mask and the time offset of this lidar, and the type of its messages.
    name : str
        Its name in ``sensors``; empty if it has none.
    inbox : ScanInbox or None
        Pending scans; None while the node is not subscribed to the topic.
    """

    def __init__(self, topic: str, several: bool, node: Node, mountings: MountingSource, rank: int = 0,
                 shares: 'Lidar | None' = None) -> None:
        self.topic, self._several, self._node = topic, several, node
        self.mountings, self.rank, self._shares, self.frame = mountings, rank, shares, ''
        self.log = ThrottledLog(node.get_logger())
        self.counters = Counters()
        self.reader, self.stamps = ScanReader(node.get_clock(), self.log), StampFilter()
        self._type = LASER_SCAN
        self.input, self.name = InputParameters(), ''
        self._limits: ScanParameters | None = None
        self._has_new_type = False
        self.frames: dict[str, Lidar] = {}
        self.inbox: ScanInbox | None = None
        self.distinguish(several)

    @property
    def label(self) -> str:
        """Prefix of messages about this lidar: its topic if there are several lidars; empty for a single lidar."""
        if not self._several:
            return ''
        topic = self._node.resolve_topic_name(self.topic)
        return f'{name_in_frame(topic, self.frame) if self.frame else topic}: '

    @property
    def sensor_name(self) -> str:
        """Name of the `Sensor` of its scans, which is the same before and after others are found on its topic."""
        return name_in_frame(self.topic, self.frame) if self._shares else self.topic

    @property
    def competition(self) -> str:
        """Warning that several publishers send its scans; empty otherwise."""
        return self.inbox.competition.found() if self.inbox else ''

    def distinguish(self, several: bool, frame: str = '') -> None:
        """Set whether there are `several` lidars, and the `frame` of its scans if others are on its topic."""
        self._several, self.frame = several, frame or self.frame
        self.log.subject = self.label
        if self.inbox:
            self.inbox.frame = self.frame

    def reconfigure(self, parameters: NodeParameters) -> None:
        """Apply the parameters of the node."""
        own = parameters.lidar(self.topic)
        given, self._limits, self.name = own.input, own.scan, own.name
        self._is_auto = given.type not in TYPES
        if not self._is_auto:
            self._type = given.type
        self.input = dataclasses.replace(given, type=self._type)
        if self.inbox:
            self.inbox.parameters = self.input

    def subscribe(self, callbacks: Callbacks) -> ScanInbox:
        """Subscribe to the scans, unless a lidar that is subscribed shares its topic."""
        self._callbacks = callbacks
        inbox = self._shares.inbox if self._shares else None
        source = inbox.source if inbox else ScanTopic(
            self._node, self._type, self.topic, self._inbox_of, callbacks.buffer)
        self.inbox = ScanInbox(self._node, self.input, lambda message: callbacks.patience(self, message),
                               lambda message: callbacks.handle(self, message), lambda: callbacks.passed(self), source)
        self.inbox.frame = self.frame
        return self.inbox

    def _inbox_of(self, frame: str) -> ScanInbox:
        """Return the inbox of the lidar on this topic whose scans have this `frame`."""
        if frame and not self.frames:
            self.frames[frame] = self
        lidar = self.frames.get(frame) or (self._callbacks.lidar_of(self, frame) if frame else self)
        inbox = lidar.inbox or self.inbox
        assert inbox
        return inbox

    def unsubscribe(self) -> None:
        """Unsubscribe, and drop the pending scans."""
        if self.inbox:
            self.inbox.close()
            if not self._shares:
                self.inbox.source.close()
        self.inbox = None
        self._has_new_type = False

    def adopt_type(self) -> bool:
        """Subscribe to another type if ``input.type`` is auto and only that is published; return whether that changed.

        Unsubscribes first and subscribes when called again: the executor keeps the old subscription until it has run.
        """
        if self._shares:
            return self._follow_subscription(self._shares.inbox)
        if self._has_new_type:
            self._has_new_type = False
            inbox = self.subscribe(self._callbacks)
            self._node.get_logger().info(f'{inbox.topic}: subscribed to {self._type}')
            return True
        if not self.inbox or not self._is_auto:
            return False
        published = {each.topic_type.replace('/msg/', '/')
                     for each in self._node.get_publishers_info_by_topic(self.inbox.topic)}
        found = [kind for kind in TYPES if kind in published]
        if not found or self._type in found:
            return False
        self._type = found[0]
        self.input = dataclasses.replace(self.input, type=self._type)
        self.unsubscribe()
        self._has_new_type = True
        return True

    def _follow_subscription(self, shared: ScanInbox | None) -> bool:
        """Subscribe again if the lidar that shares the topic has; return whether that changed."""
        if (shared and shared.source) is (self.inbox and self.inbox.source):
            return False
        self.unsubscribe()
        if shared:
            self.subscribe(self._callbacks)
        return True

    def read(self, message: ScanMessage) -> tuple[Scan, Mounting, bool]:
        """Convert a message as `ScanReader.read`; return also whether its mounting was sent again with other values."""
        scan, mounting = self.reader.read(message, self.mountings, self.input)
        change = self.mountings.change
        if change:
            self.log.warn(change)
            self.counters.add_warnings([ScanWarning(Kind.MOUNTING, change)])
        return scan, mounting, bool(change)

    def skip(self, reason: str) -> None:
        """Count and log a scan that is not processed."""
        self.log.warn(f'scan skipped: {reason}')
        self.counters.skip(reason)

    def sensor(self, mounting: Mounting) -> Sensor:
        """Return the `Sensor` of a scan, which with several lidars contains the pose of the lidar on the base."""
        return Sensor(self.sensor_name, mounting.aligned_pose, self.rank, self._limits) if self._several else FIRST


class OdometryTrigger:
    """Decides for which scans of `count` lidars odometry is published: of the first that is not silent, or `on_all`."""

    def __init__(self, count: int, on_all: bool = False) -> None:
        self._on_all = on_all
        self._stamps = [RecentStamps() for _ in range(count)]
        self._last: int | None = None

    def add_lidar(self) -> None:
        """Count one more lidar, the last of the list."""
        self._stamps.append(RecentStamps())

    def restart(self) -> None:
        """Accept any stamp of the next scan: the odometry was reset."""
        self._last = None
        for stamps in self._stamps:
            stamps.clear()

    def is_due(self, lidar: int, stamp: int) -> bool:
        """Store the `stamp` [ns] of a scan of a lidar, and return whether odometry is published for this scan.

        Unless it is published for the scans of all lidars, no earlier lidar of the list may have published a scan
        within its last two scan periods. With several lidars, the stamp must be newer than that of the last odometry.
        """
        self._stamps[lidar].add(stamp)
        if not (self._on_all or self._is_first(lidar, stamp)):
            return False
        if len(self._stamps) > 1 and self._last is not None and stamp <= self._last:
            return False
        self._last = stamp
        return True

    def leads(self, lidar: int) -> bool:
        """Whether no scan of an earlier lidar was received at the last odometry."""
        return self._last is None or self._is_first(lidar, self._last)

    def _is_first(self, lidar: int, stamp: int) -> bool:
        return not any(stamps.is_heard(stamp, _SILENT_PERIODS) for stamps in self._stamps[:lidar])


_SILENT_PERIODS = 2
"""Number of scan periods without a scan after which a lidar counts as silent."""
