# SPDX-License-Identifier: Apache-2.0
"""Records of a search: the problem, its stages and its candidates."""
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..features.oriented_points import OrientedPoints
from ..features.records import Features
from ..geometry.array_types import FloatArray, IntArray
from ..geometry.ties import order_up_to_rounding
from ..parameters.tree import Parameters
from .point_to_line import Alignment, Fit, fit, refine
from .records import Prior
from .rotation import Rotations, estimate_rotations, pair_weights
from .translation import Translations, estimate_translations


class SearchStage(Enum):
    """Which hypotheses a search considers; each stage considers more than the one before."""

    NEAR = 'near'
    """The hypotheses within the gate around the prior."""
    NORMAL = 'normal'
    """The clusters with the largest weights."""
    WIDE = 'wide'
    """`selection.wide_search_factor` times as many clusters, and the motions that match landmarks."""


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

    def joined(self) -> FloatArray:
        """Return all hypotheses, exempt ones first, ``(S + C, 3)``."""
        return np.concatenate((self.exempt, self.others))


class Ranking(NamedTuple):
    """The H refined hypotheses, best first.

    Attributes
    ----------
    candidates : (H, 3) float
        x, y [m] and theta [rad].
    score, overlap : (H,) float
        Results of `scoring.score`; penalties are subtracted from the score.
    conflict : (H,) float
        Weighted fraction of the current scan's points in free space of the reference.
    equations : (H, 4, 4) float
        The normal equations of the last iteration.
    odds : (H,) float
        Log-odds from `rank_by_evidence`; 0 before it has run.
    best : Fit
        Fit of the best hypothesis (H = 1).
    """

    candidates: FloatArray
    score: FloatArray
    overlap: FloatArray
    conflict: FloatArray
    equations: FloatArray
    odds: FloatArray
    best: Fit

    def joined(self, other: 'Ranking') -> 'Ranking':
        """Merge two rankings."""
        parts = [np.concatenate(each) for each in zip(self[:-1], other[:-1], strict=True)]
        order = order_up_to_rounding(-parts[1])
        best = self.best if order[0] < len(self.score) else other.best
        candidates, value, overlap, conflict, equations, odds = (part[order] for part in parts)
        return Ranking(candidates, value, overlap, conflict, equations, odds, best)

    def select(self, chosen: list[int] | IntArray) -> 'Ranking':
        """Return the hypotheses with the `chosen` indices; the first index must be that of the best hypothesis."""
        return Ranking(self.candidates[chosen], self.score[chosen], self.overlap[chosen], self.conflict[chosen],
                       self.equations[chosen], self.odds[chosen], self.best)

    def with_best(self, candidate: FloatArray, best: Fit) -> 'Ranking':
        """Return the ranking with another pose ``(3,)`` and fit of the best hypothesis."""
        return self._replace(candidates=np.concatenate((candidate[None], self.candidates[1:])), best=best)


@dataclass(frozen=True, eq=False)
class Problem:
    """Two scans to be registered, with parameters and prior.

    Attributes
    ----------
    reference, current : Features
        Features of the earlier and of the later scan.
    parameters : Parameters
    prior : Prior or None
    """

    reference: Features
    current: Features
    parameters: Parameters
    prior: Prior | None = None

    @cached_property
    def weights(self) -> FloatArray:
        """``(n, m)`` weights of all pairs of segments."""
        return self.current.backend.step(pair_weights)(
            self.reference.segments, self.current.segments, self.parameters.rotation)

    @cached_property
    def rotations(self) -> Rotations:
        """Rotation hypotheses from all pairs of segments (Eq. 9)."""
        return self.current.backend.step(estimate_rotations)(
            self.reference.segments, self.current.segments, self.weights, self.parameters.rotation)

    def translations(self, rotations: Rotations) -> Translations:
        """Cluster translation hypotheses for the `rotations` (Eq. 10-15)."""
        return self.current.backend.step(estimate_translations)(
            self.reference.segments, self.current.segments, rotations, self.weights, self.parameters.translation)

    def alignment(self, points: OrientedPoints) -> Alignment:
        """Return the alignment of `points` of the current scan with the reference."""
        return Alignment(points, self.reference.likelihood_field, self.parameters.density.min_normal_cosine,
                         self.parameters.refinement.damping)

    def refine(self, candidates: FloatArray, points: OrientedPoints, scales: Sequence[float],
               known: Fit | None = None) -> tuple[FloatArray, FloatArray]:
        """Refine the candidates with `points` of the current scan; see `point_to_line.refine`."""
        return refine(candidates, self.alignment(points), scales, known)

    def fit(self, candidates: FloatArray, points: OrientedPoints) -> Fit:
        """Return the `Fit` of `points` of the current scan to the reference for each of the `candidates` ``(H, 3)``."""
        return self.current.backend.step(fit)(
            candidates, points, self.reference.likelihood_field, self.parameters.density.min_normal_cosine)

    def widened(self) -> 'Problem':
        """Return the problem with the parameters of the wide stage."""
        return dataclasses.replace(self, parameters=self.parameters.widened)
