# SPDX-License-Identifier: Apache-2.0
"""One further lidar, judged by its latest scans that were located in the map of the first lidar."""
import math
from collections import deque
from dataclasses import dataclass, field
from itertools import islice
from statistics import median

from ...geometry.se2 import SE2
from ...scan import SECOND
from .first_lidar import HALF_SPAN, FirstLidar
from .location import Location
from .relative_pose import MEDIAN, Comparison, Disagreement, RelativePose, difference, estimate_relative_pose, misfits


@dataclass
class ComparedLidar:
    """Comparisons of one further lidar, and whether they fit its mounting: a chi-square test with hysteresis.

    Attributes
    ----------
    given : SE2
        Its mounting; the comparisons start again if it changes.
    comparisons : deque of Comparison
    uses : bool
        Whether its scans may be used: the latest fit the given mounting, or the mounting was just corrected.
    disagrees : bool
        Whether it is not used and named: the latest scans of a drive do not fit.
    driven, turned : float
        Distance [m] and angle [rad] over which it has been compared.
    apart : float [s]
        By how much its clock is ahead of that of the first lidar; it is not used unless this is 0.
    """

    given: SE2
    comparisons: deque[Comparison]
    uses: bool = False
    disagrees: bool = False
    driven: float = 0.0
    turned: float = 0.0
    apart: float = 0.0
    _pending: deque[Location] = field(default_factory=lambda: deque(maxlen=_PENDING))
    _last: SE2 | None = None
    _estimate: RelativePose | None = None

    @property
    def known(self) -> bool:
        """Whether there are enough comparisons to judge the lidar."""
        return len(self.comparisons) >= _LEAST

    @property
    def unfit(self) -> bool:
        """Whether its scans fit no mounting: they are scattered, or after a long drive hardly one was located."""
        if self.disagrees:
            return self._misfit(self.estimate.pose, self.estimate.time_offset) > _DISAGREES
        return not self.known and self.driven + self.turned >= _LONG

    @property
    def estimate(self) -> RelativePose:
        """Mounting and time offset by all comparisons; where they do not determine them, as given."""
        if self._estimate is None:
            self._estimate = estimate_relative_pose(self.comparisons, self.given)
        return self._estimate

    @property
    def error(self) -> Disagreement:
        """By how much the given mounting and the stamps differ from the estimate."""
        return difference(self.given, self.estimate)

    @property
    def reason(self) -> str:
        """Why the latest scan of the lidar was not used, if it was not."""
        if self.apart:
            return 'as its clock is another one'
        if self.uses:
            return 'at a start or repeated'
        return ('while they disagreed with the map of the first lidar' if self.disagrees else
                'until enough of its scans agreed with the map of the first lidar')

    def is_due(self, pose: SE2, spacing: float) -> bool:
        """Whether to compare a scan: one after each motion by `spacing` [m, rad] to a `pose`, the first ones sooner."""
        if len(self.comparisons) < _LATEST:
            spacing *= _SOONER
        self._last = self._last or pose
        motion = self._last.inverse() @ pose
        distance, angle = math.hypot(motion.x, motion.y), abs(motion.theta)
        if distance + angle >= max(spacing, _STEP):
            self._last = pose
            self.driven += distance
            self.turned += angle
            return True
        return not spacing

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
            adjoint, turn = relative.inverse().adjoint(), SE2(theta=relative.theta).adjoint()
            covariance = location.covariance + adjoint @ motion.covariance @ adjoint.T
            # A pose of the first lidar has about the covariance of one of the further lidar.
            twist_covariance = 2.0 * (SECOND / (2.0 * HALF_SPAN)) ** 2 * turn @ covariance @ turn.T
            self._add(Comparison(relative, covariance, motion.twist, twist_covariance, location.key_frame))

    def _add(self, comparison: Comparison) -> None:
        """Add a comparison, and judge the lidar: less strictly while it is used, and at the end of a trial."""
        self.comparisons.append(comparison)
        self._estimate = None
        if self.known:
            tried = len(self.comparisons) >= _LATEST and self.driven + self.turned >= _TRIAL
            ends = tried and not self.disagrees
            self.uses = self._misfit(self.given) < (_DISAGREES if self.uses or ends else _AGREES)
            self.disagrees = tried and not self.uses

    def _misfit(self, pose: SE2, time_offset: float = 0.0) -> float:
        """Return the median of the chi-squares of the latest scans for a mounting and a time offset."""
        latest = islice(self.comparisons, max(len(self.comparisons) - _LATEST, 0), None)
        return float(median(misfits(list(latest), pose, time_offset).tolist()))


_LEAST, _LATEST = 10, 30
"""Number of comparisons before a lidar is used, and number of the latest that judge it."""
_AGREES, _DISAGREES = MEDIAN, 7.815
"""Median and 95 % quantile of chi-square with three degrees of freedom: below the first a lidar is used that was not,
above the second it is not used that was."""
_SOONER = 0.125
"""Ratio of the motion between two of the first `_LATEST` comparisons to the later ones."""
_TRIAL = 8.0
"""Drive [m + rad] before a lidar is named: at one place both may see different things, at different heights."""
_STEP = 0.05
"""Motions shorter than this [m, rad] are noise."""
_PENDING = 100
"""Number of locations that may wait for scans of the first lidar."""
_LONG = 20.0
"""Drive [m + rad] after which a lidar is named of which hardly a scan was located."""
