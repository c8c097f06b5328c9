# SPDX-License-Identifier: Apache-2.0
"""Translation hypotheses: clusters of the solutions of pairs of line equations (section 2.2.2, Eq. 10-15)."""
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ..features.records import EndKind, Segments
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import DOF, as_complex, as_vectors, grouped_sum, unit_complex
from ..geometry.symmetric_matrix import solve
from ..geometry.ties import order_up_to_rounding
from ..parameters.registration import TranslationParameters
from .dbscan import NOISE, dbscan_plane, pairs_before, recluster, unlabelled, without_gaps
from .point_to_line import NO_STEP, normal_equations
from .records import TranslationSamples
from .rotation import Rotations, wrap_period


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


def estimate_translations(reference: Segments, current: Segments, rotations: Rotations, weights: FloatArray,
                          parameters: TranslationParameters) -> Translations:
    """Cluster the translations from pairs of matched lines and from matched end points, for every rotation.

    Parameters
    ----------
    reference, current : Segments
        The n segments of the reference and the m segments of the current scan.
    rotations : Rotations
    weights : (n, m) array
        Weight of each pair of segments.
    parameters : TranslationParameters
    """
    samples = signed_form(reference, current, rotations, weights, parameters)
    eps = 0.0
    if len(samples.translation):
        eps = parameters.eps
    labels = cluster(samples.translation, samples.rotation, eps, parameters)
    return rank_clusters(samples, labels, eps, rotations.phi)


def signed_form(reference: Segments, current: Segments, rotations: Rotations, weights: FloatArray,
                parameters: TranslationParameters) -> TranslationSamples:
    """Return the samples of `line_samples` and `end_samples`; directed lines determine the sign of each distance."""
    pairs = match_lines(rotations, weights, parameters)
    equations = signed_equations(reference, current, rotations, pairs)
    parts = line_samples(pairs, equations, parameters), end_samples(reference, current, rotations, pairs, parameters)
    translation, weight, rotation = (np.concatenate(part) for part in zip(*(each[:-1] for each in parts), strict=True))
    shortest = partial(shortest_translations, pairs, equations, rotations.phi[:parameters.shortest_rotations])
    return TranslationSamples(translation, weight, rotation, shortest)


class LinePairs(NamedTuple):
    """The L pairs of lines that a rotation makes parallel, sorted by rotation and then by weight.

    Attributes
    ----------
    rotation : (L,) int
        Index of the rotation.
    reference, current : (L,) int
        Index of the segment in either scan.
    weight : (L,) float
    """

    rotation: IntArray
    reference: IntArray
    current: IntArray
    weight: FloatArray


class LineEquations(NamedTuple):
    """Lines in the plane of translations, ``n . t = distance``, L of them.

    Attributes
    ----------
    along : (L,) complex
        Unit direction of the line; the unit normal n is to its left.
    distance : (L,) float [m]
    """

    along: ComplexArray
    distance: FloatArray


def match_lines(rotations: Rotations, weights: FloatArray, parameters: TranslationParameters) -> LinePairs:
    """Return the heaviest `translation.max_pairs` pairs of lines that each rotation makes parallel (Eq. 12)."""
    off = wrap_period(rotations.difference.ravel() - rotations.phi[:, None], 2.0 * np.pi)
    rotation, pair = (np.abs(off) < 2.0 * parameters.parallel_sigma).nonzero()
    weight = np.exp(-0.5 * (off[rotation, pair] / parameters.parallel_sigma) ** 2) * weights.ravel()[pair]
    order = order_up_to_rounding(-weight, rotation)
    size = np.bincount(rotation)
    rank = np.arange(len(order)) - (size.cumsum() - size).repeat(size)
    chosen = order[rank < parameters.max_pairs]
    return LinePairs(rotation[chosen], *np.divmod(pair[chosen], weights.shape[1]), weight[chosen])


def signed_equations(reference: Segments, current: Segments, rotations: Rotations, pairs: LinePairs) -> LineEquations:
    """Return the equation ``n . t = n . (m_R - Rot(phi) m_O)`` of each pair of lines (Eq. 13)."""
    rotation, r, o, _ = pairs
    off = wrap_period(rotations.difference[r, o] - rotations.phi[rotation], 2.0 * np.pi)
    angle = reference.direction[r] - 0.5 * off
    along = unit_complex(angle)
    apart = as_complex(reference.midpoint)[r] - unit_complex(rotations.phi)[rotation] * as_complex(current.midpoint)[o]
    return LineEquations(along, (along.conj() * apart).imag)


def line_samples(pairs: LinePairs, equations: LineEquations, parameters: TranslationParameters) -> TranslationSamples:
    """Solve all pairs of non-parallel line equations of each rotation (Eq. 14-15)."""
    along, distance = equations
    first, second = pairs_before(pairs.rotation.searchsorted(pairs.rotation, 'right'))
    determinant = (along.conj()[first] * along[second]).imag
    crossing = np.abs(determinant) > parameters.min_crossing_sine
    first, second, determinant = first[crossing], second[crossing], determinant[crossing]
    translation = (distance[first] * along[second] - distance[second] * along[first]) / determinant
    weight = np.minimum(pairs.weight[first], pairs.weight[second]) * np.abs(determinant)
    return TranslationSamples(translation, weight, pairs.rotation[first])


