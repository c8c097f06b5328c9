"""From many hypotheses to few: how well each lays the current scan onto the reference (section 2.3).

The current scan's points are looked up in the density of the reference, the cross term of the K-L divergence (Eq. 19) as
a likelihood field; points in space that the other scan saw to be free count against a hypothesis.
"""
import numpy as np

from . import alignment
from .parameters import DensityParameters, SelectionParameters
from .records import Features
from .se2 import SE2, wrap
from .surface import Cloud


def sieve(candidates, reference: Features, current: Features, parameters: SelectionParameters, density: DensityParameters):
    """The hypotheses ``(C, 3)`` that fit the outline of the reference best, at most `refined` of them, best first.

    A table of candidates x beams: no surface is built for it.
    """
    cloud = current.cloud.thinned(parameters.sieve_points)
    view = reference.view
    px, py, _, _ = alignment.transform_points(candidates, cloud.x, cloud.y)
    bins = view.bins(px, py)
    near, far = view.near.take(bins), view.far.take(bins)
    radius = np.hypot(px, py)
    off = np.maximum(near - radius, radius - far)
    support = np.clip(1.0 - off / parameters.sieve_tolerance, 0.0, 1.0)
    support[near <= 0.0] = 0.0
    value = support.sum(axis=1)
    value -= density.violation * alignment.free_space_violation(radius, near, parameters.sieve_tolerance).sum(axis=1)
    return candidates[np.argsort(-value, kind='stable')[:parameters.refined]]


def score(candidates, reference: Features, cloud: Cloud, scale, parameters: DensityParameters):
    """How well each hypothesis ``(H, 3)`` explains the points of the current scan.

    Returns
    -------
    score : (H,) array
        Weighted share of the points on the reference's surfaces less the share in its free space; at most 1.
    overlap : (H,) array
        Plain share of the points on the reference's surfaces.
    """
    _, weight, _, _, _ = alignment.residuals(candidates, cloud, reference.surface, scale, parameters)
    px, py, _, _ = alignment.transform_points(candidates, cloud.x, cloud.y)
    near = reference.view.near.take(reference.view.bins(px, py))
    violation = alignment.free_space_violation(np.hypot(px, py), near, parameters.violation_tolerance)
    violation *= 1.0 - weight
    share = leverage(cloud, parameters.balance)
    return weight @ share - parameters.violation * (violation @ share), weight.mean(axis=1)


def reverse_violation(candidates, reference: Features, current: Features, parameters: DensityParameters):
    """Weighted share of the reference's points that lie in the current scan's free space, for each hypothesis."""
    cloud = reference.cloud
    inverse = np.array([SE2(*candidate).inverse().as_array() for candidate in candidates])
    px, py, _, _ = alignment.transform_points(inverse, cloud.x, cloud.y)
    near = current.view.near.take(current.view.bins(px, py))
    violation = alignment.free_space_violation(np.hypot(px, py), near, parameters.violation_tolerance)
    return violation @ leverage(cloud, parameters.balance)


def surprise(candidates, prior):
    """Squared Mahalanobis distance ``(H,)`` of each hypothesis from the prior, in the prior sensor's frame."""
    expected = prior.transform
    step = candidates - expected.as_array()
    c, s = np.cos(expected.theta), np.sin(expected.theta)
    error = np.stack((c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0], wrap(step[:, 2])), axis=1)
    return np.einsum('hi,hi->h', error, np.linalg.solve(prior.covariance, error.T).T)


def leverage(cloud, balance):
    """Weight ``(P,)`` of each point, in sum 1: more where few points face the same way.

    In a corridor the few points that face along it decide, not the hundreds on its walls. The weight is the statistical
    leverage of the point's normal, with `balance` as ridge: large values make all points equal.
    """
    size = len(cloud)
    if not size:
        return np.empty(0)
    nx, ny = cloud.nx, cloud.ny
    xx, xy, yy = nx @ nx / size + balance, nx @ ny / size, ny @ ny / size + balance
    weight = yy * nx * nx - 2.0 * xy * nx * ny + xx * ny * ny
    return weight / weight.sum()


def distinct(candidates, count, distance, angle):
    """Indices of the first `count` hypotheses that differ from all chosen before them."""
    chosen = []
    for i, candidate in enumerate(candidates):
        if not same(candidates[chosen], candidate, distance, angle).any():
            chosen.append(i)
            if len(chosen) == count:
                break
    return chosen


def same(candidates, one, distance, angle):
    """Which hypotheses ``(H, 3)`` lie within `distance` [m] and `angle` [rad] of `one` ``(3,)``."""
    near = np.hypot(candidates[:, 0] - one[0], candidates[:, 1] - one[1]) <= distance
    return near & (np.abs(wrap(candidates[:, 2] - one[2])) <= angle)
