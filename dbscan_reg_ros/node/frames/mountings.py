# SPDX-License-Identifier: Apache-2.0
"""Where the laser sits, for each scan."""
from ...core.errors import ParameterError
from ...core.geometry.mounting import Mounting, MountingError
from ...robot.mounting import mounting_from_parameters
from ...robot.parameters import NodeParameters
from .transform_store import NoTransformError


class Mountings:
    """Finds the `Mounting` of each scan as the parameter ``mounting`` says.

    Parameters
    ----------
    parameters : NodeParameters
    transforms : TransformListener or None
        None where tf2_msgs is not installed.
    notices : Notices

    Raises
    ------
    ParameterError
        When transforms are to be read and there are none.
    """

    def __init__(self, parameters: NodeParameters, transforms, notices):
        self._base_frame = parameters.base_frame
        self._transforms = transforms
        self._notices = notices
        self._last = None
        self._fixed = mounting_from_parameters(parameters)
        if self._fixed is None and transforms is None:
            raise ParameterError("mounting = 'tf': needs tf2_msgs, which is not installed; install it, or choose "
                                 "'laser_pose' or 'none'")

    def ready(self, frame, stamp) -> bool:
        """Whether waiting may tell no more of the mounting of the laser in `frame` at `stamp` [ns].

        A transform that does not reach as far as the last scan has gone quiet: nothing is expected of it.
        """
        if self._fixed or frame == self._base_frame or self._last is None:
            return True
        try:
            return self._knows(frame, stamp) or not self._knows(frame, self._last)
        except NoTransformError:
            return True

    def _knows(self, frame, stamp):
        return self._transforms.lookup(self._base_frame, frame, stamp)[1]

    def find(self, frame, stamp) -> Mounting:
        """The mounting of the laser whose scans are in `frame`, at `stamp` [ns] or else at a time that is known.

        Raises
        ------
        MountingError
            When it is not known yet, or the laser is tilted.
        """
        if self._fixed:
            return self._fixed
        if frame == self._base_frame:
            return Mounting()
        try:
            matrix, known = self._transforms.lookup(self._base_frame, frame, stamp)
        except NoTransformError:
            raise MountingError(
                f'no transform from {self._base_frame!r} to {frame!r} on /tf or /tf_static: no odometry before it is '
                "there; publish it, or set mounting to 'laser_pose' (with laser_pose) or to 'none'") from None
        self._last = stamp
        if not known:
            self._notices.warn(f'the transform from {self._base_frame!r} to {frame!r} is not known at the time of the scan; '
                               'taking that of another time')
        return Mounting.from_matrix(matrix)
