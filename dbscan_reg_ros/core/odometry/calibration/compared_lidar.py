# SPDX-License-Identifier: Apache-2.0
"""Comparisons of one further lidar with the first one, and what they show: whether it agrees, and its error."""
import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...geometry.array_types import FloatArray
from ...geometry.se2 import DOF, SE2
from ...geometry.symmetric_matrix import diagonal
from ...scan import SECOND
from .first_lidar import HALF_SPAN, FirstLidar
from .location import Location
from .relative_pose import Comparison, RelativePose, estimate_relative_pose
from .wheels import WheelComparison, Wrong


class Disagreement(NamedTuple):
    """By how much mounting and time offset of a further lidar differ from what the scans show; 0: insignificantly.

    Attributes
    ----------
    distance : float [m]
    rotation : float [rad]
        Difference of the mounting by the scans from the given one.
    time_offset : float [s]
        Time to be added to the stamps.
    """

    distance: float
    rotation: float
    time_offset: float

    def __str__(self) -> str:
        distance = f'{100.0 * self.distance:.1f} cm' if self.distance else ''
        rotation = f'{math.degrees(abs(self.rotation)):.1f} deg' if self.rotation else ''
        mounting = ' and '.join(filter(None, (distance, rotation)))
        mounting = mounting and f'its mounting is off by {mounting}'
        stamps = f'its stamps are off by {1e3 * abs(self.time_offset):.0f} ms' if self.time_offset else ''
        return ' and '.join(filter(None, (mounting, stamps)))


