# SPDX-License-Identifier: Apache-2.0
"""The scans that come in: which are used, in which order, and which of their beams."""
import math
import time
from collections import deque

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan

from ...core.scan import SECOND, Scan
from ...recordings.scan_checks import ScanChecks, ScanFields
from ..monitoring.graph_checks import unheard
from .endpoints import subscription
from .messages import stamp_from_message
from .subscriptions import Urgent, taken

QUALITY = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Deep enough that what arrives while a scan is processed can be counted."""


class ScanInbox:
    """Subscribes to ``scan`` and hands over one scan after the other; when they come too fast, the newest win.

    Parameters
    ----------
    node : rclpy.node.Node
    parameters : NodeParameters
        May be replaced at any time.
    ready : callable
        Whether a message need not wait any longer for what else is to be known of its time.
    handle : callable
        Takes each message.

    Attributes
    ----------
    received, dropped : int
        Scans so far.

    Raises
    ------
    ParameterError
        When the quality of service that is asked for does not exist.
    """

    def __init__(self, node: Node, parameters, ready, handle):
        self.parameters = parameters
        self.received = self.dropped = 0
        self._node = node
        self._ready = ready
        self._handle = handle
        self._waiting = deque()
        self._subscription = subscription(node, LaserScan, 'scan', self._on_message, QUALITY)
        self._alarm = node.create_timer(1.0, self._next, callback_group=Urgent(self.is_waiting),
                                        clock=Clock(clock_type=ClockType.STEADY_TIME), autostart=False)

    @property
    def topic(self):
        return self._subscription.topic_name

    def unheard(self) -> list:
        """Why nothing is heard of publishers on the topic: a sentence for each of them."""
        return unheard(self._node, self._subscription)

    def is_waiting(self) -> bool:
        """Whether a scan waits for what else is to be known of its time."""
        return bool(self._waiting)

    def look_again(self):
        """Something became known: the oldest scan may be ready."""
        if self._waiting:
            self._look_in(0.0)

    def close(self):
        """Hear no more scans."""
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_timer(self._alarm)
        self._waiting.clear()

    def _on_message(self, message):
        self._keep(message)
        self._next()

    def _next(self):
        """Hand over the oldest scan that waits, when it is ready or has waited long enough."""
        self._alarm.cancel()
        for message in taken(self._subscription):
            self._keep(message)
        if not self._waiting:
            return
        message, arrival = self._waiting[0]
        remaining = arrival + self.parameters.input.max_wait - time.monotonic()
        if remaining > 0.0 and not self._ready(message):
            self._look_in(remaining)
            return
        self._waiting.popleft()
        self._handle(message)
        self.look_again()

    def _look_in(self, delay):
        """Call `_next` once, after `delay` [s]."""
        self._alarm.timer_period_ns = int(delay * SECOND) + 1
        self._alarm.reset()

    def _keep(self, message):
        self.received += 1
        if (self.received - 1) % self.parameters.input.every_nth:
            return
        self._waiting.append((message, time.monotonic()))
        while len(self._waiting) > self.parameters.input.queue_size:
            self._waiting.popleft()
            self.dropped += 1


class ScanReader:
    """Makes a `Scan` of each message, and says what is odd about them.

    Parameters
    ----------
    clock : rclpy.clock.Clock
    notices : Notices
    """

    def __init__(self, clock, notices):
        self._clock = clock
        self._notices = notices
        self._checks = ScanChecks()
        self._warnings = {}
        self._geometry = None
        self._mask = None

    def look(self, message) -> list:
        """The `ScanWarning` of a LaserScan message, logged: what stays so from scan to scan once."""
        found = self._checks.look(ScanFields.from_message(message), self._clock.now().nanoseconds)
        for warning in found:
            if self._warnings.get(warning.kind) is not warning:
                self._notices.warn(warning.text)
            self._warnings[warning.kind] = warning
        return found

    def restart(self):
        """Time has started anew: the next stamp may be any."""
        self._checks.restart()

    def read(self, message, mounting, parameters) -> Scan:
        """The scan in a LaserScan message as a sensor at `mounting.aligned_pose` sees it, without the returns that the parameters
        ``input.mask`` exclude.

        Raises
        ------
        ScanError
            When the message cannot be a scan.
        """
        scan = Scan.from_message(message, self._geometry, mounting.upside_down, mounting.pose.theta)
        if scan.geometry is not self._geometry:
            self._geometry, self._mask = scan.geometry, None
        return self._masked(scan, mounting, parameters)

    def _masked(self, scan, mounting, parameters):
        key = parameters.input.mask, mounting
        if self._mask is None or self._mask[0] != key:
            sectors = np.reshape(parameters.input.mask, (-1, 2))
            sectors = sectors[sectors[:, 0] != sectors[:, 1]]
            bearings = scan.geometry.bearings - mounting.pose.theta
            self._mask = key, within(-bearings if mounting.upside_down else bearings, sectors)
        limit = parameters.input.mask_range
        hidden = self._mask[1] & (scan.ranges < limit) if limit > 0.0 else self._mask[1]
        if not hidden.any():
            return scan
        return Scan(scan.stamp, np.where(hidden, np.float32(np.nan), scan.ranges), scan.geometry, scan.time_increment,
                    scan.frame_id)


class Stamps:
    """Tells a recording that starts again from jitter, and from a single scan with a wrong stamp.

    Attributes
    ----------
    held : LaserScan or None
        It goes far back, and the next one has to tell what that means.
    """

    def __init__(self):
        self._used = deque(maxlen=2)
        self.held = None

    def used(self, stamp):
        """The scan at `stamp` [ns] was used."""
        self._used.append(stamp)

    def update(self, message, jump):
        """What to do when `message` has come.

        Parameters
        ----------
        message : LaserScan
        jump : float
            Stamps may go back by so much [s].

        Returns
        -------
        list of LaserScan
            To be used now, in order.
        LaserScan or None
            To be skipped, for its stamp is wrong.
        """
        back = self.start_again(stamp_from_message(message.header.stamp), jump)
        held, self.held = self.held, None
        if held and (back or not self._used):
            return [held, message], None
        if back:
            self.held = message
            return [], None
        return [message], held

    def start_again(self, stamp, jump) -> bool:
        """Whether `stamp` [ns] lies more than `jump` [s] before those of the last two scans; 0 is no time."""
        return bool(stamp and self._used) and stamp < min(self._used) - jump * SECOND

    def restart(self):
        """Take any stamp next: the odometry was reset."""
        self._used.clear()
        self.held = None


def within(bearings, sectors):
    """``(N,)`` bool: which `bearings` ``(N,)`` [rad] lie in one of the `sectors` ``(M, 2)`` [rad], from the first bearing
    of each counter-clockwise to the second."""
    turn = 2.0 * math.pi
    widths = np.remainder(sectors[:, 1] - sectors[:, 0], turn)
    widths[widths == 0.0] = turn
    return (np.remainder(bearings[:, None] - sectors[:, 0], turn) <= widths + 1e-6).any(axis=1)
