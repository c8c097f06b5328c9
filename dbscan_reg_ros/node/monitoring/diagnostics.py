# SPDX-License-Identifier: Apache-2.0
"""``/diagnostics``, once a second."""
import math
import statistics
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from ...core.registration.records import Status
from ..interfaces.endpoints import publisher
from .counters import Health
from .graph_checks import SOMEBODY, named, shared, unheard

PERIOD = 1.0
STALE_AFTER = 2.0
"""No scan for so long [s] is worth a complaint."""
LOGGED_AFTER = 5.0
"""No scan at all for so long [s] is worth one in the log, and another each time that it has lasted twice as long."""
LASER_SCAN = 'sensor_msgs/msg/LaserScan'
LEVELS = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Diagnostics:
    """Says once a second how the odometry is doing.

    Parameters
    ----------
    node : rclpy.node.Node
    health : Health
    notices : Notices
    transforms : TransformSender
    odom : rclpy publisher
        Of our odometry.
    is_paused : callable
    """

    def __init__(self, node: Node, health: Health, notices, transforms, odom, is_paused):
        self._node = node
        self._health = health
        self._notices = notices
        self._transforms = transforms
        self._odom = odom
        self._is_paused = is_paused
        self._publisher = publisher(node, DiagnosticArray, '/diagnostics', 10)
        self._inbox = None
        self._seen: set = set()
        self._told: set = set()
        self._begin()

    def watch(self, inbox):
        """Report on the scans of `inbox` from now on; None while the node does not listen."""
        self._inbox = inbox
        self._begin()

    def _begin(self):
        self._last = None
        self._heard = time.monotonic()
        self._patience = LOGGED_AFTER

    def publish(self):
        """Tell how the odometry has been doing since the last call, one `PERIOD` ago."""
        now = time.monotonic()
        counts = self._counts()
        last_time, last = self._last or (now - PERIOD, (0,) * len(counts))
        elapsed = max(now - last_time, 1e-3)
        received, answered, dropped = (new - old for new, old in zip(counts, last, strict=True))
        self._last = now, counts
        if received:
            self._heard = now
        level, message = self._judge(now - self._heard, dropped)
        status = DiagnosticStatus(
            level=level, name=f'{self._node.get_fully_qualified_name()}: laser odometry', message=message,
            hardware_id=self._health.update.features.scan.frame_id if self._health.update else '')
        status.values = [KeyValue(key=key, value=value) for key, value in self._values(received / elapsed, answered / elapsed)]
        report = DiagnosticArray(status=[status])
        report.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(report)

    def _counts(self):
        """Scans received, answered and dropped so far."""
        return (self._inbox.received if self._inbox else 0, self._health.answered,
                self._inbox.dropped if self._inbox else 0)

    def _judge(self, silence, dropped):
        """(level, message)"""
        faults = self._faults()
        conflict = self._transforms.conflict
        level, message = self._state(silence)
        doubts = [text for text in (*self._health.take_doubts(), *faults) if text not in message]
        if dropped:
            doubts.append(f'too slow: {dropped} scans dropped')
        if doubts and level == DiagnosticStatus.OK:
            level = DiagnosticStatus.WARN
        if conflict:
            level = DiagnosticStatus.ERROR
        return level, '; '.join(filter(None, [message, conflict, *doubts]))

    def _state(self, silence):
        """(level, message) of the odometry itself."""
        if self._inbox is None or self._is_paused():
            return DiagnosticStatus.OK, 'inactive' if self._inbox is None else 'paused'
        if silence > STALE_AFTER or not self._inbox.received:
            waiting = self._waiting()
            if not self._inbox.received and silence >= self._patience:
                self._node.get_logger().warning(f'{waiting} ({self._patience:.0f} s so far)')
                self._patience *= 2.0
            return DiagnosticStatus.STALE, waiting
        if self._health.update is None and not self._health.trouble:
            return DiagnosticStatus.OK, 'no scan answered yet'
        grade, message = self._health.judge()
        return LEVELS[grade], message

    def _waiting(self):
        topic = self._inbox.topic
        names = named(self._node.get_publishers_info_by_topic(topic))
        there = f'published there by {names}' if names else f'nobody publishes there{self._elsewhere()}'
        return f'no scans on {topic}: {"; ".join(self._inbox.unheard()) or there}'

    def _elsewhere(self):
        """Where scans are published instead, in words; empty when nowhere."""
        topics = sorted(name for name, types in self._node.get_topic_names_and_types()
                        if LASER_SCAN in types and self._node.count_publishers(name))
        return f'; scans are published on {", ".join(topics)}: start the node with -r scan:={topics[0]}' if topics else ''

    def _faults(self):
        """What of other nodes never gets here, or is published where we publish; logged when it comes up."""
        faults = [text for subscription in self._node.subscriptions for text in unheard(self._node, subscription)]
        if self._inbox:
            faults += filter(None, [shared(self._node, self._odom)])
        # The name of a newcomer may be known only a moment later.
        told = {text for text in faults if SOMEBODY not in text or text in self._seen}
        for text in sorted(told - self._told):
            self._notices.warn(text)
        self._seen, self._told = set(faults), told
        return faults

    def _values(self, rate_in, rate_out):
        health, inbox = self._health, self._inbox
        update = health.update
        durations = [1e3 * duration for duration in health.durations]
        yield 'scan rate [Hz]', f'{rate_in:.1f}'
        yield 'odometry rate [Hz]', f'{rate_out:.1f}'
        yield 'processing median [ms]', f'{statistics.median(durations):.2f}' if durations else '-'
        yield 'processing worst [ms]', f'{max(durations):.2f}' if durations else '-'
        yield 'scans received', str(inbox.received if inbox else 0)
        yield 'scans answered', str(health.answered)
        yield 'scans dropped', str(inbox.dropped if inbox else 0)
        yield 'scans skipped', str(health.skipped)
        yield 'overlap', f'{update.registration.overlap:.2f}' if update and update.registration else '-'
        yield 'free direction [rad]', '-' if health.direction is None else f'{health.direction:.3f}'
        error = health.wheel_correction
        if error is not None:
            (way, _, _), (_, _, aside), (bend, _, turn) = error.tolist()
            yield 'told way corrected by [%]', f'{100.0 * way:+.1f}'
            yield 'told turn corrected by [%]', f'{100.0 * turn:+.1f}'
            yield 'turn added to a told way [deg/m]', f'{math.degrees(bend):+.2f}'
            yield 'way to the left added to a told turn [m/rad]', f'{aside:+.3f}'
        for status in Status:
            yield f'status {status.value}', str(health.statuses[status])

