# SPDX-License-Identifier: Apache-2.0
"""When the beams of a scan are measured: direction and duration of a revolution, as stated or as found by rotations."""
import dataclasses
import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...errors import ScanError
from ...features.records import Features
from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2
from ...parameters.features import AUTO, LAST_BEAM, ScanParameters
from ...parameters.tree import Parameters
from ...registration.fit import fit
from ...registration.point_to_line import refine
from ...registration.residuals import Alignment
from ...scan import Scan
from ..records import OdometryUpdate
from .stamps import middle_offset

Extract = Callable[[Scan, FloatArray], Features]
"""Extracts the features of a scan, deskewed with a twist ``(3,)`` [m/s, m/s, rad/s] of its sensor."""


class BeamTiming(NamedTuple):
    """In which order and how fast the beams of a scan are measured.

    Attributes
    ----------
    direction : str
        As the parameter `scan.direction`.
    revolution : float [s]
        Time of a revolution; 0: the `Scan.time_increment` is right.
    """

    direction: str
    revolution: float = 0.0

    def of(self, scan: Scan, last_beam: bool) -> Scan:
        """Return a scan with its beams in the order of their times; `last_beam`: the stamp is that of the last one."""
        scan = scan.as_measured(self.direction)
        if self.revolution:
            step = self.revolution * abs(scan.geometry.angle_increment) / (2.0 * math.pi)
            scan = dataclasses.replace(scan, time_increment=step)
        if last_beam and scan.time_increment:
            scan = dataclasses.replace(scan, ranges=scan.ranges[::-1], geometry=scan.geometry.backwards,
                                       time_increment=-scan.time_increment)
        return scan


class MovingScan(NamedTuple):
    """A scan of a sensor, and its motion meanwhile.

    Attributes
    ----------
    number : int
        `OdometryUpdate.number` of the scan.
    scan : Scan
        As its driver sent it.
    twist : (3,) float [m/s, m/s, rad/s]
        Velocity of the sensor, in its frame.
    middle : SE2
        Pose of the sensor in the middle of the scan, in the odometry frame.
    """

    number: int
    scan: Scan
    twist: FloatArray
    middle: SE2

    @classmethod
    def of(cls, result: OdometryUpdate, sent: Scan, measured: Scan, twist: FloatArray, pose: SE2) -> 'MovingScan':
        """Make it of the scan of a `result`, as `sent` and as used, whose sensor has a `pose` at the stamp."""
        offset = middle_offset(measured, result.features, 1.0)
        return cls(result.number, sent, twist, pose @ SE2.from_array(offset * twist))


class _Timed(NamedTuple):
    """Features of a scan, pose of its sensor at the stamp, and time [s] from there to the middle of the returns."""

    features: Features
    pose: SE2
    middle_offset: float


class _TimedScan:
    """A `MovingScan` with its features under each timing that was tried."""

    def __init__(self, moving: MovingScan, extract: Extract, last_beam: bool):
        self.moving, self._extract, self._last_beam = moving, extract, last_beam
        self._made: dict[BeamTiming, _Timed] = {}

    def under(self, timing: BeamTiming) -> _Timed:
        """Return the scan under a `timing`."""
        if timing not in self._made:
            scan, twist = timing.of(self.moving.scan, self._last_beam), self.moving.twist
            features = self._extract(scan, twist)
            offset = middle_offset(scan, features, 1.0)
            self._made[timing] = _Timed(features, self.moving.middle @ SE2.from_array(offset * twist).inverse(), offset)
        return self._made[timing]


