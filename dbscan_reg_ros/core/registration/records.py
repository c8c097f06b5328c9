# SPDX-License-Identifier: Apache-2.0
"""Records of a registration: status, hypotheses, evidence, prior, result."""
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..errors import expect
from ..geometry.array_types import FloatArray, IntArray
from ..geometry.se2 import SE2, turned, wrap
from ..geometry.symmetric_matrix import as_covariance


class Status(Enum):
    """Status of a registration."""

    OK = 'ok'
    """The motion is known in every direction. The method of the paper, which has no check, sets it as well; then the
    registration is not `judged`."""
    DEGENERATE = 'degenerate'
    """The scans agree, but the translation along one direction, or the rotation, is unobservable."""
    AMBIGUOUS = 'ambiguous'
    """The motion may be another one: a rival is nearly as likely, the score is low, or in the odometry the pose was
    corrected or follows scans that were not found in the map."""
    FAILED = 'failed'
    """No motion aligns the scans; in the odometry also: the motion is impossibly fast, or a new track starts."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One candidate motion, its score, and its log-odds computed from the evidence."""

    transform: SE2
    score: float
    log_odds: float = -math.inf


UNKNOWN_HEADING = 0.5 * math.pi
"""A heading with a larger standard deviation [rad] is unknown."""


def sigma_text(covariance: FloatArray, frame: str) -> str:
    """Return the standard deviations of a covariance ``(3, 3)`` of (x, y, theta), and its frame, as a text."""
    x, y, theta = np.sqrt(np.diag(covariance))
    return f'sigma {x:.2g} m, {y:.2g} m, {math.degrees(theta):.2g} deg in {frame}'


def no_matches() -> IntArray:
    """Return an empty array of segment pairs, ``(0, 2)``."""
    return np.empty((0, 2), dtype=int)


