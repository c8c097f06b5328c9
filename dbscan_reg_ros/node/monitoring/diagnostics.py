# SPDX-License-Identifier: Apache-2.0
"""Publisher of the state of the odometry on ``/diagnostics``, once a second."""
import math
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.publisher import Publisher

from ...core.registration.records import Status
from ..counters import Counters, Grade
from ..frames.transform_sender import TransformSender
from ..interfaces.endpoints import publisher
from ..interfaces.graph_checks import UNNAMED, incompatibilities, named, shared
from ..interfaces.lidar import Lidar
from ..interfaces.scan_input import ScanInbox
from ..interfaces.topics import DIAGNOSTICS
from ..priors import Priors
from ..throttled_log import ThrottledLog
from .disagreements import Disagreements, OwnBodies

PERIOD = 1.0
STALE_AFTER = 2.0
"""The diagnostic level is STALE after this time [s] without a scan."""
LOGGED_AFTER = 5.0
"""A warning is logged after this time [s] without any scan, and again whenever the time has doubled."""
MIN_ELAPSED = 1e-3
"""Shortest time [s] over which a rate is computed."""
LASER_SCAN = 'sensor_msgs/msg/LaserScan'
LEVELS = {Grade.TRACKING: DiagnosticStatus.OK, Grade.LOW_CONFIDENCE: DiagnosticStatus.WARN,
          Grade.LOST: DiagnosticStatus.ERROR}


