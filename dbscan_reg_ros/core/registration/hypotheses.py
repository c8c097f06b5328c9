# SPDX-License-Identifier: Apache-2.0
"""Records of hypotheses: of rotations, of translations, of motions, and their assessment."""
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import BoolArray, FloatArray, IntArray
from .records import Evidence
from .residuals import Fit, Observability


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
    find_shortest : callable
        Function that computes `shortest`.
    """

    transform: FloatArray
    weight: FloatArray
    samples: FloatArray
    sample_weight: FloatArray
    rotation: IntArray
    labels: IntArray
    eps: float
    find_shortest: Callable[[], FloatArray]

    @cached_property
    def shortest(self) -> FloatArray:
        """``(K, 3)``: the shortest motion that aligns the lines, for the heaviest rotations; computed on first use."""
        return self.find_shortest()


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


class Ranking(NamedTuple):
    """The H refined hypotheses, best first.

    Attributes
    ----------
    candidates : (H, 3) float
        x, y [m] and theta [rad].
    score, overlap : (H,) float
        Results of `scoring.scores`; penalties are subtracted from the score.
    odds : (H,) float
        Log-odds from `rank_by_evidence`; 0 before it has run.
    best : Fit
        Fit of the best hypothesis (H = 1).
    """

    candidates: FloatArray
    score: FloatArray
    overlap: FloatArray
    odds: FloatArray
    best: Fit

    def select(self, chosen: list[int] | IntArray) -> 'Ranking':
        """Return the hypotheses with the `chosen` indices; the first index must be that of the best hypothesis."""
        return Ranking(self.candidates[chosen], self.score[chosen], self.overlap[chosen], self.odds[chosen], self.best)

    def with_best(self, candidate: FloatArray, best: Fit) -> 'Ranking':
        """Return the ranking with another pose ``(3,)`` and fit of the best hypothesis."""
        return self._replace(candidates=np.concatenate((candidate[None], self.candidates[1:])), best=best)


class Assessment(NamedTuple):
    """Assessment of the best of H hypotheses.

    Attributes
    ----------
    covariance : (3, 3) float
        Covariance in the current sensor's frame [m, m, rad].
    observed : Observability
    rivals : (H,) bool
        Which hypotheses are different motions from the best.
    evidence : Evidence
    odds : list of float
        Log-odds of all hypotheses.
    """

    covariance: FloatArray
    observed: Observability
    rivals: BoolArray
    evidence: Evidence
    odds: list[float]
