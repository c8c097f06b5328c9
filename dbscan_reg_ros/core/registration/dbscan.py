# SPDX-License-Identifier: Apache-2.0
"""DBSCAN, faster than scikit-learn's on small sets and equal to it sample for sample; the k-dist graph.

Ester, Kriegel, Sander, Xu: "A density-based algorithm for discovering clusters in large spatial databases with noise",
KDD 1996.
"""
import numpy as np
from scipy.spatial import cKDTree

NOISE = -1


def unlabelled(size):
    """So many labels that say `NOISE`."""
    labels = np.empty(size, dtype=int)
    labels.fill(NOISE)
    return labels


def dbscan_line(samples, eps, min_samples, sample_weight=None, period=None):
    """DBSCAN of numbers: sort, count the neighbours by bisection, cut at the gaps.

    Parameters
    ----------
    samples : (N,) array
        On a circle of circumference `period`, they must lie within one period.
    eps : float
        Neighbours lie at most this far apart.
    min_samples : float
        A sample whose neighbours (itself included) weigh at least this is a core sample.
    sample_weight : (N,) array, optional
        1 each when not given.
    period : float, optional

    Returns
    -------
    (N,) int array
        Cluster of each sample, numbered by the first core sample of each; `NOISE` where there is none. A border sample
        goes to the first of the clusters that reach it.
    """
    size = len(samples)
    order = samples.argsort(kind='stable')
    x = samples[order]
    labels = unlabelled(size)
    if size and sample_weight is None and min_samples <= 1:
        labels[order] = _chains(x, order, eps, period)
        return labels
    left, right = _neighbour_range(x, eps, period)
    copies = 1 if period is None else 3
    mass = np.ones(size) if sample_weight is None else np.asarray(sample_weight, dtype=float)[order]
    total = np.concatenate(([0.0], np.cumsum(np.tile(mass, copies))))
    core = total[right] - total[left] >= min_samples - 1e-12 * total[-1]
    at = core.nonzero()[0]
    if not len(at):
        return labels
    component = _chains(x[at], order[at], eps, period)
    sorted_labels = unlabelled(size)
    sorted_labels[at] = component
    if len(at) < size:
        border = np.flatnonzero(~core)
        position, reach = x[border], np.searchsorted(at, border)
        best = np.full(len(border), size)
        for neighbour in (reach - 1, reach):
            turns = np.where(neighbour < 0, -1, np.where(neighbour >= len(at), 1, 0))
            value = x[at[neighbour % len(at)]]
            if period is None:
                near = (turns == 0) & (np.abs(position - value) <= eps)
            else:
                near = np.abs(position - (value + turns * period)) <= eps
            best = np.where(near, np.minimum(best, component[neighbour % len(at)]), best)
        sorted_labels[border] = np.where(best < size, best, NOISE)
    labels[order] = sorted_labels
    return labels


def _chains(x, index, eps, period):
    """Number of the chain that each of the sorted `x` belongs to, cut at the gaps; numbered by the least `index` of each."""
    chain = np.zeros(len(x), dtype=int)
    (x[1:] - x[:-1] > eps).cumsum(out=chain[1:])
    if period is not None and chain[-1] > 0 and x[0] + period - x[-1] <= eps:
        chain[chain == chain[-1]] = 0
    return _renumber(chain, index)


def _neighbour_range(x, eps, period):
    """Indices ``[left, right)`` of the neighbours of each of the sorted `x`; into three laps on a circle."""
    if period is None:
        return np.searchsorted(x, x - eps), np.searchsorted(x, x + eps, 'right')
    laps = np.concatenate((x - period, x, x + period))
    size = len(x)
    left, right = np.searchsorted(laps, x - eps), np.searchsorted(laps, x + eps, 'right')
    middle = np.arange(size, 2 * size)
    return np.maximum(left, middle - size + 1), np.minimum(right, np.maximum(left, middle - size + 1) + size)


