"""``/diagnostics``, once a second."""
import math
import statistics
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from ..core.records import Status
from .events import NO_PUBLISHER_EVENTS
from .health import Health

PERIOD = 1.0
STALE_AFTER = 2.0
"""No scan for so long [s] is worth a complaint."""
LEVELS = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Diagnostics:
    """Says once a second how the odometry is doing.

    Parameters
    ----------
    node : rclpy.node.Node
    health : Health
    notices : Notices
    transforms : TransformSender
    is_paused : callable
    """

    def __init__(self, node: Node, health: Health, notices, transforms, is_paused):
        self._node = node
        self._health = health
        self._notices = notices
        self._transforms = transforms
        self._is_paused = is_paused
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10, event_callbacks=NO_PUBLISHER_EVENTS)
        self._inbox = None
        self._begin()

    def watch(self, inbox):
        """Report on the scans of `inbox` from now on; None while the node does not listen."""
        self._inbox = inbox
        self._begin()

    def _begin(self):
        self._last = None
        self._heard = time.monotonic()

    def publish(self):
        """Tell how the odometry has been doing since the last call, one `PERIOD` ago."""
        self._transforms.look_at_conflict()
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
        if self._inbox is None or self._is_paused():
            return DiagnosticStatus.OK, 'inactive' if self._inbox is None else 'paused'
        mismatch = self._mismatch()
        if mismatch:
            self._notices.warn(mismatch)
        if silence > STALE_AFTER or not self._inbox.received:
            return DiagnosticStatus.STALE, self._waiting(mismatch)
        if self._health.update is None and not self._health.trouble:
            return DiagnosticStatus.OK, 'no scan answered yet'
        grade, message = self._health.judge()
        doubts = list(filter(None, [mismatch, self._transforms.conflict,
                                    f'too slow: {dropped} scans dropped' if dropped else '']))
        return LEVELS[max(grade, 1 if doubts else 0)], '; '.join([message, *doubts])

    def _waiting(self, mismatch):
        names = [_full_name(endpoint) for endpoint in self._publishers()]
        there = f'published there by {", ".join(names)}' if names else 'nobody publishes there'
        return f'no scans on {self._inbox.topic}: {mismatch or there}'

    def _publishers(self):
        return self._node.get_publishers_info_by_topic(self._inbox.topic)

    def _mismatch(self):
        """Why the subscription hears nothing of a publisher, in words; empty when it hears all of them."""
        for endpoint in self._publishers():
            verdict, reason = qos_check_compatible(endpoint.qos_profile, self._inbox.quality)
            if verdict == QoSCompatibility.ERROR:
                return (f'the quality of service of {_full_name(endpoint)} on {self._inbox.topic} does not suit ours, not one '
                        f'scan of it gets here: {reason.strip() or "incompatible"}')
        return ''

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
        error = health.told_error
        if error is not None:
            (way, _, _), (_, _, aside), (bend, _, turn) = error.tolist()
            yield 'told way corrected by [%]', f'{100.0 * way:+.1f}'
            yield 'told turn corrected by [%]', f'{100.0 * turn:+.1f}'
            yield 'turn added to a told way [deg/m]', f'{math.degrees(bend):+.2f}'
            yield 'way to the left added to a told turn [m/rad]', f'{aside:+.3f}'
        for status in Status:
            yield f'status {status.value}', str(health.statuses[status])


def _full_name(endpoint):
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
