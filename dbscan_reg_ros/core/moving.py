"""What moves: points of a scan in space that key frames saw to be free (people, doors, other robots)."""
import cmath

import numpy as np

from .alignment import origins
from .se2 import SE2
from .surface import Cloud, bins


def moving_points(cloud: Cloud, pose: SE2, frames, margin):
    """Which points of a scan stand well in front of what a key frame saw in their direction.

    Of a run of neighbours of which a good part does, all move. Where most of the scan would, the pose is wrong.

    Parameters
    ----------
    cloud : Cloud
        P points in beam order.
    pose : SE2
        Where the scan is expected, in the odometry frame.
    frames : sequence of KeyFrame
    margin : float [m]
        So far in front, and so far apart are neighbours of two runs.

    Returns
    -------
    (P,) bool array
    """
    poses = np.array([(frame.pose.x, frame.pose.y, frame.pose.theta) for frame in frames])
    places = cmath.exp(1j * pose.theta) * cloud.points + complex(pose.x, pose.y) - origins(poses)
    places *= np.exp(-1j * poses[:, 2:])
    nearby = [frame.features.view.nearby for frame in frames]
    size = np.array([[len(near)] for near in nearby])
    near = np.concatenate(nearby).take(size.cumsum(axis=0) - size + bins(places, size))
    moving = (near - np.abs(places) > margin).any(axis=0)
    if not moving.any():
        return moving
    run = np.concatenate(([0], (np.abs(np.diff(cloud.points)) > margin).cumsum()))
    share = np.bincount(run, moving) / np.bincount(run)
    moving |= share[run] > _GOOD_PART
    return moving if moving.mean() < _MOST else np.zeros_like(moving)


_GOOD_PART = 0.3
"""Of a run, so that all of it moves."""
_MOST = 0.4
"""Of a scan: where as much seems to move, the pose is wrong."""