@dataclass
class ComparedLidar:
    """Comparisons of one further lidar.

    Attributes
    ----------
    given : SE2
        Its mounting as given; the comparisons start again if it changes.
    guess : SE2
        The mounting that the lidar probably has: the given one, unless a search has found another, or it is replaced.
    used : SE2
        The mounting that is used: the given one, unless it is replaced.
    calibrate : bool
        Whether the estimated mounting is used as soon as the given one is certainly wrong.
    comparisons : deque of Comparison
    driven, turned : float
        Distance [m] and angle [rad] over which it has been compared.
    on_trial : bool
        Whether the lidar is not used yet, because its comparisons are too few or do not agree with its mounting.
    apart : float [s]
        By how much its clock is ahead of that of the first lidar; it is not used unless this is 0.
    estimate : RelativePose or None
        The latest estimate.
    error : Disagreement or None
        The error of mounting or stamps that has lasted over a long drive, or that the wheels confirm; None if there is
        none.
    wheels : WheelComparison
        Comparison of the first lidar with the wheels.
    wrong : Wrong
        Which lidar the error is due to, by the wheels.
    """

    given: SE2
    comparisons: deque[Comparison]
    driven: float = 0.0
    turned: float = 0.0
    on_trial: bool = True
    calibrate: bool = False
    apart: float = 0.0
    estimate: RelativePose | None = None
    error: Disagreement | None = None
    wheels: WheelComparison = field(default_factory=WheelComparison)
    wrong: Wrong = Wrong.UNKNOWN
    guess: SE2 = field(init=False)
    used: SE2 = field(init=False)
    _found: deque[SE2] = field(default_factory=lambda: deque(maxlen=_LEAST))
    _searched: float = 0.0
    _pending: deque[Location] = field(default_factory=lambda: deque(maxlen=_PENDING))
    _last: SE2 | None = None
    _new: int = 0
    _suspected: bool = False
    _latest: deque[bool] = field(default_factory=lambda: deque(maxlen=_LEAST))

    def __post_init__(self) -> None:
        self.guess = self.used = self.given

    @property
    def known(self) -> bool:
        """Whether there are enough comparisons to judge the lidar."""
        return len(self.comparisons) >= _LEAST

    @property
    def disagrees(self) -> bool:
        """Whether the lidar probably disagrees with the first one, so that it is not used.

        On a straight drive the estimate of position and time offset depends on few scans. So it does not count while
        the latest scans agree with the mounting that is used.
        """
        return self._suspected and sum(self._latest) < _AGREEING

    @property
    def reason(self) -> str:
        """Why the latest scan of the lidar was not used, if it was not."""
        if self.apart:
            return 'as its clock is another one'
        if self.on_trial:
            return 'until enough of its scans agreed with the map of the first lidar'
        return 'while they disagreed with the map of the first lidar' if self.disagrees else 'at a start or repeated'

    @property
    def unfit(self) -> bool:
        """Whether the lidar has never been used over a long drive, and its error is not known either."""
        return self.on_trial and self.error is None and self._lasting

    @property
    def _lasting(self) -> bool:
        return self.driven >= _LASTING_DISTANCE and self.turned >= _LASTING_ROTATION

    def is_due(self, pose: SE2, spacing: float) -> bool:
        """Whether to compare a scan: the first ones, later one after each motion by `spacing` [m, rad] to a `pose`.

        While the lidar agrees, fewer scans are compared: each costs as much time as a scan that is registered.
        """
        if sum(self._latest) == _LEAST and not self._suspected:
            spacing *= _SPARSE
        self._last = self._last or pose
        motion = self._last.inverse() @ pose
        distance, angle = math.hypot(motion.x, motion.y), abs(motion.theta)
        if distance + angle >= max(spacing, _STEP):
            self._last = pose
            self.driven += distance
            self.turned += angle
            return True
        return not spacing or len(self.comparisons) + len(self._pending) < _LEAST

    def must_search(self) -> bool:
        """Whether to register a scan without a prior too: the lidar is not used after `_SEARCHED_AFTER`."""
        moved = self.driven + self.turned
        if not self.on_trial or moved < max(_SEARCHED_AFTER, self._searched + _SEARCH_SPACING):
            return False
        self._searched = moved
        return True

    def wait(self, location: Location) -> None:
        """Store a `location` until the motion of the first lidar at its stamp is known."""
        self._pending.append(location)

    def resolve(self, first: FirstLidar) -> None:
        """Make a comparison of each stored location for which the motion of the `first` lidar is known."""
        while self._pending and not first.must_wait(self._pending[0].stamp):
            location = self._pending.popleft()
            motion = first.motion_at(location.stamp)
            if motion is None:
                continue
            relative = motion.pose.inverse() @ location.pose
            if location.guessed:
                adjoint = relative.inverse().adjoint()
                covariance = location.covariance + adjoint @ motion.covariance @ adjoint.T
                self._compare(location._replace(covariance=covariance), relative, motion.twist)
            else:
                self._find(relative)

    def _find(self, relative: SE2) -> None:
        """Add a relative pose that was found without a guess; if the latest agree, their mean is the new guess."""
        self._found.append(relative)
        near = [relative.inverse() @ other for other in self._found if _is_near(relative, other)]
        mean = relative @ SE2.from_array(np.mean([each.as_array() for each in near], axis=0))
        if len(near) >= _AGREEING and not _is_near(mean, self.guess):
            self.guess = mean
            for each in self.comparisons, self._pending, self._latest:
                each.clear()

    def _compare(self, location: Location, relative: SE2, twist: np.ndarray) -> None:
        # A pose of the first lidar has about the covariance of one of the further lidar.
        span, turn = 2.0 * HALF_SPAN / SECOND, SE2(theta=relative.theta).adjoint()
        self.comparisons.append(Comparison(
            relative, location.covariance, twist, 2.0 / span ** 2 * turn @ location.covariance @ turn.T,
            location.key_frame))
        self._new += 1
        self._latest.append(self._agrees(relative, location.covariance))
        if self.known and sum(self._latest) >= _AGREEING:
            self.on_trial = False
        if self.known and self._new * _RENEWAL >= len(self.comparisons):
            self._new = 0
            self.judge()
            if self.calibrate:
                self._correct()

    def _agrees(self, relative: SE2, covariance: FloatArray) -> bool:
        """Whether a relative pose differs from the mounting that is used by less than what has little effect."""
        motion = (self.used.inverse() @ relative).as_array()
        return float(motion @ np.linalg.solve(covariance + _LITTLE, motion)) < PROBABLE ** 2

    def judge(self) -> RelativePose:
        """Estimate mounting and time offset from all comparisons, and judge the lidar by them."""
        estimate = self.estimate = estimate_relative_pose(self.comparisons, self.guess)
        self._suspected = any(difference(self.used, 0.0, estimate, PROBABLE))
        certain = difference(self.given, 0.0, estimate, _CERTAIN)
        if not self.disagrees and self.used == self.given:
            # Late stamps do not show in the latest scans while the velocity does not change.
            certain = certain._replace(distance=0.0, rotation=0.0)
        differs = any(certain)
        self.wrong = self.wheels.wrong(self.given, estimate) if differs else Wrong.UNKNOWN
        # What the lidars see differently, at different heights, would not move the first one against the wheels.
        self.error = certain if differs and (self._lasting or self.wrong is Wrong.FIRST) else None
        return estimate

    def _correct(self) -> None:
        """Use the estimated mounting if the given one is certainly wrong and the estimate is exact.

        While the lidar is not used, this moves nothing. Later changes are small steps, because each moves the track.
        """
        estimate = self.estimate
        if estimate is None or (_CERTAIN * estimate.sigmas[:DOF] > _EXACT).any() or (
                self.error is None and self.used == self.given):
            return
        if self.disagrees:
            self.used = self.guess = estimate.pose
            self._suspected = self.on_trial = False
            return
        motion = (self.used.inverse() @ estimate.pose).as_array()
        ratio = max(math.hypot(motion[0], motion[1]) / _STEPS[0], abs(float(motion[2])) / _STEPS[1], 1.0)
        self.used = self.guess = self.used @ SE2.from_array(motion / ratio)


