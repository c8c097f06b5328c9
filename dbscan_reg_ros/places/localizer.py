# SPDX-License-Identifier: Apache-2.0
"""The pose of a robot in a map, without an initial guess."""
import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import expect
from ..core.features.records import Features
from ..core.geometry.se2 import DOF, SE2, lever_arm, turn_matrix, turned, wrap
from ..core.odometry.records import OdometryUpdate
from ..core.parameters.tree import Parameters, expect_parameters
from ..core.registration.records import Status, sigma_text
from ..recordings.poses import compose, relative
from .evidence import INDEPENDENT, log_odds, log_odds_alone, probabilities
from .grid import Grid
from .map import Map
from .matching import FROM_AFAR, Drive, Matcher, Stop
from .signatures import BEARINGS, Signatures

SPACING = 0.5
"""Distance [m] from one view to the next."""
STEP, TURN = 0.3, 0.35
"""A scan is compared with the map if the sensor has moved by one of these [m, rad] since the last one."""
SEARCHED, TRACKED = 30, 12
"""Largest number of scans that are placed in the map together, in a search and afterwards: so long the odometry hardly
drifts."""
ALIKE = 400
"""Number of views and headings, the most similar first, among which `SKETCHED` poses are chosen."""
SKETCHED, RETURNS = 150, 60
"""Number of poses at which a scan is aligned roughly, and of the returns that are used for this."""
CANDIDATES = 10
"""Number of the best of these poses that are aligned with all that was seen."""
KEPT = 20
"""Largest number of hypotheses."""
APART, APART_TURN = 0.5, 0.25
"""Poses at which a scan is aligned roughly differ by one of these [m, rad]."""
SAME, SAME_TURN = 0.4, 0.12
"""Hypotheses that differ by less than these [m, rad] are one."""
UNCERTAIN = np.array((SAME, SAME, SAME_TURN)) ** 2
"""Variances [m, m, rad] of the odometry between two scans from which on they are not placed in the map together."""
CERTAIN = 0.99
"""Probability of a hypothesis from which on the robot is localised there, and of the absence of all of them."""
SURE = math.log(CERTAIN / (1.0 - CERTAIN))
"""Log-odds of `CERTAIN`."""
DOUBTED = (1, 2.0 * SURE), (4, SURE)
"""Once the robot is localised: numbers of the latest scans, and the log-odds against its pose from which on they begin
a new search. One scan, of which people may hide much, has to outweigh the odds of `CERTAIN` that came before."""
DRAWN = 200
"""Number of poses that are drawn from the covariance of a pose that is given."""
LOST = np.diag((10.0, 10.0, math.pi)) ** 2
"""Covariance [m, m, rad] of the pose once the scans have contradicted it."""
DRIFT = np.diag((0.01, 0.01, 0.002)) ** 2
"""Covariance [m, m, rad] of the odometry from one scan that is used to the next."""
OF_MAP = np.diag((0.03, 0.03, 0.005)) ** 2
"""Covariance [m, m, rad] of the map itself."""


class State(Enum):
    """What is known of the pose in the map."""

    SEARCHING = 'searching'
    """Nothing is sure yet."""
    LOCALISED = 'localised'
    """The pose is known."""
    AMBIGUOUS = 'ambiguous'
    """Two places or more look like this one."""
    NOT_IN_MAP = 'not in this map'
    """No place in the map looks like this one."""


