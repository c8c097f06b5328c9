# SPDX-License-Identifier: Apache-2.0
"""Evidence for and against a motion: what each scan should see of the other if it is right, and what it sees."""
import cmath
import math

import numpy as np

from ...features.free_space import FreeSpaceProfile, in_front
from ...features.records import EndKind, Segments
from ...geometry.array_types import ComplexArray, FloatArray
from ...geometry.se2 import as_complex, wrap
from ..point_to_line import Fit, mean_square
from ..records import Agreement, Evidence
from ..search import Problem
from ..uncertainty import Observability


def collect_evidence(problem: Problem, candidate: FloatArray, found: Fit, observed: Observability,
                     scores: tuple[float, float]) -> Evidence:
    """Collect the evidence for and against a motion.

    Parameters
    ----------
    problem : Problem
    candidate : (3,) array
        The motion.
    found : Fit
        Of it, H = 1, for the current scan's `sampled_points`.
    observed : Observability
        Of it.
    scores : (float, float)
        Score of the motion, and its margin.
    """
    reference, current, p = problem.reference, problem.current, problem.parameters
    points, weight = current.sampled_points, found.weight(p.refinement.score_scale)[0]
    x, y, theta = candidate.tolist()
    translation, rotation = complex(x, y), cmath.exp(1j * theta)
    back, tolerance = rotation.conjugate(), p.density.violation_tolerance
    of_current = Agreement(*seen(found.places[0], 1.0 - weight, reference.free_space, tolerance))
    of_reference = Agreement(*seen(back * (reference.sampled_points.points - translation), 1.0, current.free_space,
                              tolerance))
    matched = count_matches(rotation * fixed_ends(current.segments) + translation, fixed_ends(reference.segments))
    return Evidence(
        *scores, residual=math.sqrt(mean_square(found.error[0], points.weighted(weight))), weak=observed.weak,
        rotation=observed.rotation, current=of_current, reference=of_reference, matched_ends=matched,
        crossing=crossing_length(reference.segments, current.segments, candidate), distance=abs(translation),
        angle=abs(wrap(theta)))


def seen(places: ComplexArray, unexplained: FloatArray | float, profile: FreeSpaceProfile,
         tolerance: float) -> tuple[float, int, float]:
    """Return the numbers of an `Agreement`.

    Parameters
    ----------
    places : (P,) complex array [m]
        Points of one scan in the frame of the other.
    unexplained : (P,) array or float
        Weight of each point as a conflict: 0 for those on a surface.
    profile : FreeSpaceProfile
        Of the other scan.
    tolerance : float [m]
        Distance from the outline within which a point is on it. Points up to twice as far behind it should be visible.
    """
    bins, radius = profile.bins(places), np.abs(places)
    near, behind = profile.near.take(bins), radius - profile.far.take(bins)
    known = near > 0.0
    visible = int(np.count_nonzero(known & (behind < 2.0 * tolerance)))
    on_outline = int(np.count_nonzero(known & (behind < tolerance) & (radius > near - tolerance)))
    conflicts = float((in_front(radius, near, tolerance) * unexplained).sum())
    size = max(len(places), 1)
    return visible / size, on_outline, conflicts / size


def fixed_ends(segments: Segments) -> ComplexArray:
    """Return the corners and the free ends (complex [m]) of the segments, each corner once."""
    starts, ends = segments.kinds.T
    places: ComplexArray = np.concatenate((as_complex(segments.start)[starts != EndKind.OCCLUSION],
                                           as_complex(segments.end)[ends == EndKind.FREE]))
    return places


def count_matches(ends: ComplexArray, others: ComplexArray) -> int:
    """Return how many of the `ends` ``(E,)`` are at the place of one of the `others` ``(F,)`` (complex [m])."""
    apart = np.abs(ends[:, None] - others)
    return int(np.count_nonzero((apart < _SAME_PLACE).any(axis=1)))


def crossing_length(reference: Segments, current: Segments, candidate: FloatArray) -> float:
    """Return the length [m] of the matched segments across their main direction: walls in one direction have none.

    Segments match where the middle of the current one lies on that of the reference.
    """
    if not (len(reference) and len(current)):
        return 0.0
    x, y, theta = candidate.tolist()
    moved = cmath.exp(1j * theta) * as_complex(current.midpoint) + complex(x, y)
    turned = np.exp(1j * (current.direction + theta))
    along = np.exp(1j * reference.direction)
    step = (moved - as_complex(reference.midpoint)[:, None]) * along.conj()[:, None]
    overlap = np.minimum(0.5 * (reference.length[:, None] + current.length) - np.abs(step.real),
                         np.minimum(reference.length[:, None], current.length))
    alike = (np.abs(step.imag) < _SAME_PLACE) & ((along.conj()[:, None] * turned).real > _PARALLEL)
    length = np.maximum(overlap * alike, 0.0).max(axis=0)
    return 0.5 * float(length.sum() - abs(length @ (turned * turned)))


_SAME_PLACE = 0.15
"""Largest distance [m] of ends that match, and of a segment from the line of another that matches."""
_PARALLEL = 0.99
"""Least cosine of the angle between segments that match."""
