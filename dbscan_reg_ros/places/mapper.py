# SPDX-License-Identifier: Apache-2.0
"""A map that is built while the robot drives: places that are new are added, places seen before close loops."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.features.records import Features
from ..core.geometry.se2 import DOF, SE2, lever_arm, turned
from ..core.odometry.records import OdometryUpdate
from ..core.parameters.tree import Parameters
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..core.registration.status import demoted_if_poor
from .key_frames import AWAY, DRIFT, NEAR, STEP_SPREAD, TRIED, TURNED
from .localizer import LOST, Localization, Localizer, State
from .map import Map, View, shows_the_same
from .pose_graph import Constraints, PoseGraph, optimise


class _Relation(NamedTuple):
    """A key frame of the map, and the pose of a sensor in it.

    `covariance` (3, 3) is that of `motion`, in the frame of the sensor.
    """

    frame: int
    motion: SE2
    covariance: NDArray[np.float64]

    def then(self, step: SE2, covariance: NDArray[np.float64]) -> '_Relation':
        """Return the relation to the sensor after a further step, whose `covariance` is in the frame at its end."""
        back = step.inverse().adjoint()
        return _Relation(self.frame, self.motion @ step, back @ self.covariance @ back.T + covariance)


class Mapper:
    """Builds a map while the robot drives, and closes its loops.

    A key frame of the odometry becomes one of the map only where none of the map shows the same, so that the map of a
    building stops growing once all of it was seen. A key frame that is registered to an old one of the map, over
    `AWAY` of driving or more, adds a constraint, and all poses are optimised. After a loss the robot is searched for in
    the map so far by the `Localizer`; nothing is added until it is found.

    All of this is computed in `process`, which takes some milliseconds for a key frame and up to seconds after a loss:
    a caller that must not wait calls it in another thread. Only one thread may use a mapper.

    Parameters
    ----------
    parameters : Parameters
        Those of the odometry.
    """

    def __init__(self, parameters: Parameters = Parameters()) -> None:
        self._parameters = parameters
        self.reset()

    def reset(self) -> None:
        """Begin a new map, whose frame is that of the odometry at the next scan."""
        self._views: list[View] = []
        self._sensors: list[str] = []
        self._poses = np.empty((0, DOF))
        self._covariances: list[NDArray[np.float64]] = []
        self._constraints: dict[tuple[int, int], tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        # Of each key frame: the way driven until it was seen last.
        self._seen: list[float] = []
        self._way, self._last = 0.0, SE2()
        # The latest key frame of the odometry: in the map, in the odometry frame, and its number.
        self._relation, self._place, self._number = _Relation(0, SE2(), np.zeros((DOF, DOF))), SE2(), -1
        self._odometry_covariance = np.zeros((DOF, DOF))
        self._lost = False
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
        if update.reference is not None and update.reference_number == self._number:
            self._refine(update.reference)
        if self._lost and not update.starts_track:
            self._search(update)
        if update.reference_changed:
            self._add(update)
        return self._report(update)

    @property
    def graph(self) -> PoseGraph:
        """The poses of the key frames, and all constraints between them."""
        pairs = np.array(list(self._constraints), dtype=np.int64).reshape(-1, 2)
        motions = np.array([motion for motion, _ in self._constraints.values()]).reshape(-1, DOF)
        covariances = np.array([covariance for _, covariance in self._constraints.values()]).reshape(-1, DOF, DOF)
        return PoseGraph(self._poses, Constraints(pairs, motions, covariances))

    @property
    def anchor(self) -> tuple[int, SE2]:
        """A key frame near the robot, and the pose of the odometry frame in it, by the latest key frame.

        With the `graph` of the whole drive they give its final poses: ``graph.poses[number] @ pose @ update.pose``.
        """
        return self._relation.frame, self._relation.motion @ self._place.inverse()

    def map(self, mounting: SE2 = SE2()) -> Map:
        """Return the map so far; it does not change when the mapper goes on. `mounting` is that of the `Map`."""
        return Map(self.graph, list(self._views), mounting)

    def _refine(self, features: Features) -> None:
        """Take over how the latest key frame is deskewed, if it is of the map."""
        view = self._views[-1]
        if view.scan is features.measured:
            self._views[-1] = view._replace(twist=features.twist, noise_ratio=features.noise_ratio)

    def _add(self, update: OdometryUpdate) -> None:
        """Use a key frame of the odometry."""
        place = update.scan_pose
        if not self._views:
            self._lost = False
            self._insert(update, place, np.zeros((DOF, DOF)))
            self._relation = _Relation(0, SE2(), np.zeros((DOF, DOF)))
        else:
            if update.starts_track:
                self._lost, self._localizer, self._found = True, None, None
            self._relation = self._relation.then(self._place.inverse() @ place, _step_covariance(update))
            self._place = place
            self._locate(update)
        self._place, self._number = place, update.number
        self._odometry_covariance = update.covariance
        self._seen[self._relation.frame] = self._way

    def _locate(self, update: OdometryUpdate) -> None:
        """Find the latest key frame among those of the map, or add it."""
        known = self._again(update)
        if self._lost:
            if known is None:
                return
            # Nothing is known of the motion since the loss.
            self._lost, self._localizer, self._relation = False, None, known
        chain, before = self._relation, len(self._constraints)
        alike = shows_the_same(self._poses, self._in_map(known or chain).as_array(), update.features.measured)
        alike &= np.array([name == update.sensor.name for name in self._sensors])
        is_new = not alike.any()
        if is_new:
            number = len(self._views)
            self._insert(update, self._in_map(chain), self._covariance_of(chain))
            self._constrain(chain.frame, number, chain.motion, chain.covariance)
            self._relation = _Relation(number, SE2(), np.zeros((DOF, DOF)))
            if known:
                self._constrain(known.frame, number, known.motion, known.covariance)
        elif known:
            turn = known.motion.adjoint()
            self._constrain(chain.frame, known.frame, chain.motion @ known.motion.inverse(),
                            turn @ (chain.covariance + known.covariance) @ turn.T)
        if known and len(self._constraints) > before:
            self._poses = optimise(self._poses, self.graph.constraints)
        if known and not is_new:
            self._relation = self._weighed(known, chain)

    def _weighed(self, known: _Relation, chain: _Relation) -> _Relation:
        """Return the relation `known` with the mean of its motion and of that by the `chain` of motions.

        The covariance stays that of `known`, as the errors of both depend on each other.
        """
        by_chain, heading = self._in_frame(known.frame, chain), self._in_map(known).theta
        of_chain, of_known = (turned(self._covariance_of(each), -heading) for each in (chain, known))
        off = (by_chain.inverse() @ known.motion).as_array()
        moved = SE2.from_array(of_chain @ np.linalg.solve(of_chain + of_known, off))
        return known._replace(motion=by_chain @ moved)

    def _again(self, update: OdometryUpdate) -> _Relation | None:
        """Return the relation of a key frame to one of the map that was seen long before; None if there is none."""
        if self._lost:
            return self._searched(update)
        at, since = self._in_map(self._relation).as_array(), self._way - np.array(self._seen)
        apart, reach = np.hypot(*(self._poses - at)[:, :2].T), NEAR + DRIFT * since
        other = np.array([name != update.sensor.name for name in self._sensors])
        apart[(since < AWAY) | (apart > reach) | other] = np.inf
        for early in np.argsort(apart, kind='stable')[:TRIED]:
            if not np.isfinite(apart[early]):
                break
            found = demoted_if_poor(register(self._views[early].features(self._parameters), update.features,
                                             self._parameters), self._parameters.decision)
            off = SE2.from_array(at).inverse() @ SE2.from_array(self._poses[early]) @ found.transform
            if found.status is Status.OK and np.hypot(off.x, off.y) <= reach[early] and abs(off.theta) <= TURNED:
                return _Relation(int(early), found.transform, found.covariance + np.diag(STEP_SPREAD) ** 2)
        return None

    def _search(self, update: OdometryUpdate) -> None:
        """Search for the robot in the map so far."""
        if self._localizer is None:
            self._localizer = Localizer(self.map(), self._parameters)
        self._found = self._localizer.process(update)

    def _searched(self, update: OdometryUpdate) -> _Relation | None:
        """Return the relation of a key frame to the nearest of the map, once the search has found the robot."""
        found = self._found
        if not found or found.state is not State.LOCALISED or found.transform is None or found.covariance is None:
            return None
        at = found.transform @ update.scan_pose
        nearest = int(np.hypot(*(self._poses - at.as_array())[:, :2].T).argmin())
        return _Relation(nearest, SE2.from_array(self._poses[nearest]).inverse() @ at,
                         turned(found.covariance, -at.theta))

    def _insert(self, update: OdometryUpdate, pose: SE2, covariance: NDArray[np.float64]) -> None:
        """Add a key frame to the map at this `pose`."""
        features = update.features
        self._views.append(View(len(self._views), features.measured, features.twist, features.noise_ratio))
        self._sensors.append(update.sensor.name)
        self._poses = np.vstack((self._poses, pose.as_array()))
        self._covariances.append(covariance)
        self._seen.append(self._way)

    def _constrain(self, first: int, second: int, motion: SE2, covariance: NDArray[np.float64]) -> None:
        """Add a constraint between two key frames, unless there is one."""
        if first != second and not {(first, second), (second, first)} & self._constraints.keys():
            self._constraints[first, second] = motion.as_array(), covariance

    def _in_map(self, relation: _Relation) -> SE2:
        """Return the pose of the sensor of a relation in the map."""
        return SE2.from_array(self._poses[relation.frame]) @ relation.motion

    def _in_frame(self, frame: int, relation: _Relation) -> SE2:
        """Return the pose of the sensor of a relation in a key frame."""
        return SE2.from_array(self._poses[frame]).inverse() @ self._in_map(relation)

    def _covariance_of(self, relation: _Relation) -> NDArray[np.float64]:
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
        number, odometry = self.anchor
        transform = SE2.from_array(self._poses[number]) @ odometry
        pose, covariance = transform @ update.pose, LOST
        if not self._lost:
            covariance = self._covariance_of(self._relation)
            if update.status is Status.FAILED:
                covariance = covariance + turned(update.covariance - self._odometry_covariance, transform.theta)
        state = State.SEARCHING if self._lost else State.LOCALISED
        return Localization(state, transform, pose, covariance, [(pose, 1.0)], 0.0)


def _step_covariance(update: OdometryUpdate) -> NDArray[np.float64]:
    """Return the covariance (3, 3) of the motion since the last key frame, in the frame of this one."""
    spread = np.diag(STEP_SPREAD) ** 2
    return spread if update.registration is None else update.registration.covariance + spread