@dataclass(frozen=True, eq=False)
class Localization:
    """What the `Localizer` knows after a scan.

    Attributes
    ----------
    state : State
    transform : SE2 or None
        Pose of the frame of the odometry in the map; None before the first time that the robot was localised.
    pose : SE2 or None
        Pose of the first sensor in the map: ``transform @ update.pose``.
    covariance : (3, 3) float or None
        Covariance of `pose` for (x, y, theta) in the map [m, m, rad].
    hypotheses : list of (SE2, float)
        Poses of the first sensor in the map, and their probabilities, the most probable first.
    elsewhere : float
        Probability that the sensor is at none of them.
    """

    state: State
    transform: SE2 | None
    pose: SE2 | None
    covariance: NDArray[np.float64] | None
    hypotheses: list[tuple[SE2, float]]
    elsewhere: float

    def __repr__(self) -> str:
        """Return one line."""
        where = ''
        if self.pose is not None and self.covariance is not None:
            where = f', {self.pose.brief()}, {sigma_text(self.covariance, "the map")}'
        return f'Localization({self.state.value}{where}, {len(self.hypotheses)} hypotheses)'


class Localizer:
    """Finds the pose of a robot in a map, and follows it.

    Parameters
    ----------
    known : Map or Grid
        The map.
    parameters : Parameters
        Those of the odometry.
    """

    _covariance: NDArray[np.float64] | None
    """Of the pose in the map, for the position of the point `_middle` of the odometry frame; None: it may be any."""

    def __init__(self, known: Map | Grid, parameters: Parameters = Parameters()) -> None:
        expect_parameters(parameters)
        if not isinstance(known, Grid):
            expect('known', known, Map, 'Map.load(FILE), or load_grid(FILE) of places.map_files')
        grid = known if isinstance(known, Grid) else Grid.of_map(known, parameters)
        bearings = np.linspace(-np.pi, np.pi, BEARINGS, endpoint=False, dtype=np.float64)
        self._matcher, self._views = Matcher(grid), grid.free_poses(SPACING)
        self._signatures = Signatures(grid.cast(self._views, bearings))
        self.reset()

    def reset(self) -> None:
        """Forget the pose: the next scan begins a new search, as in a new odometry."""
        self._transform: NDArray[np.float64] | None = None
        self._failed = False
        self._forget()

    def search(self) -> None:
        """Search the whole map from the next scan on; until the robot is found, the last `transform` is kept."""
        self._forget()

    def set_pose(self, pose: SE2, covariance: NDArray[np.float64], update: OdometryUpdate) -> None:
        """Take over a pose in the map, until the scans contradict it.

        Parameters
        ----------
        pose : SE2
            Of the first sensor in the map.
        covariance : (3, 3) float
            Of `pose`, for (x, y, theta) in the map [m, m, rad].
        update : OdometryUpdate
            The update at which the sensor is there.
        """
        self._forget()
        back = update.pose.inverse()
        self._state, self._transform = State.LOCALISED, (pose @ back).as_array()
        self._hypotheses, self._probabilities, self._elsewhere = self._transform[None], np.ones(1), 0.0
        self._used, self._odometry_covariance = update.pose.as_array(), update.covariance
        self._covariance, self._middle = covariance, self._used[:2]
        self._given = _drawn(pose, covariance, back)

    def process(self, update: OdometryUpdate) -> Localization:
        """Use the next scan of the odometry.

        Parameters
        ----------
        update : OdometryUpdate
            Of the first sensor, or of another one: its `features` are placed by its `scan_pose`.
        """
        if update.starts_track:
            self._forget()
        self._failed |= update.status is Status.FAILED
        # After a scan that failed, the motion is known again at the next one that is OK: until then the pose is where
        # the scan alone suits the map, and a scan that suits it nowhere near by shows that the pose is wrong.
        unknown = self._failed and update.status is not Status.OK
        placed = self._placed(update) if unknown and self._state is State.LOCALISED else None
        moved, is_placed = self._moved(update.pose.as_array()), placed is not None and placed[0] is State.LOCALISED
        waits = update.waits or update.status is Status.FAILED or (is_placed and not moved)
        if not waits and (self._failed or moved):
            self._failed, placed = False, None
            self._use(update)
        return self._report(update, placed)

    def candidates(self, features: Features) -> NDArray[np.float64]:
        """Return the poses (C, 3) in the map where a scan with these `features` fits best.

        They are chosen among those at which it looks most like the views.
        """
        points = features.points
        similarity = self._signatures.compare(np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])).ravel()
        alike = np.argpartition(-similarity, min(ALIKE, len(similarity) - 1))[:ALIKE]
        view, heading = np.divmod(alike, BEARINGS)
        poses = self._views[view] + np.column_stack((np.zeros((len(alike), 2)), heading * (2.0 * np.pi / BEARINGS)))
        poses = poses[_distinct(poses, -similarity[alike], APART, APART_TURN, SKETCHED)]
        poses = self._matcher.align(poses, points, RETURNS, FROM_AFAR).poses
        odds = log_odds_alone(self._matcher.count(poses, Drive.of([Stop.of(SE2(), features)])))
        return poses[_distinct(poses, -odds, SAME, SAME_TURN, CANDIDATES)]

    def _use(self, update: OdometryUpdate) -> None:
        """Place a scan in the map."""
        pose, spread = update.pose.as_array(), None if self._covariance is None else self._spread(update)
        if self._stops and (self._motion_covariance(update).diagonal() > UNCERTAIN).any():
            self._forget()
            spread = None if spread is None else spread + np.diag(UNCERTAIN)
        if self._state is not State.LOCALISED:
            self._covariance, self._middle = spread, pose[:2]
        self._stops.append(Stop.of(update.scan_pose, update.features))
        self._used, self._odometry_covariance = pose, update.covariance
        if self._state is State.LOCALISED:
            self._track()
        else:
            self._search(update.features)

    def _forget(self) -> None:
        """Begin a new search."""
        self._stops: list[Stop] = []
        self._hypotheses = np.empty((0, DOF))
        self._probabilities, self._elsewhere, self._searched = np.empty(0), 1.0, 0
        self._state = State.SEARCHING
        self._covariance = None
        # Where a pose that was given may be: of the odometry frame in the map; none once the scans confirm it.
        self._given = np.empty((0, DOF))

    def _moved(self, pose: NDArray[np.float64]) -> bool:
        """Whether the robot has moved since the last scan that was used."""
        if not self._stops:
            return True
        x, y, theta = relative(self._used[None], pose[None])[0]
        return math.hypot(x, y) > STEP or abs(theta) > TURN

    def _search(self, features: Features) -> None:
        """Place the last scans at all hypotheses and at those of the latest scan, which has these `features`."""
        self._stops = self._stops[-SEARCHED:]
        self._searched += 1
        drive, latest = Drive.of(self._stops), self._stops[-1].pose
        back = relative(latest[None], np.zeros((1, DOF)))
        candidates = self.candidates(features)
        starts = np.vstack((self._hypotheses, compose(candidates, np.repeat(back, len(candidates), axis=0))))
        aligned = self._matcher.align(starts, drive.hits)
        counts = self._matcher.count(aligned.poses, drive)
        places = compose(aligned.poses, np.repeat(latest[None], len(starts), axis=0))
        alone = log_odds_alone(counts)
        kept = _distinct(places, -alone, SAME, SAME_TURN, KEPT)
        odds = log_odds(counts[kept])
        order = np.argsort(-odds, kind='stable')
        kept = kept[order]
        self._hypotheses = aligned.poses[kept]
        self._probabilities, missed, outside = probabilities(odds[order], self._searched)
        self._elsewhere = missed + outside
        if self._probabilities[0] >= CERTAIN and alone[kept[0]] > 0.0:
            self._state, self._transform = State.LOCALISED, self._hypotheses[0]
            self._covariance, self._middle = aligned.covariance(kept[0]), aligned.middle
        elif self._probabilities[0] < CERTAIN <= self._probabilities.sum():
            self._state = State.AMBIGUOUS
        else:
            self._state = State.NOT_IN_MAP if outside >= CERTAIN else State.SEARCHING

    def _track(self) -> None:
        """Correct the pose by the last scans; search again if they do not suit the map there."""
        assert self._transform is not None
        self._stops = self._stops[-TRACKED:]
        drive = Drive.of(self._stops)
        if len(self._given):
            self._confirm(drive)
            return
        aligned = self._matcher.align(self._transform[None], drive.hits)
        self._transform, self._hypotheses = aligned.poses[0], aligned.poses
        against = [-log_odds_alone(self._matcher.count(aligned.poses, Drive.of(self._stops[-last:])))[0] - limit
                   for last, limit in DOUBTED]
        if max(against) > 0.0:
            self._doubt()
            return
        # Each scan is aligned several times, and counts once.
        moved = _carried(self._covariance, self._transform, aligned.middle - self._middle) + DRIFT
        self._middle = aligned.middle
        self._covariance = np.linalg.inv(np.linalg.inv(moved) + aligned.information[0] / (INDEPENDENT * TRACKED))

    def _doubt(self) -> None:
        """Search again, from the latest scan on."""
        latest = self._stops[-1]
        self._forget()
        self._stops = [latest]

    def _confirm(self, drive: Drive) -> None:
        """Correct a given pose once the scans suit one place within its covariance, and search if they suit none."""
        assert self._transform is not None
        spread = _carried(self._covariance, self._transform, self._used[:2] - self._middle) + OF_MAP
        fit = self._fit(self._given, drive, self._used, spread)
        if fit.odds < -SURE:
            self._doubt()
        elif fit.is_sure:
            self._transform, self._hypotheses = fit.transform, fit.transform[None]
            self._covariance, self._middle, self._given = fit.covariance, fit.middle, self._given[:0]

    def _fit(self, given: NDArray[np.float64], drive: Drive, pose: NDArray[np.float64], spread: NDArray[np.float64]
             ) -> '_Fit':
        """Return where a drive suits the map best.

        The transforms `given` (N, 3), the first their mean, put the latest `pose` (3,) of the odometry at poses in the
        map with the covariance `spread` (3, 3).
        """
        aligned = self._matcher.align(given, drive.hits, scales=FROM_AFAR)
        odds = log_odds_alone(self._matcher.count(aligned.poses, drive))
        at, mean = (compose(poses, np.repeat(pose[None], len(poses), axis=0)) for poses in (aligned.poses, given[:1]))
        off = at - mean
        off[:, 2] = wrap(off[:, 2])
        posterior = odds - 0.5 * np.einsum('hi,hi->h', off, np.linalg.solve(spread, off.T).T)
        best = _distinct(at, -posterior, SAME, SAME_TURN, KEPT)
        share = np.exp(posterior[best] - posterior[best[0]])
        return _Fit(aligned.poses[best[0]], aligned.covariance(best[0]), aligned.middle, float(odds.max()),
                    bool(share[0] / share.sum() >= CERTAIN and odds[best[0]] > 0.0))

    def _placed(self, update: OdometryUpdate) -> tuple[State, SE2, NDArray[np.float64]]:
        """Return the state, the transform and the covariance by a scan whose motion the odometry does not know.

        If the scan suits the map at one place near the predicted pose, it is there; if at none, it may be anywhere.
        """
        assert self._transform is not None
        transform, pose = SE2.from_array(self._transform), update.pose.as_array()
        spread = self._spread(update) + OF_MAP + np.diag(UNCERTAIN)
        drive = Drive.of([Stop.of(update.scan_pose, update.features)])
        fit = self._fit(_drawn(transform @ update.pose, spread, update.pose.inverse()), drive, pose, spread)
        if not fit.is_sure:
            return State.SEARCHING, transform, LOST if fit.odds < -2.0 * SURE else spread
        return (State.LOCALISED, SE2.from_array(fit.transform),
                _carried(fit.covariance, fit.transform, pose[:2] - fit.middle) + OF_MAP)

    def _spread(self, update: OdometryUpdate) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of the pose in the map at an update, without that of the map itself."""
        assert self._transform is not None and self._covariance is not None
        offset = np.array((update.pose.x, update.pose.y)) - self._middle
        return (_carried(self._covariance, self._transform, offset)
                + turned(self._motion_covariance(update), self._transform[2]))

    def _motion_covariance(self, update: OdometryUpdate) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of the motion since the last scan that was used, in the odometry frame."""
        return motion_covariance(self._used, self._odometry_covariance, update)

    def _report(self, update: OdometryUpdate, placed: tuple[State, SE2, NDArray[np.float64]] | None) -> Localization:
        """Return what is known at the pose of an update; `placed` is that of `_placed`, if it counts."""
        latest = np.repeat(update.pose.as_array()[None], len(self._hypotheses), axis=0)
        places = [SE2.from_array(pose) for pose in compose(self._hypotheses, latest)]
        hypotheses = list(zip(places, self._probabilities.tolist(), strict=False))
        if self._transform is None:
            return Localization(self._state, None, None, None, hypotheses, self._elsewhere)
        state, transform, covariance = self._state, SE2.from_array(self._transform), LOST
        if placed is not None:
            state, transform, covariance = placed
        elif self._covariance is not None:
            covariance = self._spread(update) + OF_MAP
        return Localization(state, transform, transform @ update.pose, covariance, hypotheses, self._elsewhere)