class Evidence(NamedTuple):
    """Evidence for and against a motion.

    Attributes
    ----------
    conflicts_current, conflicts_reference : float
        Fraction, 0..1, of the current scan's points in free space of the reference, and of the reference's points in
        free space of the current scan.
    on_outline : int
        Number of points of the reference on the outline of the current scan.
    matched_ends : int
        Number of segment ends (corners and free ends) of each scan that have a counterpart in the other scan.
    unmatched_ends : int
        Number of segment ends (corners and free ends) without a counterpart in the other scan, which should see them.
    crossing : float [m]
        Length of matched segments perpendicular to the main direction of all matched segments.
    residual : float [m]
        Root mean square of the errors of the current scan's points on the reference's surfaces.
    distance : float [m]
        Length of the translation.
    weak : float
        Effective number of points that constrain the translation in its least constrained direction.
    chance : float
        Fraction of points in free space to be expected by chance, 0..1: the square of the fraction of isolated points.
    """

    conflicts_current: float
    conflicts_reference: float
    on_outline: int
    matched_ends: int
    unmatched_ends: int
    crossing: float
    residual: float
    distance: float
    weak: float
    chance: float = 0.0


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
        Fraction of the current scan's points that lie on the reference's surfaces, 0..1.
    score : float
        Score of the result, at most 1; by the method of the paper ``exp(-D)`` for the divergence D. If only one top
        candidate remained, score and overlap are those after the coarse refinement.
    hypotheses : tuple of Hypothesis
        Best first; the first is the result. Empty if nothing was found.
    degenerate_direction : float or None
        Angle [rad] in the reference's frame along which the translation is unobservable.
    find_matches : callable
        Function that computes `matches`.
    reason : str
        Why the status is not ``OK``; empty otherwise.
    weakest_information : float or None
        Effective number of points that constrain the translation in its least constrained direction; None if not
        computed.
    rotation_unobservable : bool
        Whether the scans do not constrain the rotation.
    confidence : float
        Probability that the transform is right, within 0.1 m and 2 deg, 0..1. It is computed from the `evidence`, and
        0 without any.
    evidence : Evidence or None
        What the confidence is computed from; None if nothing was found, and by the method of the paper.
    rivals : tuple of Hypothesis
        Those `hypotheses` whose motion differs from that of the result, best first.
    agreement : (float, float)
        Effective number of points that constrain the translation in its least constrained direction: by their normals
        in both scans, and by those in either scan. Points whose normals disagree count as well, against the first.
    """

    transform: SE2
    covariance: FloatArray
    status: Status
    overlap: float = 0.0
    score: float = 0.0
    hypotheses: tuple[Hypothesis, ...] = ()
    degenerate_direction: float | None = None
    find_matches: Callable[[], IntArray] = no_matches
    reason: str = ''
    weakest_information: float | None = None
    rotation_unobservable: bool = False
    confidence: float = 0.0
    evidence: Evidence | None = None
    rivals: tuple[Hypothesis, ...] = ()
    agreement: tuple[float, float] = (0.0, 0.0)

    def __repr__(self) -> str:
        """Return one line."""
        reason = f': {self.reason}' if self.reason else ''
        confidence = f'confidence {self.confidence:.2f}' if self.judged else 'not judged'
        sigma = sigma_text(self.covariance_in_reference, 'the reference')
        return (f'Registration({self.transform.brief()}, {sigma}, score {self.score:.3f}, overlap {self.overlap:.3f}, '
                f'{confidence}, {len(self.hypotheses)} hypotheses, {self.status.name}{reason})')

    @property
    def judged(self) -> bool:
        """Whether the result was checked; the method of the paper has no check."""
        return self.status is not Status.OK or self.weakest_information is not None

    @property
    def covariance_in_reference(self) -> FloatArray:
        """``(3, 3)``: the `covariance` in the frame of the reference, that of `transform`."""
        return turned(self.covariance, self.transform.theta)

    @property
    def margin(self) -> float:
        """Log-odds of the result minus the log-odds of its best rival; infinite without a rival."""
        return self.hypotheses[0].log_odds - max(each.log_odds for each in self.rivals) if self.rivals else math.inf

    @cached_property
    def matches(self) -> IntArray:
        """``(K, 2)``: indices of matched segments of the reference and of the current scan; computed on first use."""
        return self.find_matches()


@dataclass(frozen=True, eq=False)
class Prior:
    """Prediction of the motion before the scans are registered.

    Attributes
    ----------
    transform : SE2
        Pose of the current sensor in the reference's frame.
    covariance : (3, 3) float
        Covariance of (x, y, theta), as in `Registration`; it must be positive definite.
    velocity_change : (3, 3) float or None
        The part of the covariance that is due to a change of the velocity since the last scan; None if the velocity
        was not used or is unknown.
    measures_translation : bool
        Whether an external source measured the translation, as wheels do; false if the motion model predicts it, also
        with the rotation of a gyroscope.

    Raises
    ------
    ArgumentError
        When `transform` is no `SE2`, or `covariance` is not positive definite.
    """

    transform: SE2
    covariance: FloatArray
    velocity_change: FloatArray | None = None
    measures_translation: bool = True

    def __post_init__(self) -> None:
        expect('transform', self.transform, SE2, 'SE2(x, y, theta) [m, m, rad]')
        object.__setattr__(self, 'covariance', as_covariance(self.covariance))

    def __repr__(self) -> str:
        """Return one line."""
        return f'Prior({self.transform.brief()}, {sigma_text(self.covariance, "the current frame")})'

    @property
    def translation_sigma(self) -> float:
        """Standard deviation [m] of the translation along its least certain direction."""
        (xx, xy, _), (_, yy, _), _ = self.covariance.tolist()
        return math.sqrt(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation [rad] of the rotation."""
        return math.sqrt(float(self.covariance.item(2, 2)))

    def with_rotation(self, rotation: float, sigma: float) -> 'Prior':
        """Return the prior with another `rotation` [rad] of standard deviation `sigma` [rad].

        The length of the translation stays the same; its direction changes by half the difference of the rotations,
        because it is the chord of an arc.
        """
        chord = SE2(0.0, 0.0, 0.5 * wrap(rotation - self.transform.theta)) @ SE2(self.transform.x, self.transform.y)
        translation = np.diag((1.0, 1.0, 0.0))
        covariance = translation @ self.covariance @ translation + np.diag((0.0, 0.0, sigma * sigma))
        change = None if self.velocity_change is None else translation @ self.velocity_change @ translation
        return replace(self, transform=SE2(chord.x, chord.y, wrap(rotation)), covariance=covariance,
                       velocity_change=change)


def expect_prior(value: object) -> None:
    """Raise ArgumentError if a `value` given as prior is neither a `Prior` nor None."""
    if value is not None:
        expect('prior', value, Prior, 'Prior(SE2(x, y, theta), covariance)')
