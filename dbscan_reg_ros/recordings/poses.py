# SPDX-License-Identifier: Apache-2.0
"""Poses by the thousand: the plane's motions on arrays ``(N, 3)`` of x [m], y [m], theta [rad]."""
import numpy as np

from ..core.geometry.se2 import wrap

FARTHEST = 1e9
"""No pose has a number beyond this [m, rad]."""
CORRECTION = 1e-3
"""The laser's poses were corrected if they move by more than this [m, rad] relative to the robot's."""


def possible(pose) -> bool:
    """Whether x [m], y [m], theta [rad] can be a pose."""
    return all(abs(value) <= FARTHEST for value in pose)


def relative(a, b):
    """Poses `b` in the frames of the poses `a`, both ``(N, 3)``: ``a^-1 b``."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.stack((c * dx + s * dy, c * dy - s * dx, wrap(b[:, 2] - a[:, 2])), axis=1)


def compose(a, b):
    """Poses `b`, given in the frames of the poses `a`, in the frame of the latter: ``a b``."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    return np.stack((a[:, 0] + c * b[:, 0] - s * b[:, 1],
                     a[:, 1] + s * b[:, 0] + c * b[:, 1],
                     wrap(a[:, 2] + b[:, 2])), axis=1)


def corrected(laser, robot) -> bool:
    """Whether the laser's poses ``(N, 3)`` were corrected: they do not simply move along with the robot's."""
    offset = relative(robot, laser)
    return bool(np.abs(relative(offset[:1].repeat(len(offset), axis=0), offset)).max() > CORRECTION)
