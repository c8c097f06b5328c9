# SPDX-License-Identifier: Apache-2.0
"""Records of a registration: status, hypotheses, prior, result."""
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from ..geometry.se2 import SE2, wrap


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


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One candidate motion and its score."""

    transform: SE2
    score: float


def sigma_text(covariance: np.ndarray) -> str:
    """The standard deviations of a covariance ``(3, 3)`` of (x, y, theta) as a text."""
    x, y, theta = np.sqrt(np.diag(covariance))
    return f'sigma {x:.2g} m, {y:.2g} m, {math.degrees(theta):.2g} deg'


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
    degenerate_direction : float or None
        Angle [rad] in the reference's frame along which the scans leave the translation free.
    find_matches : callable
        Makes `matches`.
    matches : (K, 2) int
        Matched segments: index into the reference's and the current scan's; found when first asked for.
    reason : str
        Why the status is not ``OK``; empty otherwise.
    weakest_information : float or None
        So many points hold the translation along the direction in which it is known least; None where nobody counted.
    rotation_unobservable : bool
        The scans leave the rotation free.
    """

    transform: SE2
    covariance: np.ndarray
    status: Status
    overlap: float = 0.0
    score: float = 0.0
    hypotheses: tuple = ()
    degenerate_direction: float | None = None
    find_matches: Callable = no_matches
    reason: str = ''
    weakest_information: float | None = None
    rotation_unobservable: bool = False

    def __repr__(self) -> str:
        reason = f': {self.reason}' if self.reason else ''
        return (f'Registration({self.transform.brief()}, {sigma_text(self.covariance)}, score {self.score:.3f}, '
                f'overlap {self.overlap:.3f}, {len(self.hypotheses)} hypotheses, {self.status.name}{reason})')

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
    velocity_change : (3, 3) float or None
        Of a motion that goes on as before: the part of the covariance that is a change of the velocity, and lasts. None: the
        motion is known from elsewhere.
    """

    transform: SE2
    covariance: np.ndarray
    velocity_change: np.ndarray | None = None

    def __repr__(self) -> str:
        return f'Prior({self.transform.brief()}, {sigma_text(self.covariance)})'

    @property
    def translation_sigma(self):
        """Standard deviation [m] of the translation in the direction of which least is known."""
        (xx, xy, _), (_, yy, _), _ = self.covariance.tolist()
        return math.sqrt(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))

    @property
    def rotation_sigma(self):
        """Standard deviation [rad] of the rotation."""
        return math.sqrt(self.covariance.item(2, 2))

    def with_rotation(self, turn, spread) -> 'Prior':
        """The same way, but with a `turn` [rad] known to `spread` [rad]; its chord turns by half the difference."""
        chord = SE2(0.0, 0.0, 0.5 * wrap(turn - self.transform.theta)) @ SE2(self.transform.x, self.transform.y)
        way = np.diag((1.0, 1.0, 0.0))
        return Prior(SE2(chord.x, chord.y, wrap(turn)), way @ self.covariance @ way + np.diag((0.0, 0.0, spread * spread)),
                     None if self.velocity_change is None else way @ self.velocity_change @ way)
