# SPDX-License-Identifier: Apache-2.0
"""Registration of two scans step by step, with the result of each step."""
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.features.extraction import extract_from_returns
from ..core.features.returns import Returns
from ..core.features.ring_band import ring_band_filter
from ..core.geometry.se2 import SE2, as_vectors, wrap
from ..core.paper.pipeline import ScanLines, solve
from ..core.parameters.tree import Parameters
from ..core.registration.clustering.rotation import estimate_rotations, k_distances, pair_weights
from ..core.registration.clustering.translation import estimate_translations
from ..core.registration.hypotheses import Rotations, Translations
from ..core.registration.landmarks import landmarks
from ..core.registration.pipeline import register, with_common_noise
from ..core.registration.problem import Problem
from ..core.registration.records import Registration
from ..core.registration.scoring import scores
from ..core.scan import Scan


@dataclass(frozen=True, eq=False)
class ScanSteps:
    """Results of the steps that process one scan."""

    features: Any
    """Features or ScanLines: the latter by the method of the paper."""
    measured: np.ndarray
    filtered: np.ndarray
    """Points before and after the ring band filter ``(N, 2)`` [m]; not finite if the beam has no return or its point
    was removed."""
    outcome: np.ndarray
    """What the filter did with each beam, an `Outcome` ``(N,)`` int."""
    breaks: np.ndarray
    """Whether a breakpoint lies between a point of `features` and the next point ``(P - 1,)`` bool."""
    landmarks: np.ndarray
    """Positions of the landmarks in `features` ``(L, 2)`` [m]."""

    @classmethod
    def of(cls, scan: Scan, parameters: Parameters) -> 'ScanSteps':
        """Run the steps on a scan; raise ScanError if the scan has too few returns."""
        returns = Returns(scan, parameters.scan)
        features = extract_from_returns(returns, parameters, returns.noise_ratio)
        filtered, outcome = ring_band_filter(returns.points, returns.noise, parameters.filter)
        known = as_vectors(landmarks(features, parameters))
        return cls(features, returns.points, filtered, outcome, features.breaks, known)

    @classmethod
    def of_paper(cls, scan: Scan) -> 'ScanSteps':
        """Run the steps of the method of the paper on a scan; raise ScanError if the scan has too few returns."""
        lines = ScanLines.of(scan)
        return cls(lines, lines.measured, lines.filtered, lines.outcome, lines.breaks, np.empty((0, 2)))


@dataclass(frozen=True, eq=False)
class Steps:
    """Results of the steps that register a pair of scans."""

    reference: ScanSteps
    current: ScanSteps
    rotations: Rotations
    translations: Translations
    registration: Registration
    parameters: Any
    """Parameters: None by the method of the paper, which has none."""
    truth: SE2 | None = None
    """True motion, drawn where it is known."""

    @classmethod
    def of(cls, reference: Scan, current: Scan, parameters: Parameters, registration: Registration | None = None,
           truth: SE2 | None = None) -> 'Steps':
        """Return the steps from two scans to their `registration`; without a `registration`, register the scans.

        Raises a ScanError when one of the scans has too few returns.
        """
        return cls.between(ScanSteps.of(reference, parameters), ScanSteps.of(current, parameters), parameters,
                           registration, truth)

    @classmethod
    def between(cls, earlier: ScanSteps, later: ScanSteps, parameters: Parameters,
                registration: Registration | None = None, truth: SE2 | None = None) -> 'Steps':
        """Return the steps, as `of`, from those that process each scan."""
        p = parameters
        lines = earlier.features.segments, later.features.segments
        weights = pair_weights(*lines, p.rotation)
        rotations = estimate_rotations(*lines, weights, p.rotation)
        translations = estimate_translations(*lines, rotations, weights, p.translation)
        return cls(earlier, later, rotations, translations,
                   registration or register(earlier.features, later.features, p), p, truth)

    @classmethod
    def of_paper(cls, reference: Scan, current: Scan, truth: SE2 | None = None) -> 'Steps':
        """Return the steps of the method of the paper; raise ScanError if a scan has too few returns."""
        earlier, later = ScanSteps.of_paper(reference), ScanSteps.of_paper(current)
        found = solve(earlier.features, later.features)
        return cls(earlier, later, found.rotations, found.translations, found.registration, None, truth)

    @property
    def by_paper(self) -> bool:
        """Whether these are the steps of the method of the paper."""
        return self.parameters is None

    @property
    def scans(self) -> tuple:
        """(name, `ScanSteps`) of the reference and of the current scan."""
        return ('reference', self.reference), ('current', self.current)

    @property
    def rotation(self) -> int | None:
        """Index of the rotation hypothesis nearest to the result; None if there are no rotation hypotheses."""
        off = np.abs(wrap(self.rotations.phi - self.registration.transform.theta))
        return int(np.argmin(off)) if len(off) else None

    def score_at(self, motion: SE2) -> tuple[float, float]:
        """Return the score and the overlap of the scans at a `motion`."""
        reference, current, p = self.reference.features, self.current.features, self.parameters
        problem = Problem(reference, with_common_noise(reference, current), p)
        (value,), (overlap,), *_ = scores(problem, motion.as_array()[None])
        return float(value), float(overlap)

    def rotation_distances(self):
        """Return the sorted distances [rad] of the angle differences to their k-th neighbour (k-dist graph), and k."""
        k = 1 if self.by_paper else max(self.parameters.rotation.min_samples - 1, 1)
        return k_distances(self.rotations.difference.ravel(), k), k
