# SPDX-License-Identifier: Apache-2.0
"""Maps with the true pose of their frame, and drives that start somewhere in them or elsewhere."""
import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from time import process_time

import numpy as np

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.evaluation.metrics import align, path_lengths
from dbscan_reg_ros.places.localizer import Localizer, State
from dbscan_reg_ros.places.map import Map
from dbscan_reg_ros.places.mapper import Mapper
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.simulation import follow, simulate, with_people

from .floors import floor, moved, route

PARAMETERS = Parameters()
RIGHT = 0.3, math.radians(3.0)
"""Largest errors [m, rad] of a pose that is right."""
NEAR = 1.0, math.radians(15.0)
"""Largest errors [m, rad] of a candidate from which the alignment finds the pose."""
COVERED = 2.0
"""A start and its drive stay within this distance [m] of the views of the map."""


AROUND = 10.0
"""A true pose is aligned with the map by the key frames within this distance [m]: an error of the whole map is none of
the localiser."""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A map of a drive, and the true poses ``truth`` (K, 3) of its key frames."""

    known: Map
    truth: np.ndarray

    @classmethod
    def of(cls, scans, truth) -> 'Mapped':
        """Drive through the `scans`, close the loops, and align the key frames with the `truth`."""
        odometry, mapper = Odometry(PARAMETERS), Mapper(PARAMETERS)
        for scan in scans:
            mapper.process(odometry.process(scan))
        return cls(mapper.map(), truth[mapper.numbers])

    def true_poses(self, truth):
        """Return true poses (N, 3) in the frame of the map around them."""
        poses, found = self.known.graph.poses, []
        for pose in truth:
            away = np.hypot(*(self.truth - pose)[:, :2].T)
            near = away <= max(AROUND, np.sort(away)[min(2, len(away) - 1)])
            aligned = align(self.truth[near], poses[near])[:1]
            found.append(compose(aligned, relative(self.truth[near][:1], pose[None]))[0])
        return np.array(found)

    @property
    def error(self) -> float:
        """Mean error [m] of the key frames, aligned as a whole."""
        return float(np.hypot(*(align(self.known.graph.poses, self.truth) - self.truth)[:, :2].T).mean())

    def distance(self, truth):
        """Return how far (N,) [m] the true poses are from the nearest view."""
        return _nearest(self.true_poses(truth), self.known.poses)

    def without(self, truth, radius=8.0) -> 'Mapped':
        """Return the map without the views within `radius` [m] of the true poses (N, 3)."""
        near = _nearest(self.known.poses, self.true_poses(truth))
        views = [view for view, distance in zip(self.known.views, near, strict=True) if distance > radius]
        return dataclasses.replace(self, known=dataclasses.replace(self.known, views=views))

    @cached_property
    def localizer(self) -> Localizer:
        """A localiser of the map, for one start after the other."""
        return Localizer(self.known, PARAMETERS)


def _nearest(poses, others):
    """Return the distance (N,) [m] of each of the `poses` (N, 3) from the nearest of the `others` (M, 3)."""
    return np.array([np.hypot(*(others - pose)[:, :2].T).min() for pose in poses])


@dataclass(frozen=True, eq=False)
class Outcome:
    """A start that was followed.

    Attributes
    ----------
    states : list of State
        After each scan.
    way : (N,) float [m]
        Distance driven at each scan.
    errors : (N, 2) float [m, rad]
        Of the pose in the map, NaN where the robot is not localised; infinite if it is not in the map.
    sigmas : (N,) float [m]
        Standard deviation of the position.
    among_ten : bool
        Whether the true pose is among the candidates of the first scan; False if it is not in the map.
    milliseconds : float
        Largest processor time of the localiser for a scan [ms].
    """

    states: list
    way: np.ndarray
    errors: np.ndarray
    sigmas: np.ndarray
    among_ten: bool = False
    milliseconds: float = 0.0

    @property
    def localised(self):
        """Numbers of the scans after which the robot was localised."""
        return np.flatnonzero([state is State.LOCALISED for state in self.states])

    def wrong(self) -> bool:
        """Whether it was ever localised at a wrong pose."""
        errors = self.errors[self.localised]
        return bool((errors > RIGHT).any())

    def metres(self) -> float:
        """Return how far it had driven when it was localised first; infinite if never."""
        return float(self.way[self.localised[0]]) if len(self.localised) else math.inf


def followed(localizer, scans, truth, metres) -> Outcome:
    """Search for the drive of the `scans` in a map, for so many metres; `truth` (N, 3) in its frame, or None."""
    odometry = Odometry(PARAMETERS)
    localizer.reset()
    states, poses, errors, sigmas, times, among_ten = [], [], [], [], [], False
    for number, scan in enumerate(scans):
        try:
            update = odometry.process(scan)
        except ScanError:
            continue
        poses.append(update.pose.as_array())
        if number % 10 == 0 and path_lengths(np.array(poses))[-1] > metres:
            poses.pop()
            break
        if truth is not None and not states:
            near = localizer.candidates(update.features)
            off = relative(np.repeat(truth[number:number + 1], len(near), axis=0), near)
            among_ten = bool(((np.hypot(*off[:, :2].T) < NEAR[0]) & (np.abs(off[:, 2]) < NEAR[1])).any())
        begin = process_time()
        found = localizer.process(update)
        times.append(process_time() - begin)
        states.append(found.state)
        off = np.full(3, np.nan if found.pose is None else np.inf)
        if found.pose is not None and truth is not None:
            off = relative(truth[number:number + 1], found.pose.as_array()[None])[0]
        errors.append((math.hypot(*off[:2]), abs(off[2])))
        sigmas.append(math.sqrt(max(np.diag(found.covariance)[:2])) if found.pose else math.inf)
    return Outcome(states, path_lengths(np.array(poses)), np.array(errors), np.array(sigmas), among_ten,
                   1e3 * max(times))


def first_answer(localizer, scans):
    """Return the number of the scan at which a start is localised, and its pose (3,) in the map; None for never."""
    odometry = Odometry(PARAMETERS)
    localizer.reset()
    for number, scan in enumerate(scans):
        found = localizer.process(odometry.process(scan))
        if found.state is State.LOCALISED:
            return number, found.pose.as_array()
    return number, None


def floor_map(seed, lidar, alike=False) -> Mapped:
    """Return the map of one drive along the tour of a floor; `alike` is that of `floor`."""
    world = floor(seed, alike=alike)
    drive = simulate(world, follow(world.tour, speed=1.2, turn_rate=1.2, radius=0.3), lidar, seed=seed)
    return Mapped.of(drive.scans, drive.truth)


def floor_drive(seed, lidar, number, metres, changed=False, alike=False):
    """Return scans and true poses of a start on a floor; `changed`: furniture was moved, and there are people."""
    world = floor(seed, alike=alike)
    way = route(world, 1000 * seed + number, metres + 3.0)
    if changed:
        world = with_people(moved(world, 0.2, number), 10, number)
    drive = simulate(world, follow(way, speed=0.8, turn_rate=0.9), lidar, seed=number)
    return drive.scans, drive.truth


def kidnapped(scans, truth, others, others_truth):
    """Join two drives: the robot is carried to the start of the second within the time of a scan."""
    step = scans[1].stamp - scans[0].stamp
    later = scans[-1].stamp + step - others[0].stamp
    return ([*scans, *(dataclasses.replace(scan, stamp=scan.stamp + later) for scan in others)],
            np.vstack((truth, others_truth)))