class _Fit(NamedTuple):
    """Where a drive suits the map best.

    `transform` (3,) and `covariance` (3, 3), of the point `middle` (2,) of the odometry frame, are those of `Aligned`;
    `odds` are the largest log-odds of all poses; `is_sure`: none other is as probable.
    """

    transform: NDArray[np.float64]
    covariance: NDArray[np.float64]
    middle: NDArray[np.float64]
    odds: float
    is_sure: bool


def motion_covariance(pose: Iterable[float], covariance: NDArray[np.float64], update: OdometryUpdate
                      ) -> NDArray[np.float64]:
    """Return the covariance of the motion since an earlier update of the odometry.

    Parameters
    ----------
    pose, covariance : SE2 or (3,) float, (3, 3) float
        Those of the earlier update.
    update : OdometryUpdate

    Returns
    -------
    (3, 3) float
        In the odometry frame [m, m, rad]; zero in directions in which the odometry knows its pose better than before.
    """
    x, y, _ = pose
    lever = lever_arm(update.pose.x - x, update.pose.y - y)
    values, axes = np.linalg.eigh(update.covariance - lever @ covariance @ lever.T)
    found: NDArray[np.float64] = axes * np.maximum(values, 0.0) @ axes.T
    return found


def _drawn(pose: SE2, covariance: NDArray[np.float64], back: SE2) -> NDArray[np.float64]:
    """Return poses drawn from a covariance about the first of them, `pose` itself, each composed with `back`."""
    normal = np.random.default_rng(0).standard_normal((DRAWN, DOF))
    values, axes = np.linalg.eigh(covariance)
    drawn = pose.as_array() + np.vstack((np.zeros(DOF), normal * np.sqrt(np.maximum(values, 0.0)) @ axes.T))
    return compose(drawn, np.repeat(back.as_array()[None], len(drawn), axis=0))


def _distinct(poses, ranks, apart, turn, most) -> NDArray[np.int64]:
    """Return the numbers of at most so many `poses` (N, 3), smallest of `ranks` (N,) first, that differ enough."""
    left, kept = np.argsort(ranks, kind='stable'), list[int]()
    while len(left) and len(kept) < most:
        first = left[0]
        kept.append(first)
        off = poses[left] - poses[first]
        left = left[(np.hypot(off[:, 0], off[:, 1]) > apart) | (np.abs(wrap(off[:, 2])) > turn)]
    return np.array(kept, dtype=int)


def _carried(covariance, transform, offset):
    """Return the covariance (3, 3) at another point of a body, at `offset` (2,) in the frame with this `transform`."""
    lever = lever_arm(*(turn_matrix(transform[2])[:2, :2] @ offset))
    return lever @ covariance @ lever.T
