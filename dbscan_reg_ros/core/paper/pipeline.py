# SPDX-License-Identifier: Apache-2.0
"""The method of the paper, step by step (Figure 13)."""
import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..features.noise import range_noise
from ..features.records import Segments
from ..features.returns import Returns
from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.se2 import DOF, SE2, as_complex, wrap_period
from ..geometry.ties import order_up_to_rounding
from ..geometry.tolerance import RESOLUTION
from ..parameters.features import ScanParameters
from ..registration.hypotheses import Rotations, Translations
from ..registration.records import Hypothesis, Registration, Status
from ..registration.status import failed, match_segments
from ..scan import Scan
from .divergence import divergences
from .lines import extract_segments, find_breaks
from .ring_band import ring_band_filter
from .rotation import estimate_rotation
from .translation import estimate_translations

KEY_CLUSTERS = 2
"""The samples of this many largest translation clusters are compared, because Eq. 15 has two signs."""


@dataclass(frozen=True, eq=False)
class ScanLines:
    """What the method makes of one scan.

    Attributes
    ----------
    scan : Scan
    measured, filtered : (N, 2) float [m]
        Points before and after the ring band filter, not finite without a return or where it was removed.
    outcome : (N,) int
        What the filter did with each beam, an `Outcome`.
    points : (P, 2) float [m]
        The filtered points in beam order.
    breaks : (P - 1,) bool
        Whether a breakpoint lies between a point and the next.
    segments : Segments
    """

    scan: Scan
    measured: FloatArray
    filtered: FloatArray
    outcome: IntArray
    points: FloatArray
    breaks: BoolArray
    segments: Segments

    @classmethod
    def of(cls, scan: Scan) -> 'ScanLines':
        """Filter a scan and fit its lines (sections 2.1 and 2.2); ScanError if it has too few returns."""
        returns = Returns(scan, ScanParameters())
        filtered, outcome = ring_band_filter(returns.points)
        beams = np.flatnonzero(np.isfinite(filtered[:, 0]))
        points = as_complex(filtered[beams])
        breaks = find_breaks(points, beams, scan.geometry.angle_increment)
        noise = range_noise(np.abs(points), returns.noise, returns.noise_ratio)
        segments = extract_segments(points, beams, breaks, noise)
        if scan.geometry.angle_increment < 0.0:
            segments = segments.reversed()
        return cls(scan, returns.points, filtered, outcome, filtered[beams], breaks, segments)


@dataclass(frozen=True, eq=False)
class Solution:
    """The steps from the lines of two scans to their registration; `rotations` has one hypothesis at most."""

    rotations: Rotations
    translations: Translations
    registration: Registration


def register(reference: Scan | ScanLines, current: Scan | ScanLines) -> Registration:
    """Find the motion that aligns the current scan with the reference, without an initial guess.

    Parameters
    ----------
    reference, current : Scan or ScanLines
        The earlier and the later scan.

    Returns
    -------
    Registration
        The sample of the key clusters under which the densities of the scans differ least, with the score ``exp(-D)``
        for the divergence D. Its status is ``OK`` without a check, which the method does not have; ``FAILED`` without a
        sample. The covariance is the scatter of the clusters of the result, as the method has no better estimate.

    Raises
    ------
    ScanError
        When a scan has too few returns.
    """
    lines = (each if isinstance(each, ScanLines) else ScanLines.of(each) for each in (reference, current))
    return solve(*lines).registration


def solve(reference: ScanLines, current: ScanLines) -> Solution:
    """Run the steps of the registration and keep the result of each."""
    # Section 2.2.1: the rotation.
    rotations = estimate_rotation(reference.segments, current.segments)
    # Section 2.2.2: the translations.
    translations = estimate_translations(reference.segments, current.segments, rotations.phi)
    # Section 2.3: the sample of the key clusters with the least divergence.
    return Solution(rotations, translations, select(reference, current, rotations, translations))


def select(reference: ScanLines, current: ScanLines, rotations: Rotations, translations: Translations) -> Registration:
    """Select the sample with the least divergence; the best sample of each key cluster is a hypothesis."""
    labels = translations.labels
    key = np.flatnonzero(labels < KEY_CLUSTERS)
    if not len(key):
        return failed('no two pairs of lines cross')
    candidates = np.column_stack((translations.samples[key], np.full(len(key), rotations.phi[0])))
    divergence = divergences(candidates, reference.points, current.points)
    order = order_up_to_rounding(divergence)
    leaders = order[np.sort(np.unique(labels[key[order]], return_index=True)[1])]
    hypotheses = tuple(Hypothesis(SE2.from_array(candidates[i]), math.exp(-divergence[i])) for i in leaders)
    transform = hypotheses[0].transform
    covariance = _scatter(transform, int(labels[key[leaders[0]]]), rotations, translations)
    matches = partial(match_segments, reference.segments, current.segments, transform)
    return Registration(transform, covariance, Status.OK, score=hypotheses[0].score, hypotheses=hypotheses,
                        find_matches=matches)


def _scatter(transform: SE2, cluster: int, rotations: Rotations, translations: Translations) -> FloatArray:
    """Return the covariance ``(3, 3)`` in the current sensor's frame: mean squared deviations of the clusters."""
    samples = translations.samples[translations.labels == cluster]
    off = SE2(0.0, 0.0, -transform.theta).apply(samples - (transform.x, transform.y))
    rotation = rotations.difference[rotations.labels == 0] - transform.theta
    covariance = RESOLUTION ** 2 * np.eye(DOF)  # the scatter of a cluster of one sample is 0
    covariance[:2, :2] += off.T @ off / len(off)
    covariance[2, 2] += np.mean(wrap_period(rotation, math.pi) ** 2)
    return covariance


PAPER_MOTION = SE2(-1.5, 0.8, 0.3)
"""Motion [m, m, rad] of the points in the example of Figure 4."""


def moved(scan: Scan) -> Scan:
    """Return the points of a scan moved by `PAPER_MOTION`, as a scan in the same beam order."""
    return Scan.from_points(PAPER_MOTION.apply(scan.points), stamp=scan.stamp,
                            angle_increment=scan.geometry.angle_increment)
