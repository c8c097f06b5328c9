# SPDX-License-Identifier: Apache-2.0
"""Evidence for and against a motion: what each scan should see of the other if it is right, and what it sees."""
import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...features.free_space import FreeSpaceProfile, in_front
from ...features.records import Features, Segments
from ...geometry.array_types import BoolArray, ComplexArray, FloatArray
from ...geometry.se2 import as_complex
from ...parameters.tree import Parameters
from ..point_to_line import Fit, mean_square
from ..records import Evidence


def collect_evidence(candidates: FloatArray, fits: Fit, weak: Sequence[float], reference: Features, current: Features,
                     parameters: Parameters) -> list[Evidence]:
    """Collect the evidence for and against each of the motions.

    Parameters
    ----------
    candidates : (H, 3) array
    fits : Fit
        Of them, for the current scan's `sampled_points`.
    weak : (H,) sequence of float
        Number of points that constrain the weakest direction of each.
    reference, current : Features
    parameters : Parameters
    """
    points, seen_by = current.sampled_points, reference.free_space
    tolerance, weights = parameters.density.violation_tolerance, fits.weight(parameters.refinement.score_scale)
    chance, found = chance_conflicts(reference, current), []
    for candidate, places, weight, error, information in zip(candidates, fits.places, weights, fits.error, weak,
                                                             strict=True):
        x, y, theta = candidate.tolist()
        translation, rotation = complex(x, y), cmath.exp(1j * theta)
        back = rotation.conjugate() * (reference.sampled_points.points - translation)
        of_current, of_reference = seen(places, seen_by, tolerance), seen(back, current.free_space, tolerance)
        matched, unmatched = compare_ends(reference, current, (translation, rotation), tolerance)
        found.append(Evidence(
            conflicts_current=float((of_current.conflict * (1.0 - weight)).sum()) / max(len(places), 1),
            conflicts_reference=float(of_reference.conflict.sum()) / max(len(back), 1),
            on_outline=int(np.count_nonzero(of_reference.on_outline)), matched_ends=matched, unmatched_ends=unmatched,
            crossing=crossing_length(reference.segments, current.segments, candidate),
            residual=math.sqrt(mean_square(error, points.weighted(weight))), distance=abs(translation),
            weak=information, chance=chance))
    return found


def chance_conflicts(reference: Features, current: Features) -> float:
    """Return the fraction of points, 0..1, that lie in free space of the other scan though the motion is right.

    Random ranges are isolated. A place seems free where both beams that pass it are random, so that the fraction is the
    square of the fraction of isolated points. Where most ranges are random, nothing tells a right motion: the nearer
    the fraction is to `_ALL_RANDOM`, the less is explained by it.
    """
    rates = (min(each.isolated, max(_ALL_RANDOM - each.isolated, 0.0)) for each in (reference, current))
    return sum(rates) ** 2


class Seen(NamedTuple):
    """What a scan saw at the places of P points.

    Attributes
    ----------
    visible : (P,) bool
        Whether the scan would see a point there: one that is not hidden behind its outline.
    on_outline : (P,) bool
        Whether its outline is there.
    conflict : (P,) float
        1 where the place is free, falling to 0 at the outline.
    """

    visible: BoolArray
    on_outline: BoolArray
    conflict: FloatArray


def seen(places: ComplexArray, profile: FreeSpaceProfile, tolerance: float) -> Seen:
    """Return what a scan with this `profile` saw at `places` ``(P,)`` (complex [m]) in its frame.

    Parameters
    ----------
    places : (P,) complex array [m]
    profile : FreeSpaceProfile
    tolerance : float [m]
        Distance from the outline within which a point is on it. Points up to twice as far behind it are visible.
    """
    bins, radius = profile.bins(places), np.abs(places)
    near, behind = profile.near.take(bins), radius - profile.far.take(bins)
    known = near > 0.0
    return Seen(known & (behind < 2.0 * tolerance), known & (behind < tolerance) & (radius > near - tolerance),
                in_front(radius, near, tolerance))


def compare_ends(reference: Features, current: Features, motion: tuple[complex, complex],
                 tolerance: float) -> tuple[int, int]:
    """Count the corners and free ends of either scan that the other one has as well, and those that it should have.

    Parameters
    ----------
    reference, current : Features
    motion : (complex [m], complex)
        Translation and rotation (of unit length).
    tolerance : float [m]
        As for `seen`.

    Returns
    -------
    matched : int
        Those with one of the other scan at the same place.
    unmatched : int
        Those that are visible to the other scan, which has none nearby.
    """
    translation, rotation = motion
    ours, theirs = reference.segments.fixed_ends, rotation * current.segments.fixed_ends + translation
    apart = np.abs(theirs[:, None] - ours)
    nearest = np.concatenate((apart.min(axis=1, initial=np.inf), apart.min(axis=0, initial=np.inf)))
    visible = np.concatenate((
        seen(theirs, reference.free_space, tolerance).visible,
        seen(rotation.conjugate() * (ours - translation), current.free_space, tolerance).visible))
    return (int(np.count_nonzero(nearest < _SAME_PLACE)),
            int(np.count_nonzero(visible & (nearest >= 2.0 * _SAME_PLACE))))


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
_ALL_RANDOM = 0.45
"""Fraction of isolated points in a scan of uniformly random ranges."""
