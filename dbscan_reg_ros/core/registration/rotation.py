# SPDX-License-Identifier: Apache-2.0
"""Rotation hypotheses: clusters of the angle differences between two sets of segments (section 2.2.1, Eq. 9)."""
import math
from dataclasses import dataclass

import numpy as np

from ..features.records import Segments
from ..geometry.se2 import wrap
from ..parameters.registration import RotationParameters
from .clustering import choose_clustering
from .dbscan import NOISE, k_distances, knee, unlabelled, without_gaps


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rotation hypotheses, K of them, heaviest first, and what they were made from.

    Attributes
    ----------
    phi : (K,) float [rad]
    weight : (K,) float [m]
        Weight of the samples in the cluster.
    difference : (n, m) float [rad]
        Angle differences between the reference's n and the current scan's m segments (Eq. 9).
    labels : (n, m) int
        Cluster of each difference, in the order of `phi`; -1 for none.
    eps : float [rad]
        Neighbourhood of DBSCAN that was used.
    """

    phi: np.ndarray
    weight: np.ndarray
    difference: np.ndarray
    labels: np.ndarray
    eps: float

    def near(self, angle, reach):
        """Those of the hypotheses at most `reach` [rad] from an `angle` [rad]."""
        chosen = np.abs(wrap(self.phi - angle)) <= reach
        rank = np.append(np.where(chosen, chosen.cumsum() - 1, NOISE), NOISE)
        return Rotations(self.phi[chosen], self.weight[chosen], self.difference, rank[self.labels], self.eps)


def estimate_rotations(reference: Segments, current: Segments, weights, parameters: RotationParameters) -> Rotations:
    """Cluster all angle differences (Eq. 9) with DBSCAN; the heaviest clusters are the hypotheses.

    Directed segments give differences unique modulo 2 pi. Clusters wider than `width` are chains of several motions
    and are clustered again with half the neighbourhood.
    """
    period = 2.0 * math.pi if parameters.directed else math.pi
    difference = reference.direction[:, None] - current.direction
    difference = wrap_period(difference, period)
    samples = difference.ravel()
    if not len(samples):
        return Rotations(np.empty(0), np.empty(0), difference, np.empty(difference.shape, dtype=int), parameters.eps)
    weights = weights.ravel()
    eps = parameters.eps or knee_eps(samples, parameters)
    labels, clustering = unlabelled(len(samples)), choose_clustering(parameters.clustering)
    todo, offset = np.arange(len(samples)), 0
    reach = eps
    for _ in range(parameters.recluster_levels + 1):
        found = clustering.dbscan_line(samples[todo], reach, parameters.min_samples, period=period)
        count = int(found.max(initial=NOISE)) + 1
        if not count:
            break
        kept = found != NOISE
        labels[todo[kept]] = found[kept] + offset
        todo, found = todo[kept], found[kept]
        if parameters.max_width <= 0.0:
            break
        anchor = np.empty(count)
        anchor[found] = samples[todo]
        spread = wrap_period(samples[todo] - anchor[found], period)
        low, high = np.zeros((2, count))
        np.minimum.at(low, found, spread)
        np.maximum.at(high, found, spread)
        wide = (high - low > parameters.max_width)[found]
        if not wide.any():
            break
        todo, offset, reach = todo[wide], offset + count, 0.5 * reach
    return _rank(samples, weights, labels, eps, difference.shape, period, parameters)


def pair_weights(reference, current, parameters):
    """``(n, m)`` weight of each pair: its shorter length, less where the directions are uncertain."""
    if not parameters.weighted:
        return np.ones((len(reference), len(current)))
    variance = reference.sigma_direction[:, None] ** 2 + current.sigma_direction ** 2
    shorter = np.minimum(reference.length[:, None], current.length)
    return shorter / (1.0 + variance / parameters.max_width ** 2) if parameters.max_width else shorter


def knee_eps(samples, parameters):
    """The neighbourhood from the knee of the k-dist graph, with ``k = MinPts - 1`` (at least 1), within its bounds."""
    bend = knee(k_distances(samples, max(parameters.min_samples - 1, 1)))
    return min(max(bend, parameters.eps_min), parameters.eps_max)


def wrap_period(angle, period):
    """Angle(s) less whole periods, at most half a period from 0."""
    return angle - period * np.rint(angle * (1.0 / period))


def _rank(samples, weights, labels, eps, shape, period, parameters):
    """Weighted mean and weight of each cluster, heaviest first, the best `hypotheses` of them."""
    at = (labels != NOISE).nonzero()[0]
    if not len(at):
        return Rotations(np.empty(0), np.empty(0), samples.reshape(shape), labels.reshape(shape), eps)
    index = without_gaps(labels[at])
    mass = np.bincount(index, weights[at])
    anchor = np.empty(len(mass))
    anchor[index] = samples[at]
    offset, weight = wrap_period(samples[at] - anchor[index], period), weights[at]
    if parameters.median_scale > 0.0:
        weight = weight / (1.0 + ((offset - _medians(offset, index)[index]) / parameters.median_scale) ** 2)
    mean = np.bincount(index, weight * offset) / np.bincount(index, weight)
    order = (-mass).argsort(kind='stable')[:parameters.max_hypotheses]
    rank = unlabelled(len(mass))
    rank[order] = np.arange(len(order))
    ranked = unlabelled(len(samples))
    ranked[at] = rank[index]
    return Rotations(wrap(anchor[order] + mean[order]), mass[order], samples.reshape(shape), ranked.reshape(shape), eps)


def _medians(values, group):
    """Median of the values of each group, groups numbered from 0."""
    ordered = values[np.lexsort((values, group))]
    count = np.bincount(group)
    first = np.cumsum(count) - count
    return 0.5 * (ordered[first + (count - 1) // 2] + ordered[first + count // 2])