class Diagnostics:
    """Publishes level, message and values of the odometry on ``/diagnostics``.

    `lidars` have the counters of their scans, `log` gets faults of the ROS graph. `in_map` returns the state of the
    localisation; None without a map.
    """

    def __init__(self, node: Node, lidars: Sequence[Lidar], priors: Priors, log: ThrottledLog,  # noqa: PLR0913
                 sender: TransformSender, odom: Publisher, is_paused: Callable[[], bool],
                 in_map: Callable[[], DiagnosticStatus] | None = None) -> None:
        self._node, self._priors = node, priors
        self._lidars = lidars
        self._log = log
        self._sender = sender
        self._odom = odom
        self._is_paused, self._in_map = is_paused, in_map
        self._publisher = publisher(node, DIAGNOSTICS)
        self._seen: set[str] = set()
        self._logged: set[str] = set()
        self._disagreements, self._bodies = Disagreements(), OwnBodies()
        self.restart()

    @property
    def _inboxes(self) -> list[ScanInbox]:
        """Inboxes of the lidars; empty while the node is not subscribed to scans."""
        return [lidar.inbox for lidar in self._lidars if lidar.inbox]

    def restart(self) -> None:
        """Count the scans from 0: the node has subscribed or unsubscribed."""
        self._dropped: Counter[int] = Counter()
        self._last: tuple[float, tuple[int, int, int]] | None = None
        self._last_scan = time.monotonic()
        self._heard: dict[int, tuple[int, float]] = {}
        self._patience = LOGGED_AFTER

    def publish(self) -> None:
        """Publish the state of the odometry, with rates and warnings since the last call, one `PERIOD` ago."""
        now = time.monotonic()
        counts = self._counts()
        last_time, last = self._last or (now - PERIOD, (0, 0, 0))
        elapsed = max(now - last_time, MIN_ELAPSED)
        received, processed, _ = (new - old for new, old in zip(counts, last, strict=True))
        self._last = now, counts
        if received:
            self._last_scan = now
        level, message = self._level(now - self._last_scan)
        update = self._latest().update
        status = DiagnosticStatus(
            level=level, name=f'{self._node.get_fully_qualified_name()}: laser odometry', message=message,
            hardware_id=update.features.measured.frame_id if update else '')
        pairs = [*self._rates(received / elapsed, processed / elapsed), *self._scan_counts(), *self._estimates(),
                 *((f'status {each.value}', str(sum(lidar.counters.statuses[each] for lidar in self._lidars)))
                   for each in Status)]
        status.values = [KeyValue(key=key, value=value) for key, value in pairs]
        report = DiagnosticArray(status=[status, self._in_map()] if self._in_map else [status])
        report.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(report)

    def _counts(self) -> tuple[int, int, int]:
        """Count the scans received, processed and dropped so far."""
        received, dropped = (sum(getattr(inbox, name) for inbox in self._inboxes) for name in ('received', 'dropped'))
        return received, self._total('processed'), dropped

    def _total(self, name: str) -> int:
        """Return the sum of the counter `name` over all lidars."""
        return sum(getattr(lidar.counters, name) for lidar in self._lidars)

    def _latest(self) -> Counters:
        """Return the counters of the lidar whose scan was processed last; if there is none, of the first lidar."""
        return max((lidar.counters for lidar in self._lidars),
                   key=lambda counters: counters.update.stamp if counters.update else -1)

    def _silent(self) -> list[Lidar]:
        """Return the lidars that are silent while other lidars publish."""
        now = time.monotonic()
        for lidar in self._lidars:
            if lidar.inbox and self._heard.get(lidar.rank, (None, now))[0] != lidar.inbox.received:
                self._heard[lidar.rank] = lidar.inbox.received, now
        silent = [lidar for lidar in self._lidars
                  if lidar.inbox and now - self._heard[lidar.rank][1] > STALE_AFTER]
        return [] if len(silent) == len(self._inboxes) else silent

    def _level(self, silence: float) -> tuple[bytes, str]:
        """Return level and message of the report when the last scan arrived `silence` [s] ago."""
        silent = self._silent()
        faults = self._faults(silent)
        conflict = self._sender.conflict
        grades = self._grades(silent)
        level, message = self._odometry_level(silence, grades)
        lost = [text for grade, text in grades if grade is Grade.LOST]
        about_scans = [lidar.label + text for lidar in self._lidars for text in lidar.counters.take_warnings()]
        warnings = [text for text in (*about_scans, *lost, *faults) if text not in message]
        warnings += [*self._overload(), *self._disagreements.found(self._lidars), *self._bodies.found(self._lidars)]
        if warnings and level == DiagnosticStatus.OK:
            level = DiagnosticStatus.WARN
        clocks = self._disagreements.clocks(self._lidars)
        if conflict or clocks:
            level = DiagnosticStatus.ERROR
        return level, '; '.join(filter(None, [message, conflict, *clocks, *warnings]))

    def _overload(self) -> list[str]:
        """Return and log a sentence for each lidar of which scans were dropped since the last call."""
        texts = []
        for lidar in self._lidars:
            if not lidar.inbox:
                continue
            rank, total = lidar.rank, lidar.inbox.dropped
            count, self._dropped[rank] = total - self._dropped[rank], total
            if count:
                texts.append(f'{lidar.label}too slow: {count} scans dropped')
                lidar.log.warn(f'too slow: {count} scans dropped, as others were still being processed or waited for '
                               'data; use every n-th scan only (input.every_nth), or fewer points '
                               '(advanced.density.max_points); if they wait for data, let more scans wait '
                               '(advanced.input.queue_size)')
        return texts

    def _grades(self, silent: Sequence[Lidar]) -> list[tuple[Grade, str]]:
        """Return grade and message of the latest scan of each lidar that has sent one and is not among the `silent`."""
        found = []
        for lidar in self._lidars:
            if lidar not in silent and (lidar.counters.update or lidar.counters.skip_reason):
                grade, message = lidar.counters.grade()
                found.append((grade, message if grade is Grade.TRACKING else lidar.label + message))
        return found

    def _odometry_level(self, silence: float, grades: Sequence[tuple[Grade, str]]) -> tuple[bytes, str]:
        """Return level and message for the tracking with the best lidar; dropped scans are not considered."""
        if not self._inboxes or self._is_paused():
            return DiagnosticStatus.OK, 'paused' if self._inboxes else 'inactive'
        received = any(inbox.received for inbox in self._inboxes)
        if silence > STALE_AFTER or not received:
            waiting = '; '.join(map(self._no_scans, self._inboxes))
            if not received and silence >= self._patience:
                self._node.get_logger().warning(f'{waiting} ({self._patience:.0f} s so far)')
                self._patience *= 2.0
            return DiagnosticStatus.STALE, waiting
        if not grades:
            return DiagnosticStatus.OK, 'no scan processed yet'
        grade, message = min(grades, key=itemgetter(0))
        return LEVELS[grade], message

    def _no_scans(self, inbox: ScanInbox) -> str:
        """Describe why no scan arrives on the topic of an inbox."""
        names = named(self._node.get_publishers_info_by_topic(inbox.topic))
        publishers = (f'{names} publishes there, but no scan is received' if names
                      else f'no node publishes there{self._other_scan_topics()}')
        return f'no scans on {inbox.name}: {"; ".join(inbox.source.incompatibilities()) or publishers}'

    def _other_scan_topics(self) -> str:
        """Name other topics on which scans are published, and how to subscribe to the first; empty without any."""
        topics = sorted(name for name, types in self._node.get_topic_names_and_types()
                        if LASER_SCAN in types and self._node.count_publishers(name)
                        and name not in {inbox.topic for inbox in self._inboxes})
        if not topics:
            return ''
        if len(self._lidars) > 1:
            return f'; scans are published on {", ".join(topics)}: set scan_topics to those of your lidars'
        return f'; scans are published on {", ".join(topics)}: start the node with -r scan:={topics[0]}'

    def _faults(self, silent: Sequence[Lidar]) -> list[str]:
        """Find incompatible publishers on our topics, other publishers of our odometry and `silent` lidars.

        Each finding is logged once.
        """
        faults = [text for subscription in self._node.subscriptions
                  for text in incompatibilities(self._node, subscription)]
        if self._inboxes:
            faults += filter(None, [shared(self._node, self._odom), self._priors.fault])
        faults += {text for inbox in self._inboxes if (text := inbox.competition.found(changes=2))}
        faults += [f'{self._no_scans(lidar.inbox)}; the odometry continues with the other lidars'
                   for lidar in silent if lidar.inbox]
        # The name of a new node may be discovered after its publisher.
        complete = {text for text in faults if UNNAMED not in text or text in self._seen}
        for text in sorted(complete - self._logged):
            self._log.warn(text)
        self._seen, self._logged = set(faults), complete
        return faults

    def _rates(self, rate_in: float, rate_out: float) -> Iterator[tuple[str, str]]:
        """Yield the rates [Hz] of scans and of odometry, and the processing times [ms], as (name, text)."""
        durations = [1e3 * duration for lidar in self._lidars for duration in lidar.counters.durations]
        yield 'scan rate [Hz]', f'{rate_in:.1f}'
        yield 'odometry rate [Hz]', f'{rate_out:.1f}'
        yield 'processing time median [ms]', f'{statistics.median(durations):.2f}' if durations else '-'
        yield 'processing time maximum [ms]', f'{max(durations):.2f}' if durations else '-'

    def _scan_counts(self) -> Iterator[tuple[str, str]]:
        received, processed, dropped = self._counts()
        yield 'scans received', str(received)
        yield 'scans processed', str(processed)
        yield 'scans dropped', str(dropped)
        yield 'scans skipped', str(self._total('skipped'))
        yield 'scans rejected by limits of speed', str(self._total('too_fast'))
        for lidar in self._lidars if len(self._lidars) > 1 else ():
            if lidar.inbox:
                yield f'{lidar.label}scans received', str(lidar.inbox.received)
                yield f'{lidar.label}scans dropped', str(lidar.inbox.dropped)
            yield f'{lidar.label}scans skipped', str(lidar.counters.skipped)
            yield f'{lidar.label}status failed', str(lidar.counters.statuses[Status.FAILED])

    def _estimates(self) -> Iterator[tuple[str, str]]:
        """Values of the latest registration, and what is estimated of mountings and wheels."""
        latest = self._latest()
        update, direction = latest.update, latest.degenerate_direction
        yield 'overlap', f'{update.registration.overlap:.2f}' if update and update.registration else '-'
        yield 'degenerate direction [rad]', '-' if direction is None else f'{direction:.3f}'
        yield from self._disagreements.estimates(self._lidars)
        correction = latest.wheel_correction
        if correction is not None:
            yield 'wheel distance scale correction [%]', f'{100.0 * correction[0, 0]:+.1f}'
            yield 'wheel rotation scale correction [%]', f'{100.0 * correction[2, 2]:+.1f}'
            yield 'wheel curvature correction [deg/m]', f'{math.degrees(correction[2, 0]):+.2f}'
            yield 'wheel lateral offset correction [m/rad]', f'{correction[1, 2]:+.3f}'
