"""The local map: the last key frames, each with its own surface, and the alignment of a scan with all of them at once."""
from dataclasses import dataclass

import numpy as np

from . import alignment
from .records import Features
from .se2 import SE2, wrap


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """A scan that others are registered to.

    Attributes
    ----------
    features : Features
    pose : SE2
        In the odometry frame.
    covariance : (3, 3) array
        Of the pose, in the sensor's own frame.
    """

    features: Features
    pose: SE2
    covariance: np.ndarray


class SurfaceStack:
    """Several surfaces behind one another: row k of a table of places is looked up in surface k.

    It offers what a `Surface` offers to the alignment kernels.
    """

    def __init__(self, surfaces):
        self.origin_x, self.origin_y, self.inverse_cell, rows, columns = (
            np.array(values, dtype=float)[:, None]
            for values in zip(*((s.origin_x, s.origin_y, 1.0 / s.cell, s.rows, s.columns) for s in surfaces)))
        self.last_row, self.last_column, self.columns = rows - 1.0, columns - 1.0, columns.astype(np.intp)
        cells, points = np.array([(len(s.index), len(s.x)) for s in surfaces]).T
        self.first_cell, self.first_point = (np.cumsum(cells) - cells)[:, None], (np.cumsum(points) - points)[:, None]
        self.index = np.concatenate([s.index for s in surfaces])
        self.x, self.y, self.nx, self.ny = (
            np.concatenate([getattr(s, name) for s in surfaces]) for name in ('x', 'y', 'nx', 'ny'))

    def nearest(self, px, py):
        """Index of the point nearest to each place ``(K, ...)``."""
        cell = np.clip((px - self.origin_x) * self.inverse_cell, 0.0, self.last_row).astype(np.intp)
        cell *= self.columns
        cell += np.clip((py - self.origin_y) * self.inverse_cell, 0.0, self.last_column).astype(np.intp)
        cell += self.first_cell
        return self.index.take(cell) + self.first_point


class Window:
    """Key frames, latest last, and their surfaces; immutable.

    Parameters
    ----------
    frames : sequence of KeyFrame
    """

    def __init__(self, frames):
        self.frames = tuple(frames)
        self._stack = SurfaceStack([frame.features.surface for frame in self.frames])
        self._inverses = [frame.pose.inverse() for frame in self.frames]
        theta = np.array([[frame.pose.theta] for frame in self.frames])
        self._cos, self._sin = np.cos(theta), np.sin(theta)

    @property
    def latest(self):
        return self.frames[-1]

    def with_frame(self, frame, size):
        """A window of at most `size` key frames that ends with `frame`."""
        return Window((self.frames + (frame,))[-size:])

    def equations(self, pose: SE2, cloud, scale, density):
        """Point-to-line equations of a scan at `pose` with all key frames.

        Every point counts at most once, however many key frames it lies on.

        Returns
        -------
        information, gradient : (3, 3), (3,) arrays
            In the odometry frame, the rotation about the sensor, for a unit error of a point.
        square : float
            Mean squared error of the points that fit [m^2].
        """
        relative = np.array([(inverse @ pose).as_array() for inverse in self._inverses])
        error, weight, jx, jy, jt = alignment.residuals(relative, cloud, self._stack, scale, density)
        weight *= 1.0 / np.maximum(weight.sum(axis=0), 1.0)
        jacobian = np.stack((self._cos * jx - self._sin * jy, self._sin * jx + self._cos * jy, jt)).reshape(3, -1)
        weighted = jacobian * weight.ravel()
        return weighted @ jacobian.T, weighted @ error.ravel(), alignment.mean_square(error, weight)


def align(window: Window, pose: SE2, cloud, expected: SE2, strength, scales, density, damping):
    """Robust point-to-line iterations against all key frames, one for each of the `scales` [m].

    Parameters
    ----------
    pose : SE2
        Where to start.
    expected : SE2
        The pose that a prior asks for.
    strength : (3, 3) array
        The prior's information in the odometry frame, in units of a point's.

    Returns
    -------
    SE2
    """
    for scale in scales:
        information, gradient, _ = window.equations(pose, cloud, scale, density)
        off = np.array([pose.x - expected.x, pose.y - expected.y, wrap(pose.theta - expected.theta)])
        information += strength
        information[np.diag_indices(3)] += damping * (information[0, 0] + information[1, 1] + 1e-6)
        step = np.linalg.solve(information, gradient + strength @ off)
        pose = SE2(pose.x - step[0], pose.y - step[1], wrap(pose.theta - step[2]))
    return pose