class BeamTimingSearch:
    """Finds the timing of the beams of a lidar by its rotations.

    A scan of a rotating lidar is bent; how, depends on the direction in which the lidar turns and on the time of a
    revolution. Each new key frame is aligned with the key frames before it, under each hypothesis, and the residuals
    are compared, until one hypothesis is far more likely than the others.

    Attributes
    ----------
    found : BeamTiming or None
        The hypothesis that is right, or the stated one if none is far more likely; None while it is not known.
    middle_offset : float [s]
        Time from the stamp to the middle of the latest of the `key_frames`.
    """

    def __init__(self) -> None:
        self.found: BeamTiming | None = None
        self.middle_offset = 0.0
        self._given = ScanParameters()
        self._hypotheses = [BeamTiming(AUTO)]
        self._log_likelihoods, self._count = np.zeros(1), 0
        self._scans: deque[_TimedScan] = deque(maxlen=_EARLIER + 1)

    def restart_track(self) -> None:
        """Discard the scans, but keep what they have shown."""
        self._scans.clear()

    def measured(self, scan: Scan, given: ScanParameters) -> Scan:
        """Return a scan with its beams in the order in which they are measured, and the time between them."""
        if given != self._given:
            self.__init__()  # type: ignore[misc] # what was found depends on the parameters
            self._given = given
        timing = self.found or BeamTiming(given.direction, given.revolution)
        return timing.of(scan, given.stamp == LAST_BEAM)

    def add(self, moving: MovingScan, interval: float, extract: Extract, parameters: Parameters) -> str:
        """Add a key frame; return what was found if that changes the timing of the beams, else an empty text.

        Parameters
        ----------
        moving : MovingScan
        interval : float [s]
            Typical time between two scans.
        extract : callable
            See `Extract`.
        parameters : Parameters
        """
        hypotheses = _hypotheses(moving.scan, self._given, interval)
        same = _is_same(hypotheses, self._hypotheses)
        if not same and self._count < _FEWEST:
            self._hypotheses, self._log_likelihoods, self._count = hypotheses, np.zeros(len(hypotheses)), 0
        new = _TimedScan(moving, extract, self._given.stamp == LAST_BEAM)
        try:
            self._compare(new, parameters)
        except ScanError:  # too few returns are left under one of the hypotheses
            return ''
        self._scans.append(new)
        best = int(self._log_likelihoods.argmax())
        lead = self._log_likelihoods[best] - np.delete(self._log_likelihoods, best).max(initial=-math.inf)
        if self._count < _FEWEST or lead < _CERTAIN or (best and not same):
            if self._count < _MOST:
                return ''
            best = 0
        self.found = self._hypotheses[best]
        return '' if best == 0 else _described(self.found, moving.scan)

    def key_frames(self) -> dict[int, tuple[Features, SE2]]:
        """Return features and pose of the latest key frames by their numbers, under the timing that was found."""
        assert self.found is not None
        scans = {each.moving.number: each.under(self.found) for each in self._scans}
        self.middle_offset = self._scans[-1].under(self.found).middle_offset
        self._scans.clear()
        return {number: (timed.features, timed.pose) for number, timed in scans.items()}

    def _compare(self, new: _TimedScan, parameters: Parameters) -> None:
        """Add the evidence of a `new` key frame: the mean over those before it that are bent most differently."""
        if len(self._hypotheses) == 1:
            return
        duration = self._hypotheses[-1].of(new.moving.scan, False).duration
        bends = [duration * _bend(earlier.moving, new.moving) for earlier in self._scans]
        chosen = sorted(range(len(bends)), key=bends.__getitem__)[-_COMPARED:]
        found = [[_residual(self._scans[k].under(each), new.under(each), parameters) for each in self._hypotheses]
                 for k in chosen if bends[k] > _LEAST_BEND]
        if found:
            geometry = new.moving.scan.geometry
            surfaces = geometry.size * abs(geometry.angle_increment) / _SURFACE
            self._log_likelihoods -= 0.5 * surfaces * np.log(np.array(found) + _RESOLUTION ** 2).mean(axis=0)
            self._count += 1


def _bend(one: MovingScan, other: MovingScan) -> float:
    """Return the standard deviation over all beams, per time of a revolution [rad/s], by which one scan is bent more.

    A beam at the fraction u of a revolution is displaced by the angle rate * u. Where both scans see one place, u
    differs by the angle between both headings, and by 1 on one side of the first beam.
    """
    rates = one.twist[2], other.twist[2]
    apart = abs((one.middle.inverse() @ other.middle).theta) / (2.0 * math.pi)
    return math.sqrt((rates[0] - rates[1]) ** 2 / 12.0 + abs(rates[0] * rates[1]) * apart * (1.0 - apart))


