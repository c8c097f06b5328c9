# SPDX-License-Identifier: Apache-2.0
"""Input of scans: selects which scans are processed, and in which order."""
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from ...core.scan import SECOND, in_nanoseconds
from ...robot.mask import corrected_stamp
from ...robot.parameter_groups import InputParameters
from ...robot.revolution import Revolution
from ...robot.scan_buffer import ScanBuffer
from ...robot.sensors import name_in_frame
from ..rclpy_internals import WakingCallbackGroup, taken
from .endpoints import subscription
from .graph_checks import Competition, incompatibilities
from .messages import stamp_to_message
from .scan_reader import ScanMessage
from .topics import MOST_SCANS, scans


class ScanTopic:
    """Subscribes to a topic and puts each scan into the inbox of its lidar, ``inbox_of(frame)``.

    `kind` is a key of `TYPES`. `buffer` holds the pending scans of all lidars, each with the time [s] of its arrival.
    Raises a ParameterError when the quality of service that the parameters set is invalid.
    """

    def __init__(self, node: Node, kind: str, name: str, inbox_of: Callable[[str], 'ScanInbox'],
                 buffer: ScanBuffer[tuple[ScanMessage, float]]) -> None:
        self._node, self._inbox_of, self.buffer = node, inbox_of, buffer
        self._subscription = subscription(node, scans(name, kind), self._on_message)

    @property
    def name(self) -> str:
        """Full name of the topic."""
        return str(self._subscription.topic_name)

    def incompatibilities(self) -> list[str]:
        """Return a sentence for each publisher on the topic from which nothing is received, with the reason."""
        return incompatibilities(self._node, self._subscription)

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    def take(self, inbox: 'ScanInbox') -> None:
        """Put the scans that have arrived into their inboxes; those other than `inbox` process theirs later."""
        for message, info in taken(self._subscription):
            other = self._put(message, info)
            if other is not inbox:
                other.retry_pending()

    def _on_message(self, message: ScanMessage, info: dict[str, Any]) -> None:
        inbox = self._put(message, info)
        inbox.process_next()
        inbox.passed()

    def _put(self, message: ScanMessage, info: dict[str, Any]) -> 'ScanInbox':
        message.header.frame_id = message.header.frame_id.lstrip('/')
        inbox = self._inbox_of(message.header.frame_id)
        inbox.put(message, info['publication_sequence_number'])
        return inbox


