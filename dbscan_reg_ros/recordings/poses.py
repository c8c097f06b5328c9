# SPDX-License-Identifier: Apache-2.0
"""Operations on many planar poses at once: arrays ``(N, 3)`` of x [m], y [m], theta [rad]."""
import numpy as np

from ..core.geometry.se2 import wrap

FARTHEST = 1e9
"""Largest magnitude of a coordinate of a valid pose [m, rad]."""
CORRECTION = 1e-3
"""The laser's poses were corrected if they move by more than this [m, rad] relative to the robot's poses."""


def possible(pose) -> bool:
    """Whether x [m], y [m], theta [rad] are a valid pose: finite and at most `FARTHEST`."""
    return all(abs(value) <= FARTHEST for value in pose)


def relative(a, b):
    """Return the poses `b` in the frames of the poses `a`: ``a^-1 b``; `a` and `b` are ``(N, 3)``."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.stack((c * dx + s * dy, c * dy - s * dx, wrap(b[:, 2] - a[:, 2])), axis=1)


def compose(a, b):
    """Transform the poses `b` from the frames of the poses `a` to the frame in which `a` is given: ``a b``."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    return np.stack((a[:, 0] + c * b[:, 0] - s * b[:, 1],
                     a[:, 1] + s * b[:, 0] + c * b[:, 1],
                     wrap(a[:, 2] + b[:, 2])), axis=1)


def corrected(laser, robot) -> bool:
    """Whether the laser's poses ``(N, 3)`` were corrected: their offset from the robot's poses is not constant."""
    offset = relative(robot, laser)
    return bool(np.abs(relative(offset[:1].repeat(len(offset), axis=0), offset)).max() > CORRECTION)