def _hypotheses(scan: Scan, given: ScanParameters, interval: float) -> list[BeamTiming]:
    """Return the possible timings, that of the message first.

    All beams of a scan without a `time_increment` are measured at once, or in a revolution from one scan to the next.
    """
    directions = [given.direction]
    if given.direction == AUTO:
        directions.append(_OTHER[scan.geometry.angle_increment < 0.0])
    if scan.time_increment or given.revolution:
        return [BeamTiming(direction, given.revolution) for direction in directions]
    if not interval:
        return [BeamTiming(given.direction)]
    return [BeamTiming(given.direction), *(BeamTiming(direction, interval) for direction in directions)]


def _is_same(some: list[BeamTiming], others: list[BeamTiming]) -> bool:
    """Whether two lists of timings are those of one lidar: intervals vary, but a lidar turns at one speed."""
    near = abs(some[-1].revolution - others[-1].revolution) <= _SAME_INTERVAL * others[-1].revolution
    return near and [each.direction for each in some] == [each.direction for each in others]


def _residual(reference: _Timed, current: _Timed, p: Parameters) -> float:
    """Align two scans that begin at their poses; return the mean square [m^2] of the distances of points from lines."""
    lines, at, points, pose = reference.features, reference.pose, current.features, current.pose
    alignment = Alignment(points.sampled_points, lines.likelihood_field, p.refinement.damping)
    aligned, _ = refine(np.array([(at.inverse() @ pose).as_tuple()]), alignment, _SCALES)
    fitted = fit(aligned[0], alignment.points, alignment.field)
    squared = np.where(fitted.alike, fitted.residuals[0] ** 2, np.inf)
    return float(np.minimum(squared, _OUTLIER ** 2).mean())


def _described(found: BeamTiming, scan: Scan) -> str:
    """Return what was found, and what to do, as a sentence."""
    remedy = []
    if found.direction in _OTHER:
        remedy.append(f'scan.direction to {found.direction}')
    if found.revolution:
        remedy.append(f'scan.revolution to {found.revolution:.4g}')
        text = (f'time_increment is {scan.time_increment:g} s, but the beams are measured one after the other: scans '
                f'of rotations fit each other best if a revolution takes {found.revolution:.4g} s')
        text += f' and is {found.direction}' * (found.direction in _OTHER)
    else:
        text = (f'the lidar turns {found.direction}, but its beams are sent in the reverse order: scans of rotations '
                'fit each other only so')
    return f'{text}. The motion within a scan is corrected so from now on; set {" and ".join(remedy)}'


_OTHER = 'clockwise', 'counterclockwise'
"""Direction that is opposite to the order of beams sent counterclockwise, and to that of beams sent clockwise."""
_EARLIER, _COMPARED = 8, 3
"""Of this many key frames before it, a key frame is compared with so many."""
_LEAST_BEND = 0.006
"""Key frames are compared if the sensor's rotation displaces their beams by this standard deviation [rad] or more."""
_SURFACE = math.radians(10.0)
"""Errors of points within this angle [rad] are not independent: they lie on the same surface."""
_CERTAIN = 8.0
"""Log-likelihood ratio from which the best hypothesis is right. In recordings and simulated drives, no wrong hypothesis
leads by more than 3."""
_FEWEST = 3
"""The right hypothesis has to lead after at least this many key frames."""
_MOST = 20
"""After this many key frames without a lead, the difference is too small to matter."""
_SAME_INTERVAL = 0.3
"""Intervals between scans that differ by less than this fraction are the same."""
_SCALES = 0.4, 0.3, 0.2, 0.1, 0.1, 0.05, 0.05
"""Scale of the robust kernel [m] in each iteration of the alignment of two key frames."""
_OUTLIER = 0.15
"""Distance [m] of a point without a counterpart, which other points do not exceed."""
_RESOLUTION = 0.003
"""Standard deviation [m] that is added to residuals: that of a good lidar."""
