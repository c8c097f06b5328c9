# SPDX-License-Identifier: Apache-2.0
"""Mounting of the lidar, read from the parameters of the node."""
from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from .parameters import NodeParameters
from .sensors import LidarParameters


def mounting_from_parameters(parameters: NodeParameters | LidarParameters) -> Mounting | None:
    """Return the mounting that the parameters define; None if they contain ``mounting: tf``."""
    if parameters.mounting == 'tf':
        return None
    if parameters.mounting == 'none':
        return Mounting()
    return Mounting(SE2.from_array(parameters.laser_pose), parameters.upside_down)
