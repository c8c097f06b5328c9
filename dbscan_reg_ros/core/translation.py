"""Translation hypotheses: clusters of the solutions of pairs of line equations (section 2.2.2, Eq. 10-15)."""
from dataclasses import dataclass

import numpy as np

from .clustering import NOISE, dbscan_plane, k_distances, knee
from .parameters import TranslationParameters
from .records import EndKind, Segments
from .rotation import Rotations, wrap_period
from .squared import squared_samples


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
    sigma : float [m]
        The neighbourhood that was used.
    shortest : (K, 3) float
        x, y [m] and theta [rad]: the shortest translation that lays the lines on one another, for the heaviest rotations.
    """

    transform: np.ndarray
    weight: np.ndarray
    samples: np.ndarray
    sample_weight: np.ndarray
    rotation: np.ndarray
    labels: np.ndarray
    sigma: float
    shortest: np.ndarray


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
        samples = np.concatenate([np.empty((0, 2)), *solutions])
        mass, rotation = np.ones(len(samples)), np.repeat(np.arange(len(solutions)), [len(s) for s in solutions])
        shortest = np.empty((0, 3))
    else:
        pairs = match_lines(rotations, weights, parameters)
        equations = signed_equations(reference, current, rotations, pairs)
        lines = line_samples(pairs, equations, parameters)
        ends = end_samples(reference, current, rotations, pairs, parameters)
        samples, mass, rotation = (np.concatenate(part) for part in zip(lines, ends))
        shortest = shortest_translations(pairs, equations, rotations.phi[:parameters.shortest])
    if not len(samples):
        return Translations(np.empty((0, 3)), np.empty(0), samples, mass, rotation, np.empty(0, dtype=int), 0.0, shortest)
    sigma = parameters.sigma or knee_sigma(samples, rotation, parameters)
    labels = cluster(samples, rotation, sigma, parameters)
    return _rank(samples, mass, rotation, labels, sigma, rotations.phi, shortest)


def match_lines(rotations, weights, parameters):
    """The heaviest pairs of lines that each rotation makes parallel (Eq. 12).

    Returns
    -------
    rotation, line_r, line_o : (L,) int arrays
    weight : (L,) array
    """
    count, (n, m) = len(rotations.phi), weights.shape
    off = np.abs(wrap_period(rotations.difference - rotations.phi[:, None, None], 2.0 * np.pi))
    fit = np.exp(-0.5 * (off / parameters.parallel) ** 2) * (off < 2.0 * parameters.parallel)
    value = (fit * weights).reshape(count, n * m)
    keep = min(parameters.pairs, n * m)
    best = np.argpartition(-value, keep - 1, axis=1)[:, :keep]
    value = value[np.arange(count)[:, None], best]
    rotation, column = np.nonzero(value > 0.0)
    line = best[rotation, column]
    return rotation, line // m, line % m, value[rotation, column]


def signed_equations(reference, current, rotations, pairs):
    """``n . t = n . (m_R - Rot(phi) m_O)`` for each pair of lines (Eq. 13).

    Returns
    -------
    nx, ny, c : (L,) arrays
        The unit normal n and the right side [m].
    """
    rotation, r, o, _ = pairs
    phi = rotations.phi[rotation]
    angle = reference.direction[r] - 0.5 * wrap_period(rotations.difference[r, o] - phi, 2.0 * np.pi)
    nx, ny = -np.sin(angle), np.cos(angle)
    offset = reference.midpoint[r] - rotate(phi, current.midpoint[o])
    return nx, ny, nx * offset[:, 0] + ny * offset[:, 1]


def line_samples(pairs, equations, parameters):
    """Translations from all pairs of non-parallel line equations (Eq. 14-15)."""
    rotation, _, _, weight = pairs
    nx, ny, c = equations
    first, second = same_group_pairs(rotation)
    determinant = nx[first] * ny[second] - ny[first] * nx[second]
    crossing = np.abs(determinant) > parameters.crossing
    first, second, determinant = first[crossing], second[crossing], determinant[crossing]
    tx = (c[first] * ny[second] - c[second] * ny[first]) / determinant
    ty = (nx[first] * c[second] - nx[second] * c[first]) / determinant
    mass = np.minimum(weight[first], weight[second]) * np.abs(determinant)
    return np.array((tx, ty)).T, mass, rotation[first]


def shortest_translations(pairs, equations, phi):
    """The shortest translation that lays all lines on one another, for each of the first rotations, ``(K, 3)``.

    Robust and damped least squares: between parallel walls, where no two lines cross, what they leave open is no motion.
    """
    used = pairs[0] < len(phi)
    rotation, weight = pairs[0][used], pairs[3][used]
    nx, ny, c = (part[used] for part in equations)
    x, y = np.zeros((2, len(phi)))
    for scale in _SHORTEST_SCALES:
        w = weight / (1.0 + ((nx * x[rotation] + ny * y[rotation] - c) / scale) ** 2)
        xx, xy, yy, cx, cy = (np.bincount(rotation, w * part, len(phi))
                              for part in (nx * nx, nx * ny, ny * ny, nx * c, ny * c))
        damping = _SHORTEST_DAMPING * (xx + yy) + 1e-9
        xx, yy = xx + damping, yy + damping
        determinant = xx * yy - xy * xy
        x, y = (yy * cx - xy * cy) / determinant, (xx * cy - xy * cx) / determinant
    return np.array((x, y, phi)).T


_SHORTEST_SCALES = 1.0, 0.3, 0.1
"""Of the distance [m] between two lines, from one iteration to the next."""
_SHORTEST_DAMPING = 0.01


def end_samples(reference, current, rotations, pairs, parameters):
    """Translations from matched end points: starts onto starts, ends onto ends, where both are points of the world."""
    rotation, r, o, weight = pairs
    phi = rotations.phi[rotation]
    samples, masses, groups = [], [], []
    for side, name in enumerate(('start', 'end')):
        kind_r, kind_o = reference.kinds[r, side], current.kinds[o, side]
        worth = parameters.end_weight * _END_WORTH[kind_r, kind_o]
        use = worth > 0.0
        t = getattr(reference, name)[r[use]] - rotate(phi[use], getattr(current, name)[o[use]])
        samples.append(t)
        masses.append(weight[use] * worth[use])
        groups.append(rotation[use])
    return np.concatenate(samples), np.concatenate(masses), np.concatenate(groups)


_END_WORTH = np.zeros((3, 3))
_END_WORTH[EndKind.CORNER, EndKind.CORNER] = 1.0
_END_WORTH[EndKind.FREE, EndKind.FREE] = 0.7
_END_WORTH[EndKind.CORNER, EndKind.FREE] = _END_WORTH[EndKind.FREE, EndKind.CORNER] = 0.4
_END_WORTH[EndKind.OCCLUSION, :] = _END_WORTH[:, EndKind.OCCLUSION] = 0.1


def rotate(phi, points):
    """Points ``(N, 2)`` each turned by its own angle ``(N,)`` (Eq. 10)."""
    c, s = np.cos(phi), np.sin(phi)
    x, y = points[:, 0], points[:, 1]
    return np.array((c * x - s * y, s * x + c * y)).T


def same_group_pairs(group):
    """All pairs ``i < j`` with equal `group`, which must be sorted."""
    size = len(group)
    end = np.searchsorted(group, group, 'right')
    count = end - np.arange(size) - 1
    first = np.repeat(np.arange(size), count)
    start = np.cumsum(count) - count
    return first, first + 1 + np.arange(len(first)) - np.repeat(start, count)


def knee_sigma(samples, rotation, parameters):
    """The neighbourhood from the knee of the k-dist graph of all samples, within its bounds."""
    bend = knee(k_distances(_apart(samples, rotation, parameters.sigma_max), max(parameters.min_points - 1, 1)))
    return min(max(bend, parameters.sigma_min), parameters.sigma_max)


def _apart(samples, rotation, reach):
    """The samples of each rotation moved along x, out of the others' reach."""
    x = samples[:, 0]
    return np.column_stack((x + (10.0 * reach + x.max() - x.min()) * rotation, samples[:, 1]))


