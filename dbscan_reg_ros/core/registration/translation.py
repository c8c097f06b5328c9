# SPDX-License-Identifier: Apache-2.0
"""Translation hypotheses: clusters of the solutions of pairs of line equations (section 2.2.2, Eq. 10-15)."""
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..features.records import EndKind, Segments
from ..geometry.se2 import as_complex, as_vectors
from ..geometry.symmetric_matrix import solve
from ..parameters.registration import TranslationParameters
from .clustering import choose_clustering
from .dbscan import NOISE, k_distances, knee, pairs_before, unlabelled, without_gaps
from .paper.squared_translation import squared_samples
from .point_to_line import normal_equations
from .rotation import Rotations, wrap_period


@dataclass(frozen=True, eq=False)
class Translations:
    """Translation hypotheses, C of them, and the samples that they were made from.

    Attributes
    ----------
    transform : (C, 3) float
        x, y [m] and theta [rad] of each hypothesis.
    weight : (C,) float
        Weight of its samples.
    samples : (S, 2) float [m]
    sample_weight : (S,) float
    rotation : (S,) int
        The rotation hypothesis that each sample belongs to.
    labels : (S,) int
        Cluster of each sample, in the order of `transform`; -1 for none.
    eps : float [m]
        Neighbourhood of DBSCAN that was used.
    find_shortest : callable
        Makes `shortest`.
    shortest : (K, 3) float
        x, y [m] and theta [rad]: the shortest translation that lays the lines on one another, for the heaviest rotations;
        found when first asked for.
    """

    transform: np.ndarray
    weight: np.ndarray
    samples: np.ndarray
    sample_weight: np.ndarray
    rotation: np.ndarray
    labels: np.ndarray
    eps: float
    find_shortest: Callable

    @cached_property
    def shortest(self):
        return self.find_shortest()


def estimate_translations(reference: Segments, current: Segments, rotations: Rotations, weights,
                          parameters: TranslationParameters) -> Translations:
    """Cluster the translations that pairs of matched lines and matched end points ask for, for every rotation.

    The squared form takes lines only, and every sample weighs the same.

    Parameters
    ----------
    reference, current : Segments
    rotations : Rotations
    weights : (n, m) array
        Weight of each pair of segments.
    parameters : TranslationParameters
    """
    if parameters.form == 'squared':
        solutions = [squared_samples(reference, current, phi, parameters) for phi in rotations.phi]
        samples = as_complex(np.concatenate([np.empty((0, 2)), *solutions]))
        mass, rotation = np.ones(len(samples)), np.repeat(np.arange(len(solutions)), [len(s) for s in solutions])
        shortest = partial(np.empty, (0, 3))
    else:
        pairs = match_lines(rotations, weights, parameters)
        equations = signed_equations(reference, current, rotations, pairs)
        lines = line_samples(pairs, equations, parameters)
        ends = end_samples(reference, current, rotations, pairs, parameters)
        samples, mass, rotation = (np.concatenate(part) for part in zip(lines, ends))
        shortest = partial(shortest_translations, pairs, equations, rotations.phi[:parameters.shortest_rotations])
    if not len(samples):
        return Translations(np.empty((0, 3)), np.empty(0), as_vectors(samples), mass, rotation, np.empty(0, dtype=int), 0.0,
                            shortest)
    eps = parameters.eps or knee_eps(samples, rotation, parameters)
    labels = cluster(samples, rotation, eps, parameters)
    return _rank(samples, mass, rotation, labels, eps, rotations.phi, shortest)


def match_lines(rotations, weights, parameters):
    """The heaviest pairs of lines that each rotation makes parallel (Eq. 12).

    Returns
    -------
    rotation, line_r, line_o : (L,) int arrays
    weight : (L,) array
    """
    off = wrap_period(rotations.difference.ravel() - rotations.phi[:, None], 2.0 * np.pi)
    rotation, pair = (np.abs(off) < 2.0 * parameters.parallel_sigma).nonzero()
    weight = np.exp(-0.5 * (off[rotation, pair] / parameters.parallel_sigma) ** 2) * weights.ravel()[pair]
    order = np.lexsort((-weight, rotation))
    size = np.bincount(rotation)
    rank = np.arange(len(order)) - (size.cumsum() - size).repeat(size)
    chosen = order[rank < parameters.max_pairs]
    return rotation[chosen], *np.divmod(pair[chosen], weights.shape[1]), weight[chosen]


def signed_equations(reference, current, rotations, pairs):
    """The lines ``n . t = n . (m_R - Rot(phi) m_O)``, one for each pair of lines (Eq. 13).

    Returns
    -------
    along : (L,) complex array
        Direction of the line; the unit normal n lies to its left.
    distance : (L,) array [m]
        The right side.
    """
    rotation, r, o, _ = pairs
    angle = reference.direction[r] - 0.5 * wrap_period(rotations.difference[r, o] - rotations.phi[rotation], 2.0 * np.pi)
    along = np.exp(1j * angle)
    apart = as_complex(reference.midpoint)[r] - np.exp(1j * rotations.phi)[rotation] * as_complex(current.midpoint)[o]
    return along, (along.conj() * apart).imag


