# SPDX-License-Identifier: Apache-2.0
"""Operations on many planar poses at once: arrays ``(N, 3)`` of x [m], y [m], theta [rad]."""
import math

import numpy as np

from ..core.errors import DbscanRegError
from ..core.geometry.se2 import wrap

FARTHEST = 1e9
"""Largest magnitude of a coordinate of a valid pose [m, rad]."""
CORRECTION = 1e-3
"""The laser's poses were corrected if they move by more than this [m, rad] relative to the robot's poses."""
NORM_TOLERANCE = 0.1
"""Largest deviation of the squared length of a quaternion from 1."""


class PoseError(DbscanRegError, ValueError):
    """The values of a pose or of a transform are not valid."""


def unit_quaternion(quaternion) -> tuple:
    """Return a quaternion (x, y, z, w) with the length 1; raise a PoseError if its own length differs too much."""
    squared = sum(value * value for value in quaternion)
    if not abs(squared - 1.0) < NORM_TOLERANCE:
        values = ', '.join(f'{value:g}' for value in quaternion)
        raise PoseError(f'the quaternion (x, y, z, w) is ({values}): expected one of length 1')
    return tuple(value / math.sqrt(squared) for value in quaternion)


def pose_of_transform(transform) -> tuple:
    """Return translation ``(3,)`` [m] and unit quaternion ``(4,)`` (x, y, z, w) of a Transform message.

    Raises a PoseError when its values are not valid.
    """
    t, q = transform.translation, transform.rotation
    quaternion = unit_quaternion((q.x, q.y, q.z, q.w))
    if not np.isfinite((t.x, t.y, t.z)).all():
        raise PoseError(f'the translation is ({t.x:g}, {t.y:g}, {t.z:g}): expected finite numbers')
    return np.array((t.x, t.y, t.z)), np.array(quaternion)


def matrix_of(translation, quaternion):
    """Return the matrix ``(4, 4)`` of a translation ``(3,)`` and a non-zero quaternion ``(4,)`` (x, y, z, w)."""
    x, y, z, w = (quaternion / math.sqrt(quaternion @ quaternion)).tolist()
    tx, ty, tz = translation.tolist()
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), tx],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), ty],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), tz],
        [0.0, 0.0, 0.0, 1.0]])


def planar(x, y, quaternion) -> tuple:
    """Return x, y [m] and the heading [rad], the direction of the x axis, of a pose with a `quaternion` (x, y, z, w).

    Raises a PoseError when the values are not those of a pose.
    """
    if not possible((x, y)):
        raise PoseError(f'the position is ({x:g}, {y:g}): expected finite numbers of at most {FARTHEST:g}')
    qx, qy, qz, qw = unit_quaternion(quaternion)
    return x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))


def repeated_stamps(stamps, poses) -> str:
    """Return a sentence about poses ``(N, 3)`` that repeat the stamp ``(N,)`` [ns] of another one; empty if none do."""
    order = np.argsort(stamps, kind='stable')
    stamps, poses = np.asarray(stamps)[order], np.asarray(poses)[order]
    repeated = (np.diff(stamps) == 0) & (np.abs(relative(poses[:-1], poses[1:])) > CORRECTION).any(axis=1)
    if not repeated.any():
        return ''
    return (f'{repeated.sum()} of {len(stamps)} poses have the stamp of another pose and differ from it, first at '
            f'{1e-9 * stamps[:-1][repeated][0]:.9f} s: expected a stamp for each pose, with all decimals; the first '
            'pose of each stamp is used')


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
