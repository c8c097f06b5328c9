# SPDX-License-Identifier: Apache-2.0
"""Mounting of the lidar at the time of each scan."""
import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ParameterError
from ...core.geometry.mounting import Mounting, MountingError
from ...robot.parameters import mounting_from_parameters
from ...robot.sensors import LidarParameters
from ..throttled_log import ThrottledLog
from .transform_store import NoTransformError


class Transforms(Protocol):
    """Received transforms: `TransformListener`, or one of its stores."""

    def lookup(self, target: str, source: str, stamp: int) -> tuple[NDArray[np.float64], bool]:
        """Look up the transform from `source` to `target` at `stamp` [ns], as `TransformStore.lookup`."""


SAME = 1e-3
"""Mountings whose matrices differ by less than this [m, rad] are the same."""


class Mountings:
    """Finds the `Mounting` of each scan of one lidar, from the parameters or from transforms.

    The parameter ``mounting`` of the `lidar` selects the source. `transforms` are None if tf2_msgs is not installed;
    that is a ParameterError if ``mounting`` is tf.

    Attributes
    ----------
    change : str
        Warning that the mounting of the latest scan was sent again since the scan before; else empty.
    """

    def __init__(self, base_frame: str, lidar: LidarParameters, transforms: Transforms | None) -> None:
        self._base_frame = base_frame
        self._transforms = transforms
        self._last_stamp: int | None = None
        self._last: tuple[str, NDArray[np.float64]] | None = None
        self.change = ''
        self._fixed = mounting_from_parameters(lidar)
        if self._fixed is None and transforms is None:
            raise ParameterError("mounting = 'tf': needs tf2_msgs, which is not installed; install it, or choose "
                                 "'laser_pose' or 'none'")

    def ready(self, frame: str, stamp: int) -> bool:
        """Whether the mounting of the lidar `frame` at `stamp` [ns] is known, or no scan waits for it any more.

        If the mounting is unknown even at the stamp of the last scan, the transforms have stopped, and no scan waits.
        """
        if self._fixed or frame == self._base_frame or self._last_stamp is None:
            return True
        try:
            return self._is_known(frame, stamp) or not self._is_known(frame, self._last_stamp)
        except NoTransformError:
            return True

    def _is_known(self, frame: str, stamp: int) -> bool:
        assert self._transforms
        return self._transforms.lookup(self._base_frame, frame, stamp)[1]

    def find(self, frame: str, stamp: int, log: ThrottledLog) -> Mounting:
        """Return the mounting of the lidar `frame` at the known time nearest to `stamp` [ns]; `log` gets warnings.

        Raises a MountingError when the mounting is not known yet, or the lidar is tilted.
        """
        return self._fixed or Mounting.from_matrix(self.matrix(frame, stamp, log))

    def matrix(self, frame: str, stamp: int, log: ThrottledLog) -> NDArray[np.float64]:
        """Return the matrix ``(4, 4)`` from the lidar `frame` to the base frame, as `find`, for any tilt of the lidar.

        Raises a MountingError when it is not known yet.
        """
        if self._fixed or frame == self._base_frame:
            return (self._fixed or Mounting()).matrix
        assert self._transforms
        try:
            matrix, known = self._transforms.lookup(self._base_frame, frame, stamp)
        except NoTransformError as error:
            raise MountingError(
                f'no transform from {self._base_frame!r} to {frame!r} on /tf or /tf_static: no odometry before it is '
                f"received; {error}; publish it, or set mounting to 'laser_pose' (with laser_pose) or to 'none'"
            ) from None
        self.change = self._change(frame, matrix)
        self._last_stamp, self._last = stamp, (frame, matrix) if known else None
        if not known:
            log.warn(f'the transform from {self._base_frame!r} to {frame!r} is not known at the time of the '
                     'scan; using the transform of another time')
        return matrix

    def _change(self, frame: str, matrix: NDArray[np.float64]) -> str:
        """Return `change`: a mounting that was sent again, unlike one that moves, differs at the last scan, too."""
        if self._last is None or self._last[0] != frame or np.allclose(matrix, self._last[1], 0.0, SAME):
            return ''
        assert self._transforms and self._last_stamp is not None
        now, known = self._transforms.lookup(self._base_frame, frame, self._last_stamp)
        if not known or np.allclose(now, self._last[1], 0.0, SAME):
            return ''
        return (f'the transform from {self._base_frame!r} to {frame!r} was sent again with other values: '
                f'{_described(self._last[1])} became {_described(matrix)}; the odometry starts again at the last pose. '
                'If the lidar was not moved, look for a second sender of the transform')


def _described(matrix: NDArray[np.float64]) -> str:
    yaw = math.degrees(math.atan2(matrix[1, 0], matrix[0, 0]))
    return f'x {matrix[0, 3]:.3f} m, y {matrix[1, 3]:.3f} m, yaw {yaw:.1f} deg'
