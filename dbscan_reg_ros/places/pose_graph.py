# SPDX-License-Identifier: Apache-2.0
"""Pose graphs: poses that agree best with relative measurements, and their export as a g2o file."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se2 import turned, wrap
from ..recordings.files import replacing
from ..recordings.poses import relative

ROBUST = 3.0
"""Scale of the robust kernel, in standard deviations of a residual."""
ROUNDS, CONVERGED = 100, 1e-6
"""Largest number of Gauss-Newton iterations, and the step [m, rad] below which the iterations end."""
HALVINGS = 10
"""Largest number of times that a step is halved until it lowers the sum of the errors."""


class Constraints(NamedTuple):
    """Measured motions between pairs of poses.

    Attributes
    ----------
    pairs : (E, 2) int
        Numbers of the two poses.
    motions : (E, 3) float [m, m, rad]
        The second pose in the frame of the first.
    covariances : (E, 3, 3) float
        Covariances of the motions, in the frame of the second pose.
    """

    pairs: NDArray[np.int64]
    motions: NDArray[np.float64]
    covariances: NDArray[np.float64]

    @property
    def loops(self) -> 'Constraints':
        """Those between poses that do not follow each other."""
        return Constraints(*(part[np.diff(self.pairs)[:, 0] != 1] for part in self))

    def covariances_in_first(self) -> NDArray[np.float64]:
        """``(E, 3, 3)``: the covariances of the components of `motions`, in the frame of the first pose."""
        return np.array([turned(covariance, theta) for covariance, theta
                         in zip(self.covariances, self.motions[:, 2], strict=True)]).reshape(-1, 3, 3)


class PoseGraph(NamedTuple):
    """Poses (K, 3) [m, m, rad] and the constraints between them."""

    poses: NDArray[np.float64]
    constraints: Constraints


def optimise(poses, constraints: Constraints):
    """Optimise a pose graph by robust Gauss-Newton with a line search (Lu and Milios 1997), with sparse matrices.

    Parameters
    ----------
    poses : (K, 3) array [m, m, rad]
        Initial values; the first pose is fixed.
    constraints : Constraints

    Returns
    -------
    (K, 3) array
    """
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import spsolve

    pairs, poses = constraints.pairs, poses.copy()
    root = np.linalg.inv(np.linalg.cholesky(constraints.covariances_in_first()))
    index = (3 * pairs[:, :, None] + np.arange(3)).reshape(-1, 6)
    entries = np.repeat(index, 6, axis=1).ravel(), np.tile(index, 6).ravel()
    held = diags(np.concatenate(([1e9] * 3, [1e-9] * (3 * len(poses) - 3))), format='csc')
    now, error, cost = _errors(poses, constraints, root)
    for _ in range(ROUNDS):
        weight = 1.0 / np.sqrt(1.0 + (error ** 2).sum(axis=1, keepdims=True) / ROBUST ** 2)
        c, s = np.cos(poses[pairs[:, 0], 2]), np.sin(poses[pairs[:, 0], 2])
        zero, one = np.zeros(len(pairs)), np.ones(len(pairs))
        jacobian = np.array([[-c, -s, now[:, 1], c, s, zero], [s, -c, -now[:, 0], -s, c, zero],
                             [zero, zero, -one, zero, zero, one]]).transpose(2, 0, 1)
        jacobian = weight[:, :, None] * (root @ jacobian)
        transposed = jacobian.transpose(0, 2, 1)
        gradient = np.bincount(index.ravel(), (transposed @ (weight * error)[:, :, None]).ravel(), 3 * len(poses))
        normal = coo_matrix(((transposed @ jacobian).ravel(), entries), held.shape).tocsc() + held
        step = -spsolve(normal, gradient, 'MMD_AT_PLUS_A').reshape(-1, 3)
        if np.abs(step).max() < CONVERGED:
            poses += step
            break
        before = cost
        for _ in range(HALVINGS):
            now, error, cost = _errors(poses + step, constraints, root)
            if cost < before:
                break
            step *= 0.5
        else:
            break
        poses += step
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def _errors(poses, constraints, root):
    """Return the motions of a graph (E, 3), their errors in standard deviations (E, 3), and the robust sum of these."""
    now = relative(*poses[constraints.pairs.T])
    error = now - constraints.motions
    error[:, 2] = wrap(error[:, 2])
    error = np.einsum('eij,ej->ei', root, error)
    return now, error, np.log1p((error ** 2).sum(axis=1) / ROBUST ** 2).sum()


def write_g2o(path, graph: PoseGraph):
    """Write a pose graph in the text format of g2o, ``VERTEX_SE2`` and ``EDGE_SE2``; the first pose is fixed.

    The information of an edge is the inverse of `Constraints.covariances_in_first`: the error of g2o is the difference
    of the components of the motion. Its order is xx, xy, xt, yy, yt, tt.
    """
    poses, constraints = graph
    information = np.linalg.inv(constraints.covariances_in_first())
    rows, columns = np.triu_indices(3)
    with replacing(path) as file:
        for number, pose in enumerate(poses):
            file.write(f'VERTEX_SE2 {number} {_numbers(pose)}\n')
        file.write('FIX 0\n')
        for (first, second), motion, terms in zip(*constraints[:2], information[:, rows, columns], strict=True):
            file.write(f'EDGE_SE2 {first} {second} {_numbers(motion)} {_numbers(terms)}\n')


def _numbers(values):
    """Return numbers as words that are read back unchanged."""
    return ' '.join(repr(float(value)) for value in values)
