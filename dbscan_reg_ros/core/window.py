"""The local map: the last key frames, each with its own surface, and the alignment of a scan with all of them at once."""
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .alignment import kernel, normal_equations, origins
from .records import Features
from .se2 import SE2, wrap
from .symmetric import solve


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

    Parameters
    ----------
    surfaces : sequence of Surface
    origins, turns : (K, 1) complex arrays
        Where each lies in the odometry frame [m], and what turns places into its own.

    Attributes
    ----------
    normals, offsets : (N,) arrays
        Of all surfaces, as in `Surface`.
    """

    def __init__(self, surfaces, origins, turns):
        self._scale = turns / np.array([[s.cell] for s in surfaces])
        self._corner = origins * self._scale + np.array([[s.origin / s.cell] for s in surfaces])
        self._last = np.array([s.shape for s in surfaces]).T[:, :, None] - 1
        # The tables are large: they stay where they are.
        self._tables = [s.index for s in surfaces]
        size = np.array([len(s.normals) for s in surfaces])
        self._none, self._first = size[:, None] - 1, np.cumsum(size) - size
        self.normals, self.offsets = (np.concatenate([getattr(s, name) for s in surfaces]) for name in ('normals', 'offsets'))

    def nearest(self, places):
        """The points nearest to those of the `places` ``(K, P)`` (complex, [m], odometry frame) that have one, M of them.

        Returns
        -------
        at, row : (M,) int arrays
            Index of the place in the flattened table, and its row.
        nearest : (M,) int array
            Index of the point.
        """
        cells = places * self._scale
        cells -= self._corner
        cells, column = cells.real.astype(np.intp), cells.imag.astype(np.intp)
        for part, last in zip((cells, column), self._last):
            np.maximum(part, 0, out=part)
            np.minimum(part, last, out=part)
        cells *= self._last[1] + 1
        cells += column
        found = np.concatenate([table[cell] for table, cell in zip(self._tables, cells)]).reshape(cells.shape)
        at = (found != self._none).ravel().nonzero()[0]
        row = at // found.shape[1]
        return at, row, found.take(at) + self._first.take(row)


@dataclass(frozen=True, eq=False)
class Partners:
    """Points of a scan and the lines of the key frames that they lie on, M pairs of them.

    Attributes
    ----------
    points : (P,) complex [m]
        All points of the scan.
    index : (M,) int
        The point of each pair.
    normals : (M,) complex
        Unit normals of the lines in the odometry frame, conjugated.
    offsets : (M,) float [m]
        Distance of each line from the origin, along its normal.
    """

    points: np.ndarray
    index: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray

    def residuals(self, pose: SE2, scale):
        """As `alignment.residuals`, ``(1, M)`` each: of the scan at `pose`, in the odometry frame.

        Every point counts at most once, however many lines it lies on.
        """
        arms = (np.exp(1j * pose.theta) * self.points).take(self.index)
        error = (self.normals * (arms + complex(pose.x, pose.y))).real
        error -= self.offsets
        weight = kernel(error, scale)
        weight /= np.maximum(np.bincount(self.index, weight, len(self.points)), 1.0).take(self.index)
        return tuple(part[None] for part in (error, weight, self.normals, arms))

    def equations(self, pose: SE2, scale):
        """``(4, 4)``, as `alignment.normal_equations`, the rotation about the sensor."""
        return normal_equations(*self.residuals(pose, scale))[0]


class Window:
    """Key frames, latest last, and their surfaces; immutable.

    Parameters
    ----------
    frames : sequence of KeyFrame
    """

    def __init__(self, frames):
        self.frames = tuple(frames)
        poses = np.array([(frame.pose.x, frame.pose.y, frame.pose.theta) for frame in self.frames])
        self._origins, self._turns = origins(poses), np.exp(-1j * poses[:, 2:])
        self._stack = SurfaceStack([frame.features.surface for frame in self.frames], self._origins, self._turns)

    @property
    def latest(self):
        return self.frames[-1]

    def with_frame(self, frame, size):
        """A window of at most `size` key frames that ends with `frame`."""
        return Window((self.frames + (frame,))[-size:])

    def partners(self, pose: SE2, cloud, density) -> Partners:
        """The lines of all key frames that the points of a scan at `pose` lie on.

        Where a scan has more than `density.points`, they are dealt to the key frames in turn, each of them to several.
        """
        hands = max(min(len(self.frames) // _FRAMES_A_POINT, -(-len(cloud) // density.points)), 1)
        dealt = _dealt(len(cloud), len(self.frames), hands)
        turn = np.exp(1j * pose.theta)
        places = turn * cloud.points + complex(pose.x, pose.y)
        at, row, nearest = self._stack.nearest(places.take(dealt))
        index = dealt.take(at)
        normals = self._stack.normals.take(nearest) * self._turns.take(row)
        alike = (normals * (turn * cloud.normals).take(index)).real > density.facing
        row, index, nearest, normals = row[alike], index[alike], nearest[alike], normals[alike]
        return Partners(cloud.points, index, normals,
                        self._stack.offsets.take(nearest) + (normals * self._origins.take(row)).real)


_FRAMES_A_POINT = 3
"""Every point is looked up in at least so many key frames."""


@lru_cache(maxsize=4)
def _dealt(points, frames, hands):
    """``(frames, points // hands)`` numbers of the points that are looked up in each key frame."""
    return np.arange(points // hands * hands).reshape(-1, hands).T[np.arange(frames) % hands]


def align(partners: Partners, pose: SE2, expected: SE2, strength, scales, damping) -> SE2:
    """The pose of a scan after robust point-to-line iterations against all key frames, one for each of the `scales` [m].

    Parameters
    ----------
    partners : Partners
        Of the scan at `pose`.
    pose : SE2
        Where to start.
    expected : SE2
        The pose that a prior asks for.
    strength : (3, 3) array
        The prior's information in the odometry frame, in units of a point's.
    """
    for scale in scales:
        equations = partners.equations(pose, scale)
        equations[:3, :3] += strength
        equations[:3, 3] += strength @ (pose.x - expected.x, pose.y - expected.y, wrap(pose.theta - expected.theta))
        x, y, theta = solve(equations[None], damping)[0].tolist()
        pose = SE2(pose.x - x, pose.y - y, wrap(pose.theta - theta))
    return pose