class ScanInbox:
    """Keeps the scans of one lidar and passes them to `handle` one after the other.

    Scans that come in a burst wait. When processing falls behind the stamps, the oldest of more than
    ``input.queue_size`` scans are dropped.

    Parameters
    ----------
    node : rclpy.node.Node
        The node that processes the scans.
    parameters : InputParameters
        Parameters of this lidar; may be replaced at any time.
    patience : callable
        Function that returns how long [s] after its arrival a scan may wait: for its mounting, its prior or older scans
        of other lidars; 0 if it can be processed now.
    handle : callable
        Function that processes each scan.
    passed : callable
        Function that is called when a scan has arrived or was processed: scans of other lidars may have waited for it.
    source : ScanTopic
        Topic of the scans, and perhaps of those of other lidars.

    Attributes
    ----------
    received, dropped : int
        Number of scans received or dropped so far.
    competition : Competition
        Publishers of the scans.
    frame : str
        Frame of the scans, if other lidars publish on the topic; else empty.
    """

    def __init__(self, node: Node, parameters: InputParameters, patience: Callable[[ScanMessage], float],
                 handle: Callable[[ScanMessage], None], passed: Callable[[], None], source: ScanTopic) -> None:
        self.parameters = parameters
        self.received = self.dropped = 0
        self._revolution, self._noted = Revolution(), False
        self.frame = ''
        self.competition = Competition(node, source.name)
        self.source, self.passed = source, passed
        self._node = node
        self._patience, self._handle = patience, handle
        self._pending = source.buffer.add_queue()
        self._busy_since: float | None = None
        self._began = self._done = 0
        self._timer = node.create_timer(1.0, self.process_next, callback_group=WakingCallbackGroup(self.has_pending),
                                        clock=Clock(clock_type=ClockType.STEADY_TIME), autostart=False)

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return self.source.name

    @property
    def name(self) -> str:
        """Full name of the topic, with the frame if other lidars publish on it."""
        return name_in_frame(self.topic, self.frame) if self.frame else self.topic

    def has_pending(self) -> bool:
        """Whether a scan waits for its mounting, its external prior or other lidars."""
        return bool(self._pending)

    def must_wait(self, stamp: int) -> bool:
        """Whether a scan with a `stamp` [ns] waits for an older one of another lidar, which has come or is due."""
        return self.source.buffer.must_wait(self._pending, stamp)

    def retry_pending(self) -> None:
        """Process the oldest pending scan if it is ready now: what it waits for may have arrived."""
        if self._pending:
            self._retry_after(0.0)

    def close(self) -> None:
        """Drop the pending scans."""
        self._node.destroy_timer(self._timer)
        self._pending.clear()
        self.source.buffer.remove_queue(self._pending)

    def process_next(self) -> None:
        """Process the oldest pending scan if it need not wait any longer."""
        self._timer.cancel()
        self.source.take(self)
        if not self._pending:
            return
        message, arrival = self._pending.first
        remaining = arrival + self._patience(message) - time.monotonic()
        if remaining > 0.0:
            self._retry_after(remaining)
            return
        self._pending.pop()
        self._handle(message)
        self._done = in_nanoseconds(message.header.stamp)
        self.source.take(self)
        if not self._pending:
            self._busy_since = None
        self.retry_pending()
        self.passed()

    def _retry_after(self, delay: float) -> None:
        """Call `process_next` once, after `delay` [s]."""
        self._timer.timer_period_ns = int(delay * SECOND) + 1
        self._timer.reset()

    def put(self, message: ScanMessage, number: int | None) -> None:
        """Keep a message, which its publisher has given a `number`, or the scan that it completes, to be processed."""
        self.competition.add(number)
        for whole in self._revolution.add(message):
            self._put(whole)
        if self._revolution.note and not self._noted:
            self._noted = True
            self._node.get_logger().warning(f'{self.name}: {self._revolution.note}')

    def _put(self, message: ScanMessage) -> None:
        self.received += 1
        if (self.received - 1) % self.parameters.every_nth:
            return
        self._correct_stamp(message)
        stamp, now = in_nanoseconds(message.header.stamp), time.monotonic()
        if self._busy_since is None:
            self._busy_since = now
            self._began = self._done = self._done or stamp
        self._pending.add(stamp, (message, now))
        while len(self._pending) > self.parameters.queue_size and self._is_behind(self._busy_since, now):
            self._pending.pop()
            self.dropped += 1

    def _is_behind(self, since: float, now: float) -> bool:
        """Whether the scans processed without a pause `since` [s] took longer than they cover by their stamps.

        They may take ``input.queue_size`` periods longer.
        """
        allowed = self._done - self._began + self.parameters.queue_size * (self._pending.stamps.period or 0)
        return len(self._pending) > MOST_SCANS or (now - since) * SECOND > allowed

    def _correct_stamp(self, message: ScanMessage) -> None:
        """Add ``input.time_offset`` to the stamp of a message, unless the message has none."""
        offset, = self.parameters.time_offset
        if offset:
            message.header.stamp = stamp_to_message(corrected_stamp(in_nanoseconds(message.header.stamp), offset))


class StampFilter:
    """Decides whether stamps that go back mean a recording that starts again, jitter, or a single wrong stamp.

    Attributes
    ----------
    held : ScanMessage or None
        Scan whose stamp is far before those of the last scans; the next scan shows whether the recording starts again.
    """

    def __init__(self) -> None:
        self._used: deque[int] = deque(maxlen=2)
        self.held: ScanMessage | None = None

    def used(self, stamp: int) -> None:
        """Store the stamp [ns] of a scan that was processed."""
        self._used.append(stamp)

    def update(self, message: ScanMessage, max_jump: float) -> tuple[list[ScanMessage], ScanMessage | None]:
        """Decide which scans to process when `message` has arrived: return these, in order, and one to skip or None.

        Steps back of the stamps of up to `max_jump` [s] count as jitter; the stamp of the scan to skip is wrong.
        """
        back = self.has_restarted(in_nanoseconds(message.header.stamp), max_jump)
        held, self.held = self.held, None
        if held and (back or not self._used):
            return [held, message], None
        if back:
            self.held = message
            return [], None
        return [message], held

    def has_restarted(self, stamp: int, max_jump: float) -> bool:
        """Whether `stamp` [ns] is over `max_jump` [s] before those of the last two scans used; False for stamp 0."""
        return bool(stamp and self._used) and stamp < min(self._used) - max_jump * SECOND

    def restart(self) -> None:
        """Accept any stamp of the next scan: the odometry was reset."""
        self._used.clear()
        self.held = None
