# SPDX-License-Identifier: Apache-2.0
"""Transforms of a bag that do not change: those on the topic /tf_static, else on the topic /tf."""
from itertools import islice

import numpy as np

from ...core.geometry.mounting import Mounting
from ..playback import RENAMED, topic_of_transforms
from .reading import open_reader, safely

MOST = 1000
"""Number of messages on /tf that are read: a few seconds show which frames move."""
SAME = 1e-3
"""Elements of the matrices of a frame that does not move differ by less than this [m, rad]."""


def static_mounting(path, base_frame, frame) -> Mounting | None:
    """Return the mounting of the lidar `frame` from the transforms of a bag; None if it is unknown.

    Raises
    ------
    MountingError
        When the lidar is tilted too far.
    """
    matrix = static_matrix(path, base_frame, frame)
    return None if matrix is None else Mounting.from_matrix(matrix)


def static_matrix(path, base_frame, frame):
    """Return the matrix ``(4, 4)`` from the lidar `frame` to `base_frame`, as `static_mounting`, for any tilt.

    Where those on /tf_static do not connect both frames, those on /tf that do not change are used as well: older
    recordings have no /tf_static.
    """
    for parents in _transforms(path):
        base, laser = _chain(parents, base_frame), _chain(parents, frame)
        if base[0] == laser[0]:
            return np.linalg.inv(base[1]) @ laser[1]
    return None


def ancestors(path, frame) -> list[str]:
    """Return the frames above a `frame` in the transforms of a bag, its parent first."""
    *_, parents = _transforms(path)
    found = [frame.strip('/')]
    while found[-1] in parents and parents[found[-1]][0] not in found:
        found.append(parents[found[-1]][0])
    return found[1:]


def _transforms(path):
    """Yield frame -> (parent frame, ``(4, 4)`` matrix to its parent): of /tf_static, then of both topics."""
    with open_reader(path) as reader:
        static, _ = _transforms_on(reader, '/tf_static')
        yield static
        others, moving = _transforms_on(reader, '/tf', MOST)
        yield {frame: others[frame] for frame in others.keys() - moving} | static


def _transforms_on(reader, name, most=None):
    """Return the transforms on a topic, in its first messages up to the number `most`, and the frames that move.

    If there are several transforms of a frame, the last one is returned.
    """
    topic = topic_of_transforms({c.topic: c.msgtype for c in reader.connections}, name)
    connections = [c for c in reader.connections if c.topic == topic]
    messages = safely(reader, connections, lambda _: None) if connections else ()
    first, parents, moving = {}, {}, set()
    for connection, _, raw in islice(messages, most):
        message = reader.deserialize(raw, RENAMED.get(connection.msgtype, connection.msgtype))
        for transform in message.transforms:
            frame = transform.child_frame_id.strip('/')
            parents[frame] = transform.header.frame_id.strip('/'), _matrix(transform.transform)
            parent, matrix = first.setdefault(frame, parents[frame])
            if parent != parents[frame][0] or not np.allclose(matrix, parents[frame][1], atol=SAME):
                moving.add(frame)
    return parents, moving


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