def difference(given: SE2, time_offset: float, estimate: RelativePose, sigmas: float) -> Disagreement:
    """Return by how much an estimate differs from a `given` mounting and `time_offset` [s].

    What has little effect, or is below a multiple `sigmas` of the standard deviation, is 0.
    """
    x, y, yaw, time = (sigmas * estimate.sigmas).tolist()
    rotation, late = (given.inverse() @ estimate.pose).theta, estimate.time_offset - time_offset
    shift = SE2(estimate.pose.x - given.x, estimate.pose.y - given.y)
    distance = math.hypot(shift.x, shift.y)
    shifted = distance > _DISTANCE and (abs(shift.x) > x or abs(shift.y) > y)
    return Disagreement(distance if shifted else 0.0, rotation if abs(rotation) > max(_ROTATION, yaw) else 0.0,
                        late if abs(late) > max(_TIME, time) else 0.0)


def _is_near(a: SE2, b: SE2) -> bool:
    """Whether a location that begins with one of two mountings can find the other."""
    motion = a.inverse() @ b
    return math.hypot(motion.x, motion.y) < _NEAR[0] and abs(motion.theta) < _NEAR[1]


_LEAST = 10
"""Number of comparisons before a lidar is judged; the first scans are compared even at rest."""
_AGREEING = 8
"""Number of the latest `_LEAST` comparisons that have to agree with the mounting."""
_STEP = 0.05
"""Motions shorter than this [m, rad] are noise."""
_PENDING = 100
"""Number of locations that may wait for scans of the first lidar."""
_RENEWAL = 10
"""The estimate is renewed when this ratio of the comparisons, one in ten, is new."""
PROBABLE, _CERTAIN = 2.0, 4.0
"""Multiples of its standard deviation from which on a difference is probable, and certain."""
_DISTANCE, _ROTATION, _TIME = 0.02, math.radians(0.5), 0.01
"""Differences below these have little effect [m, rad, s]."""
_LITTLE = diagonal(_DISTANCE, _DISTANCE, _ROTATION) ** 2
_SPARSE = 5.0
"""The motion between two comparisons grows by this factor while the latest `_LEAST` of them agree."""
_LASTING_DISTANCE, _LASTING_ROTATION = 20.0, math.pi
"""Drive [m, rad] from which on a difference counts as an error of the mounting, and a lidar on trial as unfit."""
_SEARCHED_AFTER, _SEARCH_SPACING = 4.0, 0.5
"""Drive [m + rad] after which the mounting of a lidar on trial is searched for, and between two scans of the search."""
_NEAR = 0.3, math.radians(8.0)
"""Differences of mountings [m, rad] within which a location that begins with one of them finds the other."""
_EXACT = np.array([_DISTANCE, _DISTANCE, _ROTATION])
"""An estimate replaces the given mounting if `_CERTAIN` standard deviations are below this [m, m, rad]."""
_STEPS = 0.002, math.radians(0.05)
"""Largest change of a mounting that is used [m, rad]."""
