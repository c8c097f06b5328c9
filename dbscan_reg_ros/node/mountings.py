"""The three ways to know where the laser sits on the base."""
from rclpy.node import Node

from ..core.errors import ParameterError
from ..core.se2 import SE2
from .mounting import Mounting
from .parameters import NodeParameters
from .transforms import StaticTransforms, transform_type


class Mountings:
    """Finds the `Mounting` of each scan as the parameter ``mounting`` says.

    Parameters
    ----------
    node : rclpy.node.Node
    parameters : NodeParameters

    Raises
    ------
    ParameterError
        When transforms are to be read and tf2_msgs is not installed.
    """

    def __init__(self, node: Node, parameters: NodeParameters):
        self._base_frame = parameters.base_frame
        self._fixed = {
            'none': Mounting(),
            'laser_pose': Mounting(SE2.from_array(parameters.laser_pose), parameters.upside_down),
        }.get(parameters.mounting)
        if self._fixed is None:
            if transform_type() is None:
                raise ParameterError("mounting = 'tf': needs tf2_msgs, which is not installed; install it, or choose "
                                     "'laser_pose' or 'none'")
            self._transforms = StaticTransforms(node)

    def find(self, frame) -> Mounting:
        """The mounting of the laser whose scans are in `frame`.

        Raises
        ------
        MountingError
            When it is not known yet, or the laser is tilted.
        """
        if self._fixed:
            return self._fixed
        if frame == self._base_frame:
            return Mounting()
        return Mounting.from_matrix(self._transforms.lookup(self._base_frame, frame))
