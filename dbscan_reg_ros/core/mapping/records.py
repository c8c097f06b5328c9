# SPDX-License-Identifier: Apache-2.0
"""From where a scan is aligned with the map, and what is known about its pose."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.se2 import SE2


class InitialAlignment(NamedTuple):
    """Pose of a scan from its registration to a single reference, from which the alignment with the map starts.

    Attributes
    ----------
    pose : SE2
        Pose of the scan in the odometry frame.
    direction : float or None [rad]
        Degenerate direction of the translation in the odometry frame; None if no direction is degenerate.
    rotation_unobservable : bool
        Whether the reference does not constrain the rotation.
    """

    pose: SE2
    direction: float | None = None
    rotation_unobservable: bool = False


class PosePrior(NamedTuple):
    """Gaussian prior of a pose.

    Attributes
    ----------
    pose : SE2
        Mean in the odometry frame.
    information : (3, 3) float
        Information (inverse covariance) for (x, y, theta); its frame and units are stated where it is used.
    """

    pose: SE2
    information: NDArray[np.float64]