def cluster(samples, rotation, sigma, parameters):
    """DBSCAN of the samples of each rotation; clusters wider than `width` are clustered again, twice as finely."""
    labels = np.full(len(samples), NOISE)
    samples = _apart(samples, rotation, max(sigma, parameters.sigma_max))
    todo, offset = np.arange(len(samples)), 0
    for _ in range(parameters.recuts + 1):
        found = dbscan_plane(samples[todo], sigma, parameters.min_points)
        kept = found != NOISE
        todo, found = todo[kept], found[kept]
        if not len(todo):
            break
        labels[todo] = found + offset
        if parameters.width <= 0.0:
            break
        weight = np.bincount(found)
        spread = np.zeros(len(weight))
        for column in samples[todo].T:
            mean = np.bincount(found, column) / weight
            spread += np.bincount(found, (column - mean[found]) ** 2) / weight
        wide = (spread > parameters.width ** 2)[found]
        if not wide.any():
            break
        offset += len(weight)
        todo, sigma = todo[wide], 0.5 * sigma
    return labels


def _rank(samples, mass, rotation, labels, sigma, phi, shortest):
    """Weighted mean and weight of each cluster, heaviest first."""
    at = np.flatnonzero(labels != NOISE)
    index = labels[at]
    weight = np.bincount(index, mass[at])
    order = np.argsort(-weight, kind='stable')[:np.count_nonzero(np.bincount(index))]
    transform = np.empty((len(weight), 3))
    with np.errstate(invalid='ignore'):
        for column in (0, 1):
            transform[:, column] = np.bincount(index, mass[at] * samples[at, column]) / weight
    transform[index, 2] = phi[rotation[at]]
    rank = np.empty(len(weight), dtype=int)
    rank[order] = np.arange(len(order))
    ranked = np.full(len(samples), NOISE)
    ranked[at] = rank[index]
    return Translations(transform[order], weight[order], samples, mass, rotation, ranked, sigma, shortest)
