# SPDX-License-Identifier: Apache-2.0
"""Transforms on the topic /tf_static of a bag."""
import numpy as np

from ...core.geometry.mounting import Mounting
from ..playback import RENAMED, TRANSFORMS
from .reading import open_reader, safely

TOPIC = 'tf_static'


def static_mounting(path, base_frame, frame) -> Mounting | None:
    """Return the mounting of the lidar `frame` from the static transforms of a bag; None if it is unknown.

    Raises
    ------
    MountingError
        When the lidar is tilted too far.
    """
    matrix = static_matrix(path, base_frame, frame)
    return None if matrix is None else Mounting.from_matrix(matrix)


def static_matrix(path, base_frame, frame):
    """Return the matrix ``(4, 4)`` from the lidar `frame` to `base_frame`, as `static_mounting`, for any tilt."""
    parents = _transforms(path)
    base, laser = _chain(parents, base_frame), _chain(parents, frame)
    return np.linalg.inv(base[1]) @ laser[1] if base[0] == laser[0] else None


def _transforms(path) -> dict:
    """Return frame -> (parent frame, ``(4, 4)`` matrix from the frame to its parent) of all static transforms."""
    parents = {}
    with open_reader(path) as reader:
        connections = [c for c in reader.connections if c.topic.strip('/') == TOPIC
                       and RENAMED.get(c.msgtype, c.msgtype) == TRANSFORMS]
        for connection, _, raw in safely(reader, connections, lambda _: None) if connections else ():
            message = reader.deserialize(raw, RENAMED.get(connection.msgtype, connection.msgtype))
            for transform in message.transforms:
                parent = transform.header.frame_id.strip('/')
                parents[transform.child_frame_id.strip('/')] = parent, _matrix(transform.transform)
    return parents


def _chain(parents, frame):
    """Return the root of the transform tree above a `frame`, and the matrix ``(4, 4)`` from the frame to the root."""
    matrix, frame, seen = np.eye(4), frame.strip('/'), set()
    while frame in parents and frame not in seen:
        seen.add(frame)
        frame, step = parents[frame]
        matrix = step @ matrix
    return frame, matrix


def _matrix(transform):
    """Return the matrix ``(4, 4)`` of the `translation` and the unit quaternion of a transform."""
    q, t = transform.rotation, transform.translation
    x, y, z, w = np.array((q.x, q.y, q.z, q.w)) / max(np.linalg.norm((q.x, q.y, q.z, q.w)), 1e-12)
    matrix = np.eye(4)
    matrix[:3, :3] = ((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                      (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                      (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)))
    matrix[:3, 3] = t.x, t.y, t.z
    return matrix