def line_samples(pairs, equations, parameters):
    """Translations (complex [m]) from all pairs of non-parallel line equations (Eq. 14-15)."""
    rotation, _, _, weight = pairs
    along, distance = equations
    first, second = pairs_before(rotation.searchsorted(rotation, 'right'))
    determinant = (along.conj()[first] * along[second]).imag
    crossing = np.abs(determinant) > parameters.min_crossing_sine
    first, second, determinant = first[crossing], second[crossing], determinant[crossing]
    samples = (distance[first] * along[second] - distance[second] * along[first]) / determinant
    return samples, np.minimum(weight[first], weight[second]) * np.abs(determinant), rotation[first]


def shortest_translations(pairs, equations, phi):
    """The shortest translation that lays all lines on one another, for each of the first rotations, ``(K, 3)``.

    Robust and damped least squares: between parallel walls, where no two lines cross, what they leave open is no motion.
    """
    last = pairs[0].searchsorted(len(phi))
    rotation, _, _, weight = (part[:last] for part in pairs)
    along, distance = (part[:last] for part in equations)
    weight = weight * (np.arange(len(phi))[:, None] == rotation)
    rows = np.array((-along.imag, along.real, np.zeros(last), -distance))
    found = np.zeros((len(phi), 4))
    found[:, 3] = 1.0
    for scale in _SHORTEST_SCALES:
        found[:, :3] = -solve(normal_equations(rows, weight / (1.0 + (found @ rows / scale) ** 2)), _SHORTEST_DAMPING)
    found[:, 2] = phi
    return found[:, :3]


_SHORTEST_SCALES = 1.0, 0.1
"""Of the distance [m] between two lines, from one iteration to the next."""
_SHORTEST_DAMPING = 0.01


def end_samples(reference, current, rotations, pairs, parameters):
    """Translations (complex [m]) from matched end points: starts onto starts, ends onto ends, where both are points of the
    world.
    """
    rotation, r, o, weight = pairs
    weights = parameters.end_weight * _END_WORTH[reference.kinds.T[:, r], current.kinds.T[:, o]]
    side, use = weights.nonzero()
    here, there = (np.array((as_complex(each.start), as_complex(each.end))) for each in (reference, current))
    group = rotation[use]
    samples = here[side, r[use]] - np.exp(1j * rotations.phi)[group] * there[side, o[use]]
    return samples, weight[use] * weights[side, use], group


_END_WORTH = np.zeros((3, 3))
_END_WORTH[EndKind.CORNER, EndKind.CORNER] = 1.0
_END_WORTH[EndKind.FREE, EndKind.FREE] = 0.7
_END_WORTH[EndKind.CORNER, EndKind.FREE] = _END_WORTH[EndKind.FREE, EndKind.CORNER] = 0.4
_END_WORTH[EndKind.OCCLUSION, :] = _END_WORTH[:, EndKind.OCCLUSION] = 0.1


def knee_eps(samples, rotation, parameters):
    """The neighbourhood from the knee of the k-dist graph of all samples, within its bounds."""
    apart = _apart(samples, rotation, parameters.eps_max)
    bend = knee(k_distances(as_vectors(apart), max(parameters.min_samples - 1, 1)))
    return min(max(bend, parameters.eps_min), parameters.eps_max)


def _apart(samples, rotation, reach):
    """The samples of each rotation moved along x, out of the others' reach."""
    x = samples.real
    return samples + (10.0 * reach + x.max() - x.min()) * rotation


def cluster(samples, rotation, eps, parameters):
    """DBSCAN of the samples (complex [m]) of each rotation; clusters wider than `width` again, twice as finely."""
    labels, clustering = unlabelled(len(samples)), choose_clustering(parameters.clustering)
    apart = as_vectors(_apart(samples, rotation, max(eps, parameters.eps_max)))
    todo, offset = np.arange(len(samples)), 0
    for _ in range(parameters.recluster_levels + 1):
        found = clustering.dbscan_plane(apart[todo], eps, parameters.min_samples)
        kept = found != NOISE
        todo, found = todo[kept], found[kept]
        if not len(todo):
            break
        labels[todo] = found + offset
        if parameters.max_width <= 0.0:
            break
        chosen, weight = samples[todo], np.bincount(found)
        off = np.abs(chosen - _means(found, chosen, weight)[found])
        wide = (np.bincount(found, off * off) > parameters.max_width ** 2 * weight)[found]
        if not wide.any():
            break
        offset += len(weight)
        todo, eps = todo[wide], 0.5 * eps
    return labels


def _means(group, values, weight, mass=1.0):
    """Means of the complex `values` of each group, groups numbered from 0, from their `mass` and its sum, the `weight`."""
    values = mass * values
    return (np.bincount(group, values.real) + 1j * np.bincount(group, values.imag)) / weight


def _rank(samples, mass, rotation, labels, eps, phi, shortest):
    """Weighted mean and weight of each cluster, heaviest first."""
    at = (labels != NOISE).nonzero()[0]
    index = without_gaps(labels[at])
    weight = np.bincount(index, mass[at])
    order = (-weight).argsort(kind='stable')
    mean = _means(index, samples[at], weight, mass[at])
    angle = np.empty(len(weight))
    angle[index] = phi[rotation[at]]
    rank = np.empty(len(weight), dtype=int)
    rank[order] = np.arange(len(order))
    ranked = unlabelled(len(samples))
    ranked[at] = rank[index]
    transform = np.array((mean.real, mean.imag, angle)).T
    return Translations(transform[order], weight[order], as_vectors(samples), mass, rotation, ranked, eps, shortest)
