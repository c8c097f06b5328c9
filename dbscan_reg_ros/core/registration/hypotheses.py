# SPDX-License-Identifier: Apache-2.0
"""Records of hypotheses: of rotations, of translations, of motions, and their assessment."""
from dataclasses import dataclass
from typing import NamedTuple

from ..geometry.array_types import FloatArray, IntArray
from .records import Evidence, Hypothesis
from .residuals import Observability


@dataclass(frozen=True, eq=False)
class Rotations:
    """The K rotation hypotheses, those with the largest weight first, and their samples.

    Attributes
    ----------
    phi : (K,) float [rad]
    weight : (K,) float [m]
        Sum of the weights of the samples in each cluster.
    difference : (n, m) float [rad]
        Angle differences between the reference's n and the current scan's m segments (Eq. 9).
    labels : (n, m) int
        Cluster of each difference, in the order of `phi`; -1 for none.
    eps : float [rad]
        Neighbourhood radius with which DBSCAN ran.
    """

    phi: FloatArray
    weight: FloatArray
    difference: FloatArray
    labels: IntArray
    eps: float


@dataclass(frozen=True, eq=False)
class Translations:
    """The C translation hypotheses, those with the largest weight first, and their samples.

    Attributes
    ----------
    transform : (C, 3) float
        x, y [m] and theta [rad] of each hypothesis.
    weight : (C,) float
        Sum of the weights of the samples of each hypothesis.
    samples : (S, 2) float [m]
    sample_weight : (S,) float
    rotation : (S,) int
        The rotation hypothesis that each sample belongs to.
    labels : (S,) int
        Cluster of each sample, in the order of `transform`; -1 for none.
    eps : float [m]
        Neighbourhood radius with which DBSCAN ran.
    """

    transform: FloatArray
    weight: FloatArray
    samples: FloatArray
    sample_weight: FloatArray
    rotation: IntArray
    labels: IntArray
    eps: float


class Candidates(NamedTuple):
    """Hypotheses ``(x [m], y [m], theta [rad])``, heaviest first.

    Attributes
    ----------
    exempt : (S, 3) float
        Hypotheses that are refined without a pre-selection.
    others : (C, 3) float
        Hypotheses that have to pass the pre-selection.
    """

    exempt: FloatArray
    others: FloatArray

    @property
    def size(self) -> int:
        """Number of hypotheses."""
        return len(self.exempt) + len(self.others)


class Assessment(NamedTuple):
    """Assessment of refined hypotheses that are different motions.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
        Best first.
    rivals : tuple of Hypothesis
        Those that differ from the best by `RIVAL_DISTANCE` or `RIVAL_ANGLE`; differences along a
        degenerate direction do not count.
    overlap : float
        Of the best, as in `Registration`.
    covariance : (3, 3) float
        Of the best in the current sensor's frame [m, m, rad].
    observed : Observability
        Of the best.
    evidence : Evidence
        For the best.
    agreement : (float, float)
        Of the best, as in `Registration`.
    """

    hypotheses: tuple[Hypothesis, ...]
    rivals: tuple[Hypothesis, ...]
    overlap: float
    covariance: FloatArray
    observed: Observability
    evidence: Evidence
    agreement: tuple[float, float]
