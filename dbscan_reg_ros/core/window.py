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
        self.origin = np.array([[s.origin] for s in surfaces])
        self.inverse_cell = np.array([[1.0 / s.cell] for s in surfaces])
        self.last = np.array([s.shape for s in surfaces]).T[:, :, None] - 1
        # The tables are large: they stay where they are.
        self.tables = [s.index for s in surfaces]
        self.first = np.cumsum([0] + [len(s.normals) for s in surfaces[:-1]])[:, None]
        self.normals, self.offsets = (np.concatenate([getattr(s, name) for s in surfaces]) for name in ('normals', 'offsets'))

    def nearest(self, places):
        """Index of the point nearest to each of the `places` ``(K, P)`` (complex, [m])."""
        at = (places - self.origin) * self.inverse_cell
        row, column = (np.clip(part.astype(np.intp), 0, last) for part, last in zip((at.real, at.imag), self.last))
        row *= self.last[1] + 1
        row += column
        found = np.concatenate([table[cells] for table, cells in zip(self.tables, row)])
        return found.reshape(row.shape) + self.first


class Window:
    """Key frames, latest last, and their surfaces; immutable.

    Parameters
    ----------
    frames : sequence of KeyFrame
    """

    def __init__(self, frames):
        self.frames = tuple(frames)
        self._stack = SurfaceStack([frame.features.surface for frame in self.frames])
        poses = np.array([frame.pose.as_array() for frame in self.frames])
        self._origins, self._headings = alignment.origins(poses), poses[:, 2:]
        self._turns = np.exp(-1j * self._headings)

    @property
    def latest(self):
        return self.frames[-1]

    def with_frame(self, frame, size):
        """A window of at most `size` key frames that ends with `frame`."""
        return Window((self.frames + (frame,))[-size:])

    def equations(self, pose: SE2, cloud, scale, density):
        """Point-to-line equations of a scan at `pose` with all key frames.

        Every point counts at most once, however many key frames it lies on. Where a scan has more than `density.points`,
        they are dealt to the key frames in turn, each of them to several.

        Returns
        -------
        (4, 4) array
            As `alignment.normal_equations`, in the odometry frame, the rotation about the sensor.
        """
        hands = max(min(len(self.frames) // _FRAMES_A_POINT, -(-len(cloud) // density.points)), 1)
        place = self._turns * (pose.x + 1j * pose.y - self._origins)
        relative = np.concatenate((place.real, place.imag, pose.theta - self._headings), axis=1)
        error, weight, normals, arms = alignment.residuals(relative, self._dealt(cloud, hands), self._stack, scale,
                                                           density.facing)
        for hand in (weight[k::hands] for k in range(hands)):
            hand *= 1.0 / np.maximum(hand.sum(axis=0), 1.0)
        arms *= self._turns.conj()
        normals *= self._turns
        return alignment.normal_equations(*(part.reshape(1, -1) for part in (error, weight, normals, arms)))[0]

    def _dealt(self, cloud, hands):
        """A `Cloud` of ``(K, P / hands)`` points: row k holds the hand ``k % hands``; what does not share out is left."""
        if hands == 1:
            return cloud
        each = np.arange(len(self.frames))[:, None] % hands + hands * np.arange(len(cloud) // hands)
        return cloud.select(each)


_FRAMES_A_POINT = 3
"""Every point is looked up in at least so many key frames."""


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
        equations = window.equations(pose, cloud, scale, density)
        information = equations[:3, :3]
        off = np.array([pose.x - expected.x, pose.y - expected.y, wrap(pose.theta - expected.theta)])
        information += strength
        information[np.diag_indices(3)] += damping * (information[0, 0] + information[1, 1] + 1e-6)
        step = np.linalg.solve(information, equations[:3, 3] + strength @ off)
        pose = SE2(pose.x - step[0], pose.y - step[1], wrap(pose.theta - step[2]))
    return pose
