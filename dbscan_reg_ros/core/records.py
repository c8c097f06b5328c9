# SPDX-License-Identifier: Apache-2.0
"""The records that flow through the registration, each made by one step and read by the next."""
import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from functools import cached_property

import numpy as np

from .parameters import DensityParameters
from .range_noise import USUAL_NOISE
from .scan import Scan
from .se2 import SE2, wrap
from .surface import Cloud, build_cloud, build_surface, build_view, leverage


class Status(Enum):
    """What a registration is worth."""

    OK = 'ok'
    """The motion is known in every direction."""
    DEGENERATE = 'degenerate'
    """The scans agree, but one direction of the motion is not determined by them."""
    AMBIGUOUS = 'ambiguous'
    """A rival motion explains the scans nearly as well."""
    FAILED = 'failed'
    """No motion explains the scans."""


class EndKind(IntEnum):
    """What ends a segment."""

    CORNER = 0
    """Another segment starts there: a true point of the world."""
    FREE = 1
    """The wall ends there and the beams beyond it see farther: a true point of the world."""
    OCCLUSION = 2
    """Something nearer hides the rest, or the view ends: the point moves with the sensor."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Line segments of one scan as a structure of arrays, in beam order, M of them.

    Attributes
    ----------
    start, end : (M, 2) float [m]
        End points on the fitted line, counter-clockwise as the sensor sees them, so that a segment is directed and the
        sensor always lies on its left.
    direction : (M,) float [rad]
        Angle of the line from start to end, in [-pi, pi).
    length : (M,) float [m]
    sigma_direction : (M,) float [rad]
        Standard deviation of the direction.
    sigma_offset : (M,) float [m]
        Standard deviation of the line's distance from its midpoint.
    kinds : (M, 2) int
        `EndKind` of start and end.
    beams : (M, 2) int
        Beams at start and end.
    """

    start: np.ndarray
    end: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    sigma_direction: np.ndarray
    sigma_offset: np.ndarray
    kinds: np.ndarray
    beams: np.ndarray

    def __len__(self):
        return len(self.direction)

    @property
    def midpoint(self):
        """(M, 2) [m]"""
        return 0.5 * (self.start + self.end)

    def reversed(self):
        """The same, each from its end to its start."""
        return dataclasses.replace(self, start=self.end, end=self.start, direction=wrap(self.direction + math.pi),
                                   kinds=self.kinds[:, ::-1], beams=self.beams[:, ::-1])


