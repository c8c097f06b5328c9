# SPDX-License-Identifier: Apache-2.0
"""A map that is built while the robot drives: places that are new are added, places seen before close loops."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.features.records import Features
from ..core.geometry.se2 import DOF, SE2, lever_arm, turned
from ..core.odometry.models.unobserved_motion import displacement_covariance
from ..core.odometry.records import OdometryUpdate
from ..core.parameters.tree import Parameters
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..core.registration.status import demoted_if_poor
from ..core.scan import SECOND
from ..recordings.poses import compose
from .localizer import LOST, Localization, Localizer, State, motion_covariance
from .map import Map, View, difference
from .pose_graph import Constraints, PoseGraph, optimise, relative_covariance

AWAY = 10.0
"""Two scans close a loop only if the sensor has driven at least this distance [m] between them."""
NEAR, DRIFT = 1.0, 0.01
"""Two scans close a loop only if their distance is at most this [m], plus this fraction of the distance driven."""
TURNED = 0.35
"""A loop that corrects the heading by more than this [rad] is rejected."""
TRIED = 3
"""Largest number of earlier key frames, most similar first, to which each key frame is registered."""
LEAST_POINTS = 3.0
"""Number of effective points that have to constrain the translation of a loop in every direction: of fewer, residuals
do not show how large their errors are, and no prediction limits them."""
EVENED = 3.0
"""The odometry aligns a key frame with many older ones at once, so that its error moves those after it by a fraction
only: one over this number, as far as the scan constrains the pose. If errors were independent, the number would be the
mean age of what a key frame is aligned with, 7 to 15 key frames; but real scans repeat some of them."""
STEP_SPREAD, LOOP_SPREAD = np.array((0.003, 0.003, 0.0012)), np.array((0.005, 0.005, 0.002))
"""Standard deviations [m, m, rad] added to the covariance that is published of a motion from one key frame to the next,
in which no error is evened out, and to that of a loop."""
GROWTH = 1.1
"""If every key frame is kept, the poses are optimised each time that there are so many times more of them: all of it
together takes about ten times as long as the last time."""
GAP_SPREAD = np.array((1.0, 1.0, 1.0))
"""The same if no scan was received for long between them: the scan after the gap may have been found elsewhere."""


class Relation(NamedTuple):
    """A key frame of the map, and the pose of a sensor in it.

    `covariance` (3, 3) is that of `motion`, in the frame of the sensor.
    """

    frame: int
    motion: SE2
    covariance: NDArray[np.float64]

    def then(self, step: SE2, covariance: NDArray[np.float64]) -> 'Relation':
        """Return the relation to the sensor after a further step, whose `covariance` is in the frame at its end."""
        back = step.inverse().adjoint()
        return Relation(self.frame, self.motion @ step, back @ self.covariance @ back.T + covariance)


class Mapper:
    """Builds a map while the robot drives, and closes its loops.

    A key frame of the odometry becomes one of the map only where none of the map shows the same, so that the map of a
    building stops growing once all of it was seen. One that was seen long ago counts only if the scan is found in it:
    otherwise drift led back to it, as along a corridor. A key frame that is registered to an old one of the map, over
    `AWAY` of driving or more, adds a constraint, and all poses are optimised. After a loss the robot is searched for in
    the map so far by the `Localizer`; the key frames since then join the map once it is found.

    All of this is computed in `process`, which takes some milliseconds for a key frame and up to seconds after a loss:
    a caller that must not wait calls it in another thread. Only one thread may use a mapper.

    Parameters
    ----------
    parameters : Parameters
        Those of the odometry.
    every : bool
        Every key frame of the odometry becomes one of the map: all constraints are kept, for a drive that ends.

    Attributes
    ----------
    numbers : list of int
        `OdometryUpdate.number` of each key frame.
    seen_again : Relation or None
        How the latest scan was registered to a key frame that was seen long before.
    """

    def __init__(self, parameters: Parameters = Parameters(), every: bool = False) -> None:
        self._parameters, self._every = parameters, every
        self.reset()

    def reset(self) -> None:
        """Begin a new map, whose frame is that of the odometry at the next scan."""
        self._views: list[View] = []
        self.numbers: list[int] = []
        self.seen_again: Relation | None = None
        self._sensors: list[str] = []
        self._poses = np.empty((0, DOF))
        self._covariances: list[NDArray[np.float64]] = []
        self._constraints: dict[tuple[int, int], tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        # Of each key frame: the way driven until it was seen last.
        self._seen: list[float] = []
        self._way, self._last = 0.0, SE2()
        # The latest key frame of the odometry, and where it is in the map.
        self._key: OdometryUpdate | None = None
        self._relation, self._gap = Relation(0, SE2(), np.zeros((DOF, DOF))), False
        # The same with the covariance that is published.
        self._published = self._relation
        # That of the robot and that of each key frame; all of track 0 are in one map.
        self._track, self._tracks = 0, list[int]()
        # Whether there are constraints that the poses do not follow from, and the number of key frames when they did.
        self._unsettled, self._settled = False, 0
        # Whether each key frame shows what none before it did.
        self._shows_new: list[bool] = []
        self._localizer: Localizer | None = None
        self._found: Localization | None = None

    def process(self, update: OdometryUpdate) -> Localization:
        """Use the next scan of the odometry.

        Returns
        -------
        Localization
            `State.LOCALISED`, and `State.SEARCHING` after a loss. The `transform` is the identity at the start, and
            jumps where a loop is closed. The covariance of `pose` is that of the shortest chain of motions from the
            first key frame, which is more than the optimised map has.
        """
        self._way += float(np.hypot(update.pose.x - self._last.x, update.pose.y - self._last.y))
        self._last = update.pose
        if update.reference is not None and self._key and update.reference_number == self._key.number:
            self._refine(update.reference)
        self.seen_again, self._gap = None, self._gap or bool(update.restarted)
        if self._track and not update.starts_track:
            self._search(update)
        if update.is_key_frame:
            self._add(update)
        return self._report(update)

    @property
    def graph(self) -> PoseGraph:
        """The poses of the key frames, and all constraints between them."""
        self._settle()
        return PoseGraph(self._poses, self._all_constraints())

    def _settle(self) -> None:
        """Optimise the poses, if there are constraints that they do not follow from."""
        if self._unsettled:
            self._poses = optimise(self._poses, self._all_constraints())
            self._unsettled, self._settled = False, len(self._views)

    def _all_constraints(self) -> Constraints:
        """Return all constraints between key frames."""
        pairs = np.array(list(self._constraints), dtype=np.int64).reshape(-1, 2)
        motions = np.array([motion for motion, _ in self._constraints.values()]).reshape(-1, DOF)
        covariances = np.array([covariance for _, covariance in self._constraints.values()]).reshape(-1, DOF, DOF)
        return Constraints(pairs, motions, covariances)

    @property
    def anchor(self) -> tuple[int, SE2]:
        """A key frame near the robot, and the pose of the odometry frame in it, by the latest key frame.

        With the `graph` of the whole drive they give its final poses: ``graph.poses[number] @ pose @ update.pose``.
        """
        place = self._key.scan_pose if self._key else SE2()
        return self._relation.frame, self._relation.motion @ place.inverse()

    def map(self, mounting: SE2 = SE2()) -> Map:
        """Return the map so far; it does not change when the mapper goes on. `mounting` is that of the `Map`.

        Key frames since a loss are no views of it until the robot is found.
        """
        views = [view for view, track, is_new in zip(self._views, self._tracks, self._shows_new, strict=True)
                 if is_new and not track]
        return Map(self.graph, views, mounting)

    def _refine(self, features: Features) -> None:
        """Take over how the latest key frame is deskewed, if it is of the map."""
        view = self._views[-1]
        if view.scan is features.measured:
            self._views[-1] = view._replace(twist=features.twist, noise_ratio=features.noise_ratio)

    def _add(self, update: OdometryUpdate) -> None:
        """Use a key frame of the odometry."""
        if self._key is None:
            self._insert(update, update.scan_pose, np.zeros((DOF, DOF)))
            self._shows_new.append(True)
        else:
            if update.starts_track:
                self._track, self._localizer, self._found = max(self._tracks) + 1, None, None
            step = self._key.scan_pose.inverse() @ update.scan_pose
            drift, most = self._step_covariances(self._key, update)
            self._relation, self._published = self._relation.then(step, drift), self._published.then(step, most)
            self._locate(update)
        self._key, self._gap = update, False
        self._seen[self._relation.frame] = self._way

    def _step_covariances(self, before: OdometryUpdate, update: OdometryUpdate
                          ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the covariances (3, 3) of the motion since the key frame before, in the frame of this one.

        The motion model limits what the registration leaves open, as along a corridor. By the first covariance the
        error of a scan moves the map that later ones are aligned with, by the second it adds to those of later scans.
        """
        if update.starts_track:
            return LOST, LOST
        gap, spread = np.diag(GAP_SPREAD) ** 2 * self._gap, np.diag(STEP_SPREAD) ** 2
        if update.registration is None:
            return spread + gap, spread + gap
        measured = update.registration.covariance
        modelled = displacement_covariance((update.stamp - before.stamp) / SECOND, self._parameters)
        share = modelled @ np.linalg.inv(measured + modelled)
        found, back = share @ measured, np.linalg.inv(np.eye(DOF) + (EVENED - 1.0) * share)
        return back @ found @ back.T + gap, found + spread + gap

    def _locate(self, update: OdometryUpdate) -> None:
        """Find the latest key frame among those of the map, or add it."""
        known = self.seen_again = self._again(update)
        chain = self._relation
        alike = difference(self._poses, self._in_map(known or chain).as_array(), update.features.measured) <= 1.0
        if known is None:
            # What was seen long ago and is not found now is elsewhere.
            alike &= self._way - np.array(self._seen) < AWAY
        shows_new = not (alike & self._comparable(update) & self._shows_new).any()
        is_new = shows_new or self._every
        if is_new:
            number = len(self._views)
            self._insert(update, self._in_map(chain), self._covariance_of(self._published))
            self._shows_new.append(shows_new)
            self._constrain(chain.frame, number, chain.motion, chain.covariance)
            self._relation = self._published = Relation(number, SE2(), np.zeros((DOF, DOF)))
            if known:
                self._constrain(known.frame, number, known.motion, known.covariance)
        elif known:
            by_chain = self._between(known.frame, chain.frame).then(chain.motion, chain.covariance)
            self._relation, self._published = mean_motion(by_chain, known), known
            turn = known.motion.adjoint()
            self._constrain(chain.frame, known.frame, chain.motion @ known.motion.inverse(),
                            turn @ (chain.covariance + known.covariance) @ turn.T)
        if known:
            self._unsettled = True
            if not self._every or len(self._views) >= GROWTH * self._settled:
                self._settle()

    def _again(self, update: OdometryUpdate) -> Relation | None:
        """Return the relation of a key frame to one of the map that was seen long before; None if there is none."""
        if self._track and (in_map := self._searched(update)):
            self._join(in_map)
            return in_map
        at, since = self._in_map(self._relation).as_array(), self._way - np.array(self._seen)
        apart, reach = np.hypot(*(self._poses - at)[:, :2].T), NEAR + DRIFT * since
        rank = difference(self._poses, at, update.features.measured)
        rank[(since < AWAY) | (apart > reach) | ~self._comparable(update)] = np.inf
        for early in np.argsort(rank, kind='stable')[:TRIED]:
            if not np.isfinite(rank[early]):
                break
            found = demoted_if_poor(register(self._views[early].features(self._parameters), update.features,
                                             self._parameters), self._parameters.decision)
            off = SE2.from_array(at).inverse() @ SE2.from_array(self._poses[early]) @ found.transform
            is_near = np.hypot(off.x, off.y) <= reach[early] and abs(off.theta) <= TURNED
            if found.status is Status.OK and is_near and (found.weakest_information or np.inf) >= LEAST_POINTS:
                return Relation(int(early), found.transform, found.covariance + np.diag(LOOP_SPREAD) ** 2)
        return None

    def _comparable(self, update: OdometryUpdate) -> NDArray[np.bool_]:
        """Return which key frames (K,) are of the sensor of an update, and of the track of the robot."""
        return np.array([name == update.sensor.name and track == self._track
                         for name, track in zip(self._sensors, self._tracks, strict=True)])

    def _search(self, update: OdometryUpdate) -> None:
        """Search for the robot in the map so far."""
        if self._localizer is None:
            self._localizer = Localizer(self.map(), self._parameters)
        self._found = self._localizer.process(update)

    def _searched(self, update: OdometryUpdate) -> Relation | None:
        """Return the relation of a key frame to the nearest of the map, once the search has found the robot."""
        found = self._found
        if not found or found.state is not State.LOCALISED or found.transform is None or found.covariance is None:
            return None
        at = found.transform @ update.scan_pose
        apart = np.hypot(*(self._poses - at.as_array())[:, :2].T)
        nearest = int(np.where(self._tracks, np.inf, apart).argmin())
        return Relation(nearest, SE2.from_array(self._poses[nearest]).inverse() @ at,
                         turned(found.covariance, -at.theta))

    def _join(self, found: Relation) -> None:
        """Move the key frames since the loss to where the robot was found in the map."""
        since = np.array(self._tracks) == self._track
        move = self._in_map(found) @ self._in_map(self._relation).inverse()
        self._poses[since] = compose(move.as_array()[None], self._poses[since])
        covariance = self._covariance_of(found)
        for number in np.flatnonzero(since):
            self._tracks[number], self._covariances[number] = 0, covariance
        self._track, self._localizer = 0, None

    def _insert(self, update: OdometryUpdate, pose: SE2, covariance: NDArray[np.float64]) -> None:
        """Add a key frame to the map at this `pose`."""
        features = update.features
        self._views.append(View(len(self._views), features.measured, features.twist, features.noise_ratio))
        self.numbers.append(update.number)
        self._sensors.append(update.sensor.name)
        self._tracks.append(self._track)
        self._poses = np.vstack((self._poses, pose.as_array()))
        self._covariances.append(covariance)
        self._seen.append(self._way)

    def _constrain(self, first: int, second: int, motion: SE2, covariance: NDArray[np.float64]) -> None:
        """Add a constraint between two key frames; if there is one, take the mean of both."""
        if first == second:
            return
        if (second, first) in self._constraints:
            turn = motion.adjoint()
            first, second, motion, covariance = second, first, motion.inverse(), turn @ covariance @ turn.T
        if (first, second) in self._constraints:
            before, of_before = self._constraints[first, second]
            _, motion, covariance = mean_motion(Relation(first, SE2.from_array(before), of_before),
                                                Relation(first, motion, covariance))
        self._constraints[first, second] = motion.as_array(), covariance

    def _in_map(self, relation: Relation) -> SE2:
        """Return the pose of the sensor of a relation in the map."""
        return SE2.from_array(self._poses[relation.frame]) @ relation.motion

    def _between(self, first: int, second: int) -> Relation:
        """Return the relation of one key frame to another, by all constraints."""
        covariance = relative_covariance(PoseGraph(self._poses, self._all_constraints()), first, second)
        motion = SE2.from_array(self._poses[first]).inverse() @ SE2.from_array(self._poses[second])
        return Relation(first, motion, covariance)

    def _covariance_of(self, relation: Relation) -> NDArray[np.float64]:
        """Return the covariance of the pose of the sensor of a relation, for (x, y, theta) in the map."""
        at, pose = self._poses[relation.frame], self._in_map(relation)
        lever = lever_arm(pose.x - at[0], pose.y - at[1])
        found: NDArray[np.float64] = (lever @ self._covariances[relation.frame] @ lever.T
                                      + turned(relation.covariance, pose.theta))
        return found

    def _report(self, update: OdometryUpdate) -> Localization:
        """Return what is known at the pose of an update."""
        if not self._views:
            return Localization(State.SEARCHING, None, None, None, [], 1.0)
        assert self._key
        number, odometry = self.anchor
        transform = SE2.from_array(self._poses[number]) @ odometry
        pose, covariance = transform @ update.pose, LOST
        if not self._track:
            since = motion_covariance(self._key.pose, self._key.covariance, update)
            covariance = self._covariance_of(self._published.then(self._key.scan_pose.inverse() @ update.pose,
                                                                  turned(since, -update.pose.theta)))
        state = State.SEARCHING if self._track else State.LOCALISED
        return Localization(state, transform, pose, covariance, [(pose, 1.0)], 0.0)


def mean_motion(first: Relation, second: Relation) -> Relation:
    """Return the mean of two independent measurements of one motion, weighted by their information."""
    gain = first.covariance @ np.linalg.inv(first.covariance + second.covariance)
    off = (first.motion.inverse() @ second.motion).as_array()
    left = first.covariance - gain @ first.covariance
    return first._replace(motion=first.motion @ SE2.from_array(gain @ off), covariance=0.5 * (left + left.T))
