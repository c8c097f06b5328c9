# SPDX-License-Identifier: Apache-2.0
"""DBSCAN, faster than scikit-learn's on small sets and with the same labels; the k-dist graph.

Ester, Kriegel, Sander, Xu: "A density-based algorithm for discovering clusters in large spatial databases with noise",
KDD 1996.
"""
from collections.abc import Callable

import numpy as np

from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.ties import first_largest
from ..geometry.tolerance import TINY

NOISE = -1


def unlabelled(size: int) -> IntArray:
    """Return `size` labels, all `NOISE`."""
    labels: IntArray = np.empty(size, dtype=int)
    labels.fill(NOISE)
    return labels


def dbscan_line(samples: FloatArray, eps: float, min_samples: float, sample_weight: FloatArray | None = None,
                period: float | None = None) -> IntArray:
    """Cluster numbers on a line or a circle: sort them, count neighbours by bisection, and cut at the gaps.

    Parameters
    ----------
    samples : (N,) array
        Numbers to cluster; with a `period` they must lie within one period.
    eps : float
        Neighbours lie at most this far apart.
    min_samples : float
        A sample whose neighbours, itself included, have at least this weight is a core sample.
    sample_weight : (N,) array, optional
        Weight of each sample; by default 1.
    period : float, optional

    Returns
    -------
    (N,) int array
        Cluster of each sample, or `NOISE`. Clusters are numbered in the order of their first core samples. A border
        sample belongs to the first cluster that has a core sample within `eps` of it.
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
    core = total[right] - total[left] >= min_samples - TINY * total[-1]
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


def _chains(x: FloatArray, index: IntArray, eps: float, period: float | None) -> IntArray:
    """Split the sorted `x` at gaps above `eps`; return the chain of each value, numbered in order of least `index`."""
    chain: IntArray = np.zeros(len(x), dtype=int)
    (x[1:] - x[:-1] > eps).cumsum(out=chain[1:])
    if period is not None and chain[-1] > 0 and x[0] + period - x[-1] <= eps:
        chain[chain == chain[-1]] = 0
    return _renumber(chain, index)


def _neighbour_range(x: FloatArray, eps: float, period: float | None) -> tuple[IntArray, IntArray]:
    """Return the index range ``[left, right)`` of each sorted value's neighbours; on a circle over three periods."""
    if period is None:
        return np.searchsorted(x, x - eps), np.searchsorted(x, x + eps, 'right')
    laps = np.concatenate((x - period, x, x + period))
    size = len(x)
    left, right = np.searchsorted(laps, x - eps), np.searchsorted(laps, x + eps, 'right')
    middle = np.arange(size, 2 * size)
    return np.maximum(left, middle - size + 1), np.minimum(right, np.maximum(left, middle - size + 1) + size)


def dbscan_plane(samples: FloatArray, eps: float, min_samples: float,
                 sample_weight: FloatArray | None = None) -> IntArray:
    """Cluster points: find pairs of neighbours, and take the connected components as clusters.

    Parameters and results as for `dbscan_line`, with `samples` ``(N, D)``. Separate sets can be clustered in one call
    when they are moved apart.
    """
    size = len(samples)
    if size == 0:
        return np.empty(0, dtype=int)
    one, two = _near_pairs(samples, eps)
    if sample_weight is None and min_samples <= 1:
        return _components(one, two, size)
    mass = np.ones(size) if sample_weight is None else np.asarray(sample_weight, dtype=float)
    total = mass + np.bincount(one, mass[two], minlength=size) + np.bincount(two, mass[one], minlength=size)
    core = total >= min_samples - TINY * max(total.max(), 1.0)
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
    reached_by_any = best < size
    labels[reached_by_any] = best[reached_by_any]
    return labels