@dataclass(frozen=True, eq=False)
class Features:
    """What is kept of a scan, computed once.

    Attributes
    ----------
    scan : Scan
    points : (P, 2) float [m]
        Filtered points in the sensor's frame, in beam order.
    beams : (P,) int
        The beam of each point.
    normals : (P, 2) float
        Unit normals that face the sensor; zero where the surroundings have no direction.
    segments : Segments
    noise : float [m]
        Standard deviation of a range, as estimated from what the filter left of this scan.
    noise_share : float
        The same as a share of the range, where far ranges are noisier than near ones.
    posts : Cloud or None
        What small things without normals count as, from `posts.with_posts`.
    walls : Cloud
        The points that have a normal.
    dense_cloud : Cloud
        `walls`, and then the `posts`.
    cloud : Cloud
        Some of them, evenly along the scan: those that hypotheses are compared by.
    leverage : (P,) float
        Weight of each point of `cloud` in a comparison.
    surface : Surface
        The density of this scan as a reference; made when first asked for, like `view`.
    view : View
        How far this scan saw.
    worth : (P',) float or None
        What each point of `dense_cloud` counts, from 0 to 1; None: all the same.
    around : Cloud or None
        Points of other scans that belong to `surface` as well.
    """

    scan: Scan
    points: np.ndarray
    beams: np.ndarray
    normals: np.ndarray
    segments: Segments
    noise: float
    density: DensityParameters
    noise_share: float = 0.0
    posts: Cloud | None = None
    worth: np.ndarray | None = None
    around: Cloud | None = None

    def without(self, left_out):
        """The same, without the normals of those points of `dense_cloud` that `left_out`, a mask, picks; posts go as a whole."""
        walls, normals = len(self.walls), self.normals.copy()
        normals[np.flatnonzero(normals.any(axis=1))[left_out[:walls]]] = 0.0
        posts = self.posts and self.posts.select(~np.isin(self.posts.beams, self.posts.beams[left_out[walls:]]))
        return dataclasses.replace(self, normals=normals, posts=posts)

    def doubting(self, points, worth):
        """The same, but those points of `dense_cloud` that `points`, a mask or indices, picks count `worth`."""
        each = self.dense_cloud.weighed(np.ones(len(self.dense_cloud)))
        each[points] *= worth
        return dataclasses.replace(self, worth=each)

    @cached_property
    def walls(self):
        return build_cloud(self.points, self.normals, self.beams)

    @cached_property
    def dense_cloud(self):
        cloud = self.walls.joined(self.posts) if self.posts else self.walls
        # Errors of points that are noisier than usual are measured in units of their noise.
        times = self.noise_share / USUAL_NOISE * np.abs(cloud.points)
        sharpness = 1.0 / np.maximum(times, 1.0) if (times > 1.0).any() else None
        worth = cloud.worth if self.worth is None else self.worth
        return dataclasses.replace(cloud, worth=worth, sharpness=sharpness)

    @cached_property
    def cloud(self):
        return self.dense_cloud.thinned(self.density.points)

    @cached_property
    def leverage(self):
        return leverage(self.cloud, self.density.balance)

    @cached_property
    def surface(self):
        return build_surface(self.dense_cloud.joined(self.around) if self.around else self.dense_cloud, self.density)

    @cached_property
    def view(self):
        return build_view(self.points, self.scan.geometry.angle_increment)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One candidate motion and its score."""

    transform: SE2
    score: float


def no_matches():
    """Where nothing was found."""
    return np.empty((0, 2), dtype=int)


@dataclass(frozen=True, eq=False)
class Registration:
    """Result of registering one scan onto another.

    Attributes
    ----------
    transform : SE2
        Pose of the current sensor in the reference's frame: ``p_R = transform.apply(p_O)`` (Eq. 8).
    covariance : (3, 3) float
        Covariance of (x, y, theta) in the *current* sensor's frame (a right perturbation), m, m, rad.
    status : Status
    overlap : float
        Share of the current scan's points that lie on the reference's surfaces, 0..1.
    score : float
        The winning hypothesis' score, 0..1; of a winner that was compared with nobody that of the coarse refinement, and so
        the overlap.
    hypotheses : tuple of Hypothesis
        Best first; the first is the result. None where it was compared with nothing.
    free_direction : float or None
        Angle [rad] in the reference's frame along which the scans leave the translation free.
    find_matches : callable
        Makes `matches`.
    matches : (K, 2) int
        Matched segments: index into the reference's and the current scan's; found when first asked for.
    reason : str
        Why the status is not ``OK``; empty otherwise.
    weakest : float or None
        So many points hold the translation along the direction in which it is known least; None where nobody counted.
    free_turn : bool
        The scans leave the rotation free.
    """

    transform: SE2
    covariance: np.ndarray
    status: Status
    overlap: float = 0.0
    score: float = 0.0
    hypotheses: tuple = ()
    free_direction: float | None = None
    find_matches: Callable = no_matches
    reason: str = ''
    weakest: float | None = None
    free_turn: bool = False

    @cached_property
    def matches(self):
        return self.find_matches()


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed of the motion before the scans are looked at.

    Attributes
    ----------
    transform : SE2
        Pose of the current sensor in the reference's frame.
    covariance : (3, 3) float
        As in `Registration`; positive definite.
    change : (3, 3) float or None
        Of a motion that goes on as before: the part of the covariance that is a change of the velocity, and lasts. None: the
        motion is known from elsewhere.
    """

    transform: SE2
    covariance: np.ndarray
    change: np.ndarray | None = None

    @property
    def spread(self):
        """Standard deviation [m] of the translation in the direction of which least is known."""
        (xx, xy, _), (_, yy, _), _ = self.covariance.tolist()
        return math.sqrt(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))

    @property
    def angular_spread(self):
        """Standard deviation [rad] of the rotation."""
        return math.sqrt(self.covariance.item(2, 2))

    def with_turn(self, turn, spread) -> 'Prior':
        """The same way, but with a `turn` [rad] known to `spread` [rad]; its chord turns by half the difference."""
        chord = SE2(0.0, 0.0, 0.5 * wrap(turn - self.transform.theta)) @ SE2(self.transform.x, self.transform.y)
        way = np.diag((1.0, 1.0, 0.0))
        return Prior(SE2(chord.x, chord.y, wrap(turn)), way @ self.covariance @ way + np.diag((0.0, 0.0, spread * spread)),
                     None if self.change is None else way @ self.change @ way)


@dataclass(frozen=True, eq=False)
class OdometryUpdate:
    """What `Odometry.process` says of one scan.

    Attributes
    ----------
    stamp : int
        The scan's own stamp [ns].
    pose : SE2
        Pose of the sensor in the odometry frame (that of the first scan).
    covariance : (3, 3) float
        Of `pose`, for (x, y, theta) in the odometry frame, m, m, rad.
    twist : (3,) float
        Velocity (vx, vy, omega) in the sensor's frame, m/s, m/s, rad/s.
    twist_covariance : (3, 3) float
    interval : float
        The cleaned time since the last scan [s]; 0 for the first.
    increment : SE2
        Motion since the last scan, in the last scan's frame.
    status : Status
    registration : Registration or None
        None for the first scan after a start or a reset.
    features : Features
        Of this scan.
    reference : Features or None
        What it was registered to.
    reference_pose : SE2
        Pose of `reference` in the odometry frame.
    reference_changed : bool
        This scan becomes the reference (or part of it) for those that follow.
    restarted : str
        Why tracking restarted at this scan, without a `registration`; with one, what is wrong with its stamp; else empty.
    told_error : (3, 3) float
        What is known to be wrong with told motions: one told as m [m, m, rad] was m + `told_error` @ m, in the sensor's frame. 0
        as long as nothing is known.
    number : int
        How many scans this `Odometry` used before this one, resets included.
    reference_number : int or None
        `number` of the scan of `reference`, whose features may have been made anew since.
    """

    stamp: int
    pose: SE2
    covariance: np.ndarray
    twist: np.ndarray
    twist_covariance: np.ndarray
    interval: float
    increment: SE2
    status: Status
    registration: Registration | None
    features: Features
    reference: Features | None
    reference_pose: SE2
    reference_changed: bool
    restarted: str = ''
    told_error: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    number: int = 0
    reference_number: int | None = None
