# SPDX-License-Identifier: Apache-2.0
"""Transforms of a bag that do not change: those on the topic /tf_static, else on the topic /tf."""
from itertools import islice

import numpy as np

from ...core.geometry.mounting import Mounting, MountingError
from ..playback import RENAMED, topic_of_transforms
from ..poses import PoseError, matrix_of, pose_of_transform
from .reading import open_reader, safely

MOST = 1000
"""Number of messages on /tf that are read: a few seconds show which frames move."""
SAME = 1e-3
"""Elements of the matrices of a frame that does not move differ by less than this [m, rad]."""


def static_mounting(path, scans, base_frame, frame) -> Mounting | None:
    """Return the mounting of the lidar `frame`, with its `scans` on this topic of a bag; None if it is unknown.

    Raises a MountingError when the lidar is tilted too far, or as `static_matrix`.
    """
    matrix = static_matrix(path, scans, base_frame, frame)
    return None if matrix is None else Mounting.from_matrix(matrix)


def static_matrix(path, scans, base_frame, frame):
    """Return the matrix ``(4, 4)`` from the lidar `frame` to `base_frame`, as `static_mounting`, for any tilt.

    Where those on /tf_static do not connect both frames, those on /tf that do not change are used as well: older
    recordings have no /tf_static. Raises a MountingError when a transform between both frames is not valid, or was
    recorded with several values.
    """
    for parents, faults in _transforms(path, scans):
        base, laser = _chain(parents, base_frame), _chain(parents, frame)
        if base[0] == laser[0]:
            return np.linalg.inv(base[1]) @ laser[1]
        for root in (laser[0], base[0]):
            if root in faults:
                raise MountingError(faults[root])
    return None


def ancestors(path, scans, frame) -> list[str]:
    """Return the frames above the `frame` of the `scans` on a topic of a bag, its parent first."""
    *_, (parents, _) = _transforms(path, scans)
    found = [frame.strip('/')]
    while found[-1] in parents and parents[found[-1]][0] not in found:
        found.append(parents[found[-1]][0])
    return found[1:]


def _transforms(path, scans):
    """Yield frame -> (parent frame, ``(4, 4)`` matrix to its parent), and frame -> why it has no such transform.

    First of /tf_static, then of both topics.
    """
    with open_reader(path) as reader:
        static, faults = _transforms_on(reader, '/tf_static', scans)
        yield static, faults
        others, _ = _transforms_on(reader, '/tf', scans, MOST)
        yield others | static, faults


def _transforms_on(reader, name, scans, most=None):
    """Return the constant transforms on a topic, in its first messages up to the number `most`, and all other frames.

    These are a dictionary with the reasons.
    """
    topic = topic_of_transforms({c.topic: c.msgtype for c in reader.connections}, name, scans)
    connections = [c for c in reader.connections if c.topic == topic]
    messages = safely(reader, connections, lambda _: None) if connections else ()
    parents, faults = {}, {}
    for connection, _, raw in islice(messages, most):
        message = reader.deserialize(raw, RENAMED.get(connection.msgtype, connection.msgtype))
        for transform in message.transforms:
            frame, parent = transform.child_frame_id.strip('/'), transform.header.frame_id.strip('/')
            try:
                found = parent, matrix_of(*pose_of_transform(transform.transform))
            except PoseError as error:
                faults[frame] = f'the transform from {parent!r} to {frame!r} on {topic} is not valid: {error}'
                continue
            first = parents.setdefault(frame, found)
            if parent != first[0] or not np.allclose(first[1], found[1], atol=SAME):
                faults[frame] = (f'{topic} has different transforms of {frame!r}: from {_text(first)}, and from '
                                 f'{_text(found)}: expected one; are there two robots in the recording, or was the '
                                 'mounting changed?')
    return {frame: parents[frame] for frame in parents.keys() - faults.keys()}, faults


def _text(transform):
    """Return the parent frame and the translation [m] and yaw [deg] of a transform as text."""
    parent, matrix = transform
    (x, y, z), yaw = matrix[:3, 3], np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0]))
    return f'{parent!r} by ({x:.3f}, {y:.3f}, {z:.3f}) m and {yaw:.1f} deg'


def _chain(parents, frame):
    """Return the root of the transform tree above a `frame`, and the matrix ``(4, 4)`` from the frame to the root."""
    matrix, frame, seen = np.eye(4), frame.strip('/'), set()
    while frame in parents and frame not in seen:
        seen.add(frame)
        frame, step = parents[frame]
        matrix = step @ matrix
    return frame, matrix