def _near_pairs(samples: FloatArray, eps: float) -> tuple[IntArray, IntArray]:
    """Find all pairs of samples at most `eps` apart by sorting the first axis, or with a k-d tree if that is slow."""
    order = samples[:, 0].argsort()
    axes = samples[order].T.copy()
    end = axes[0].searchsorted(axes[0] + eps, 'right')
    if (end - np.arange(1, len(end) + 1)).sum() > _MANY * len(samples):
        from scipy.spatial import cKDTree
        first, second = cKDTree(samples).query_pairs(eps, output_type='ndarray').T
        return first, second
    one, two = pairs_before(end)
    apart = axes.take(one, axis=1) - axes.take(two, axis=1)
    near = ((apart * apart).sum(axis=0) <= eps * eps).nonzero()[0]
    return order[one[near]], order[two[near]]


_MANY = 50
"""If more pairs per sample than this are close along the first axis, the tree is faster."""


def pairs_before(end: IntArray) -> tuple[IntArray, IntArray]:
    """Return all pairs ``i < j`` with j below ``end[i]``."""
    index = np.arange(len(end))
    count = end - index - 1
    first = index.repeat(count)
    return first, np.arange(1, len(first) + 1) + (index - count.cumsum() + count).repeat(count)


def _components(one: IntArray, two: IntArray, size: int) -> IntArray:
    """Return the connected component of each of `size` nodes with edges ``one - two``, numbered by its first node."""
    least: IntArray = np.arange(size)
    while True:
        a, b = least[one], least[two]
        if (a == b).all():
            break
        np.minimum.at(least, np.maximum(a, b), np.minimum(a, b))
        least = least[least]
    first = np.arange(size) == least
    component: IntArray = (first.cumsum() - 1)[least]
    return component


def _renumber(component: IntArray, index: IntArray) -> IntArray:
    """Renumber the components in the order of their least `index`."""
    least = np.full(component.max() + 1, index.max())
    np.minimum.at(least, component, index)
    rank = np.empty(len(least), dtype=int)
    rank[least.argsort()] = np.arange(len(least))
    renumbered: IntArray = rank[component]
    return renumbered


def recluster(size: int, cluster: Callable[[IntArray, float], IntArray],
              is_chain: Callable[[IntArray, IntArray], BoolArray] | None) -> IntArray:
    """Cluster samples; clusters that are chains are clustered again with half the neighbourhood radius.

    Parameters
    ----------
    size : int
        Number of samples.
    cluster : callable
        Function that returns the labels of chosen samples (indices), clustered with a ratio of the full radius.
    is_chain : callable or None
        Function that returns, from indices and labels of samples, which belong to a chain; None if chains are kept.

    Returns
    -------
    (size,) int array
        Cluster of each sample, or `NOISE`. Labels of clusters that were split again do not occur.
    """
    labels = cluster(np.arange(size), 1.0)
    chosen = (labels != NOISE).nonzero()[0]
    if is_chain is None or not len(chosen):
        return labels
    chain = chosen[is_chain(chosen, labels[chosen])]
    if len(chain):
        found = cluster(chain, 0.5)
        labels[chain] = np.where(found == NOISE, NOISE, found + labels.max() + 1)
    return labels


def without_gaps(labels: IntArray) -> IntArray:
    """Renumber clusters so that all numbers from 0 are used."""
    used = np.bincount(labels) > 0
    renumbered: IntArray = labels if used.all() else (used.cumsum() - 1)[labels]
    return renumbered


def k_distances(samples: FloatArray, k: int) -> FloatArray:
    """Return the k-dist graph: the distance of each sample to its k-th nearest neighbour, largest first.

    Parameters
    ----------
    samples : (N,) or (N, D) array
    k : int
        Rank of the neighbour, without the sample itself; values above N - 1 count as N - 1.
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
        from scipy.spatial import cKDTree
        nearest = cKDTree(samples).query(samples, k=k + 1)[0][:, k]
    return np.sort(nearest)[::-1]


def knee(distances: FloatArray) -> float:
    """Return the distance at the knee of a k-dist graph: where it lies farthest below the chord between its ends."""
    size = len(distances)
    if size < _FEWEST_FOR_KNEE or distances[0] <= distances[-1]:
        return float(distances[-1]) if size else 0.0
    chord = distances[0] + np.arange(size) * ((distances[-1] - distances[0]) / (size - 1))
    return float(distances[first_largest(chord - distances)])


_FEWEST_FOR_KNEE = 3
"""A graph with fewer distances has no knee: two distances always lie on their chord."""