def dbscan_plane(samples, eps, min_samples, sample_weight=None):
    """DBSCAN of points: pairs of neighbours, clusters as connected components.

    Parameters and results as for `dbscan_line`, with `samples` ``(N, D)``. Separate problems can be clustered in one
    call when they are moved apart.
    """
    size = len(samples)
    if size == 0:
        return np.empty(0, dtype=int)
    one, two = _near_pairs(samples, eps)
    if sample_weight is None and min_samples <= 1:
        return _components(one, two, size)
    mass = np.ones(size) if sample_weight is None else np.asarray(sample_weight, dtype=float)
    total = mass + np.bincount(one, mass[two], minlength=size) + np.bincount(two, mass[one], minlength=size)
    core = total >= min_samples - 1e-12 * max(total.max(), 1.0)
    labels = unlabelled(size)
    at = np.flatnonzero(core)
    if not len(at):
        return labels
    linked = core[one] & core[two]
    labels[at] = np.unique(_components(one[linked], two[linked], size)[at], return_inverse=True)[1]
    best = np.full(size, size)
    for border, neighbour in ((one, two), (two, one)):
        reached = core[neighbour] & ~core[border]
        np.minimum.at(best, border[reached], labels[neighbour[reached]])
    border = best < size
    labels[border] = best[border]
    return labels


def _near_pairs(samples, eps):
    """All pairs of samples at most `eps` apart: among those near along the first axis, or by a tree where these are many."""
    order = samples[:, 0].argsort()
    axes = samples[order].T.copy()
    end = axes[0].searchsorted(axes[0] + eps, 'right')
    if (end - np.arange(1, len(end) + 1)).sum() > _MANY * len(samples):
        return cKDTree(samples).query_pairs(eps, output_type='ndarray').T
    one, two = pairs_before(end)
    apart = axes.take(one, axis=1) - axes.take(two, axis=1)
    near = ((apart * apart).sum(axis=0) <= eps * eps).nonzero()[0]
    return order[one[near]], order[two[near]]


_MANY = 50
"""Of such pairs for each sample."""


def pairs_before(end):
    """All pairs ``i < j`` with j below ``end[i]``."""
    index = np.arange(len(end))
    count = end - index - 1
    first = index.repeat(count)
    return first, np.arange(1, len(first) + 1) + (index - count.cumsum() + count).repeat(count)


def _components(one, two, size):
    """Connected component of each of `size` nodes, from the edges ``one - two``; numbered by the first node of each."""
    least = np.arange(size)
    while True:
        a, b = least[one], least[two]
        if (a == b).all():
            break
        np.minimum.at(least, np.maximum(a, b), np.minimum(a, b))
        least = least[least]
    first = np.arange(size) == least
    return (first.cumsum() - 1)[least]


def _renumber(component, index):
    """Components numbered in the order of their least `index`."""
    least = np.full(component.max() + 1, index.max())
    np.minimum.at(least, component, index)
    rank = np.empty(len(least), dtype=int)
    rank[least.argsort()] = np.arange(len(least))
    return rank[component]


def without_gaps(labels):
    """Cluster numbers from 0, those that a cluster cut again has left empty closed up."""
    used = np.bincount(labels) > 0
    return labels if used.all() else (used.cumsum() - 1)[labels]


def k_distances(samples, k):
    """Sorted distances, largest first, from each sample to its k-th nearest neighbour (the k-dist graph).

    Parameters
    ----------
    samples : (N,) or (N, D) array
    k : int
        The sample itself is not counted; at most N - 1 is used.
    """
    samples = np.asarray(samples, dtype=float)
    k = min(k, len(samples) - 1)
    if k < 1:
        return np.zeros(len(samples))
    if samples.ndim == 1:
        x = np.sort(samples)
        size = len(x)
        padded = np.empty(size + 2 * k)
        padded[:k], padded[k:-k], padded[-k:] = -np.inf, x, np.inf
        nearest = np.full(size, np.inf)
        for before in range(k + 1):
            low = padded[k - before:k - before + size]
            high = padded[2 * k - before:2 * k - before + size]
            np.minimum(nearest, np.maximum(x - low, high - x), out=nearest)
    else:
        nearest = cKDTree(samples).query(samples, k=k + 1)[0][:, k]
    return np.sort(nearest)[::-1]


def knee(distances):
    """The distance at the bend of a k-dist graph: where the curve lies farthest below the chord of its ends."""
    size = len(distances)
    if size < 3 or distances[0] <= distances[-1]:
        return float(distances[-1]) if size else 0.0
    chord = distances[0] + np.arange(size) * ((distances[-1] - distances[0]) / (size - 1))
    return float(distances[(chord - distances).argmax()])