def shortest_translations(pairs: LinePairs, equations: LineEquations, phi: FloatArray) -> FloatArray:
    """Find the shortest translation that aligns all lines, for each of the first rotations `phi` ``(K,)``.

    The equations are solved by robust, damped least squares: between parallel walls, where no two lines cross, the
    translation along the walls is 0.

    Returns
    -------
    (K, 3) array
    """
    last = int(pairs.rotation.searchsorted(len(phi)))
    rotation, weight = pairs.rotation[:last], pairs.weight[:last]
    along, distance = (part[:last] for part in equations)
    weight = weight * (np.arange(len(phi))[:, None] == rotation)
    rows = np.array((-along.imag, along.real, np.zeros(last), -distance))
    found = np.tile(NO_STEP, (len(phi), 1))
    for scale in _SHORTEST_SCALES:
        found[:, :DOF] = -solve(normal_equations(rows, weight / (1.0 + (found @ rows / scale) ** 2)), _SHORTEST_DAMPING)
    found[:, 2] = phi
    return found[:, :DOF]


_SHORTEST_SCALES = 1.0, 0.1
"""Scale of the robust weight [m] in each iteration."""
_SHORTEST_DAMPING = 0.01
"""Damping of the least squares, as in `symmetric_matrix.solve`."""


def end_samples(reference: Segments, current: Segments, rotations: Rotations, pairs: LinePairs,
                parameters: TranslationParameters) -> TranslationSamples:
    """Match start points with start points, and end points with end points, if both are corners or free ends."""
    rotation, r, o, weight = pairs
    weights = parameters.end_weight * _END_WEIGHT[reference.kinds.T[:, r], current.kinds.T[:, o]]
    side, use = weights.nonzero()
    ends_r, ends_o = (np.array((as_complex(each.start), as_complex(each.end))) for each in (reference, current))
    group = rotation[use]
    translation = ends_r[side, r[use]] - unit_complex(rotations.phi)[group] * ends_o[side, o[use]]
    return TranslationSamples(translation, weight[use] * weights[side, use], group)


_END_WEIGHT = np.zeros((len(EndKind), len(EndKind)))
_END_WEIGHT[EndKind.CORNER, EndKind.CORNER] = 1.0
_END_WEIGHT[EndKind.FREE, EndKind.FREE] = 0.7
_END_WEIGHT[EndKind.CORNER, EndKind.FREE] = _END_WEIGHT[EndKind.FREE, EndKind.CORNER] = 0.4
_END_WEIGHT[EndKind.OCCLUSION, :] = _END_WEIGHT[:, EndKind.OCCLUSION] = 0.1


def _separated(samples: ComplexArray, rotation: IntArray, eps: float) -> ComplexArray:
    """Move the samples of each rotation along x, so that samples of different rotations are no neighbours."""
    x = samples.real
    separated: ComplexArray = samples + (2.0 * eps + x.max() - x.min()) * rotation
    return separated


def cluster(samples: ComplexArray, rotation: IntArray, eps: float, parameters: TranslationParameters) -> IntArray:
    """Cluster the samples (complex [m]) of each rotation; clusters wider than `translation.max_width` are chains."""
    if not len(samples):
        return unlabelled(0)
    max_width = parameters.max_width
    apart = as_vectors(_separated(samples, rotation, eps))

    def cluster_chosen(chosen: IntArray, ratio: float) -> IntArray:
        return dbscan_plane(apart[chosen], ratio * eps, parameters.min_samples)

    def is_chain(chosen: IntArray, found: IntArray) -> BoolArray:
        values, weight = samples[chosen], np.bincount(found)
        off = np.abs(values - _means(found, values, weight, 1.0)[found])
        chain: BoolArray = (np.bincount(found, off * off) > max_width ** 2 * weight)[found]
        return chain

    return recluster(len(samples), cluster_chosen, is_chain if max_width > 0.0 else None)


def _means(group: IntArray, values: ComplexArray, weight: FloatArray | IntArray,
           sample_weight: FloatArray | float) -> ComplexArray:
    """Return the weighted means of the complex `values` of each group; `weight` is the sum of each group's weights."""
    weighted: ComplexArray = sample_weight * values
    sums = grouped_sum(group, weighted)
    return np.asarray(sums / weight, dtype=np.complex128)


def rank_clusters(samples: TranslationSamples, labels: IntArray, eps: float, phi: FloatArray) -> Translations:
    """Return the weighted mean and the weight of each cluster, heaviest first.

    Parameters
    ----------
    samples : TranslationSamples
    labels : (S,) int array
    eps : float [m]
    phi : (K,) array [rad]
        Angle of each rotation hypothesis.
    """
    translation, sample_weight, rotation, find_shortest = samples
    members = (labels != NOISE).nonzero()[0]
    index = without_gaps(labels[members])
    weight: FloatArray = np.bincount(index, sample_weight[members]).astype(float, copy=False)
    order = order_up_to_rounding(-weight)
    mean = _means(index, translation[members], weight, sample_weight[members])
    angle = np.empty(len(weight))
    angle[index] = phi[rotation[members]]
    rank = np.empty(len(weight), dtype=int)
    rank[order] = np.arange(len(order))
    ranked = unlabelled(len(translation))
    ranked[members] = rank[index]
    transform = np.array((mean.real, mean.imag, angle)).T
    return Translations(transform[order], weight[order], as_vectors(translation), sample_weight, rotation, ranked, eps,
                        find_shortest)
