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
ORDERING = 'MMD_AT_PLUS_A'
"""In which order the unknowns are eliminated: symmetric matrices fill up least."""
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
        c, s = np.cos(self.motions[:, 2]), np.sin(self.motions[:, 2])
        zero, one = np.zeros(len(c)), np.ones(len(c))
        turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
        return turn @ self.covariances @ turn.transpose(0, 2, 1)


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
    from scipy.sparse.linalg import spsolve

    poses = poses.copy()
    root = _root(constraints)
    now, error, cost = _errors(poses, constraints, root)
    for _ in range(ROUNDS):
        normal, gradient = _equations(poses, constraints.pairs, root, now, error)
        step = -spsolve(normal, gradient, ORDERING).reshape(-1, 3)
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


def relative_covariance(graph: PoseGraph, first: int, second: int):
    """Return the covariance (3, 3) of the pose `second` in that of the `first`, in the frame of the second.

    It is that of all constraints together, the marginal covariance, at the poses of the graph.
    """
    from scipy.sparse.linalg import splu

    poses, constraints = graph
    if first == second:
        return np.zeros((3, 3))
    root, pair = _root(constraints), np.array([[first, second]])
    now, error, _ = _errors(poses, constraints, root)
    normal, _ = _equations(poses, constraints.pairs, root, now, error)
    motion = relative(poses[[first]], poses[[second]])
    change = np.zeros((3, 3 * len(poses)))
    change[:, _index(pair)[0]] = _jacobian(poses, pair, motion)[0]
    found = change @ splu(normal, ORDERING).solve(change.T)
    return turned(0.5 * (found + found.T), -motion[0, 2])


def _root(constraints):
    """Return roots (E, 3, 3) of the information of the `constraints`."""
    return np.linalg.inv(np.linalg.cholesky(constraints.covariances_in_first()))


def _index(pairs):
    """Return the unknowns (E, 6) of the two poses of each of the `pairs` (E, 2)."""
    return (3 * pairs[:, :, None] + np.arange(3)).reshape(-1, 6)


def _jacobian(poses, pairs, motions):
    """Return the derivatives (E, 3, 6) of the `motions` (E, 3) between `pairs` by the coordinates of both poses."""
    c, s = np.cos(poses[pairs[:, 0], 2]), np.sin(poses[pairs[:, 0], 2])
    zero, one = np.zeros(len(pairs)), np.ones(len(pairs))
    return np.array([[-c, -s, motions[:, 1], c, s, zero], [s, -c, -motions[:, 0], -s, c, zero],
                     [zero, zero, -one, zero, zero, one]]).transpose(2, 0, 1)


def _equations(poses, pairs, root, motions, error):
    """Return the normal equations of a graph: a sparse matrix and the gradient; both are robust."""
    from scipy.sparse import coo_matrix, diags

    index = _index(pairs)
    entries = np.repeat(index, 6, axis=1).ravel(), np.tile(index, 6).ravel()
    weight = 1.0 / np.sqrt(1.0 + (error ** 2).sum(axis=1, keepdims=True) / ROBUST ** 2)
    jacobian = weight[:, :, None] * (root @ _jacobian(poses, pairs, motions))
    transposed = jacobian.transpose(0, 2, 1)
    gradient = np.bincount(index.ravel(), (transposed @ (weight * error)[:, :, None]).ravel(), 3 * len(poses))
    held = diags(np.concatenate(([1e9] * 3, [1e-9] * (3 * len(poses) - 3))), format='csc')
    return coo_matrix(((transposed @ jacobian).ravel(), entries), held.shape).tocsc() + held, gradient


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
