# SPDX-License-Identifier: Apache-2.0
"""Rotation hypotheses: clusters of the angle differences between two sets of segments (section 2.2.1, Eq. 9)."""
import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..features.records import Segments
from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.se2 import wrap
from ..geometry.ties import order_up_to_rounding
from ..parameters.registration import RotationParameters
from .dbscan import NOISE, dbscan_line, k_distances, knee, recluster, unlabelled, without_gaps


@dataclass(frozen=True, eq=False)
class Rotations:
    """The K rotation hypotheses, those with the largest weight first, and their samples.

    Attributes
    ----------
    phi : (K,) float [rad]
    weight : (K,) float [m]
        Sum of the weights of the samples in each cluster.
    difference : (n, m) float [rad]
        Angle differences between the reference's n and the current scan's m segments (Eq. 9).
    labels : (n, m) int
        Cluster of each difference, in the order of `phi`; -1 for none.
    eps : float [rad]
        Neighbourhood radius with which DBSCAN ran.
    """

    phi: FloatArray
    weight: FloatArray
    difference: FloatArray
    labels: IntArray
    eps: float

    def near(self, angle: float, max_difference: float) -> 'Rotations':
        """Return the hypotheses at most `max_difference` [rad] from an `angle` [rad]."""
        chosen = [k for k, phi in enumerate(self.phi.tolist()) if abs(wrap(phi - angle)) <= max_difference]
        rank = unlabelled(len(self.phi) + 1)
        rank[chosen] = range(len(chosen))
        return Rotations(self.phi[chosen], self.weight[chosen], self.difference, rank[self.labels], self.eps)


def estimate_rotations(reference: Segments, current: Segments, weights: FloatArray,
                       parameters: RotationParameters) -> Rotations:
    """Cluster all angle differences (Eq. 9) with DBSCAN; the clusters with the largest weights become hypotheses.

    Segments have a direction, so the differences are unique modulo 2 pi. Clusters wider than `rotation.max_width`
    are chains of several rotations and are clustered again with half the neighbourhood.

    Parameters
    ----------
    reference, current : Segments
        The n segments of the reference and the m segments of the current scan.
    weights : (n, m) array
        Weight of each pair of segments, from `pair_weights`.
    parameters : RotationParameters
    """
    period = 2.0 * math.pi
    difference: FloatArray = wrap_period(reference.direction[:, None] - current.direction, period)
    samples = difference.ravel()
    eps = parameters.eps or (knee_eps(samples, parameters) if len(samples) else 0.0)
    labels = cluster_angles(samples, eps, period, parameters)
    clusters = _Clusters.of(samples, weights.ravel(), labels, period)
    order = order_up_to_rounding(-clusters.weight)[:parameters.max_hypotheses]
    rank = unlabelled(len(clusters.weight))
    rank[order] = np.arange(len(order))
    ranked = unlabelled(len(samples))
    ranked[clusters.members] = rank[clusters.index]
    phi = clusters.means()[order]
    return Rotations(phi, clusters.weight[order], difference, ranked.reshape(difference.shape), eps)


def cluster_angles(samples: FloatArray, eps: float, period: float, parameters: RotationParameters) -> IntArray:
    """Return the cluster ``(N,)`` of each angle [rad] on a circle of circumference `period`."""
    def cluster(chosen: IntArray, ratio: float) -> IntArray:
        return dbscan_line(samples[chosen], ratio * eps, parameters.min_samples, period=period)

    def is_chain(chosen: IntArray, found: IntArray) -> BoolArray:
        first = np.empty(found.max() + 1)
        first[found] = samples[chosen]
        offset = wrap_period(samples[chosen] - first[found], period)
        low, high = np.zeros((2, len(first)))
        np.minimum.at(low, found, offset)
        np.maximum.at(high, found, offset)
        chain: BoolArray = (high - low > parameters.max_width)[found]
        return chain

    return recluster(len(samples), cluster, is_chain if parameters.max_width > 0.0 else None)


def pair_weights(reference: Segments, current: Segments, parameters: RotationParameters) -> FloatArray:
    """Return the weight ``(n, m)`` of each pair: the shorter length [m], reduced if the directions are uncertain."""
    variance = reference.sigma_direction[:, None] ** 2 + current.sigma_direction ** 2
    shorter: FloatArray = np.minimum(reference.length[:, None], current.length)
    return shorter / (1.0 + variance / parameters.max_width ** 2) if parameters.max_width else shorter


def knee_eps(samples: FloatArray, parameters: RotationParameters) -> float:
    """Return eps [rad] from the knee of the k-dist graph (k = min_samples - 1, at least 1), clipped to its limits."""
    bend = knee(k_distances(samples, max(parameters.min_samples - 1, 1)))
    return float(min(max(bend, parameters.eps_min), parameters.eps_max))


Angle = TypeVar('Angle', float, FloatArray)


def wrap_period(angle: Angle, period: float) -> Angle:
    """Subtract whole periods from angle(s) [rad]; the result is at most half a period from 0."""
    wrapped: Angle = angle - period * np.rint(angle * (1.0 / period))
    return wrapped


@dataclass(frozen=True, eq=False)
class _Clusters:
    """Clusters of angles, C of them, and their A samples on a circle.

    Attributes
    ----------
    members : (A,) int
        Indices of the samples that belong to a cluster.
    index : (A,) int
        Cluster of each of these samples.
    first : (C,) float [rad]
        A sample of each cluster; offsets are relative to it.
    offset : (A,) float [rad]
    sample_weight : (A,) float
    weight : (C,) float
        Sum of the weights of the samples.
    """

    members: IntArray
    index: IntArray
    first: FloatArray
    offset: FloatArray
    sample_weight: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, samples: FloatArray, sample_weight: FloatArray, labels: IntArray, period: float) -> '_Clusters':
        """Return the clusters of angles [rad] on a circle of circumference `period`."""
        members = (labels != NOISE).nonzero()[0]
        index = without_gaps(labels[members])
        weight: FloatArray = np.bincount(index, sample_weight[members]).astype(float, copy=False)
        first = np.empty(len(weight))
        first[index] = samples[members]
        offset = wrap_period(samples[members] - first[index], period)
        return cls(members, index, first, offset, sample_weight[members], weight)

    def means(self) -> FloatArray:
        """Return the weighted mean [rad] of each cluster."""
        mean = np.bincount(self.index, self.sample_weight * self.offset) / self.weight
        wrapped: FloatArray = wrap(self.first + mean)
        return wrapped

