# SPDX-License-Identifier: Apache-2.0
"""How the odometry is doing: counted scan by scan, told once a second."""
import math
from collections import Counter, deque
from dataclasses import dataclass, field

from ...core.geometry.se2 import SE2
from ...core.registration.records import Status

SECOND_OPINION = 200
"""The timing is that of this many of the last scans."""


@dataclass
class Health:
    """What has happened since the node started, and since it was last asked.

    Attributes
    ----------
    answered, skipped : int
        Scans so far.
    statuses : Counter
        How many scans had each `Status`.
    update : OdometryUpdate or None
        The last one.
    direction : float or None
        Angle [rad] in `odom_frame` that the last scan left undetermined.
    place : SE2 or None
        The sensor's, on the base.
    trouble : str
        Why the last scan was not answered; empty when it was.
    doubts : dict
        What was odd about the scans since it was last asked: kind -> text.
    """

    answered: int = 0
    skipped: int = 0
    statuses: Counter = field(default_factory=Counter)
    update: object = None
    direction: float | None = None
    place: SE2 | None = None
    trouble: str = ''
    doubts: dict = field(default_factory=dict)
    durations: deque = field(default_factory=lambda: deque(maxlen=SECOND_OPINION))

    def processed(self, update, origin, place, duration):
        """Take note of an update that took `duration` [s].

        `origin` is the odometry's own frame in `odom_frame`, `place` the sensor's on the base.
        """
        self.answered += 1
        self.statuses[update.status] += 1
        self.durations.append(duration)
        self.update = update
        self.trouble = ''
        self.place = place
        self.direction = None
        if update.registration and update.registration.degenerate_direction is not None:
            self.direction = (origin @ update.reference_pose).theta + update.registration.degenerate_direction

    @property
    def wheel_correction(self):
        """What is wrong with told motions of the base: `OdometryUpdate.wheel_correction` in its frame; None while nothing is known."""
        if not self.update or not self.update.wheel_correction.any():
            return None
        return self.place.adjoint() @ self.update.wheel_correction @ self.place.inverse().adjoint()

    def skip(self, trouble):
        """Take note of a scan that was not answered."""
        self.skipped += 1
        self.trouble = trouble

    def doubt(self, warnings):
        """Take note of what is odd about a scan, a list of `ScanWarning`."""
        self.doubts.update((warning.kind, warning.text) for warning in warnings)

    def take_doubts(self) -> list:
        """What was odd about the scans since the last call, in words."""
        told, self.doubts = list(self.doubts.values()), {}
        return told

    def judge(self):
        """(whether all is well, is doubtful or is lost: 0, 1 or 2; that in words)"""
        if self.trouble:
            return 2, self.trouble
        reason = self.update.registration.reason if self.update.registration else ''
        status = self.update.status
        if status is Status.FAILED:
            return 2, f'lost: {reason}'
        if status is Status.DEGENERATE:
            along = '' if self.direction is None else (
                f', along {math.degrees(math.remainder(self.direction, math.pi)):.0f} deg in the odometry frame')
            return 1, f'degenerate{along}: {reason}'
        if status is Status.AMBIGUOUS:
            return 1, f'ambiguous: {reason}'
        return 0, 'tracking'
