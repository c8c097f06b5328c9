# SPDX-License-Identifier: Apache-2.0
"""External priors of the motion of a sensor, from measured motions of the base."""
import numpy as np

from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.registration.records import Prior
from .parameter_groups import NodePriorParameters


def measured_prior(motion: SE2, parameters: NodePriorParameters) -> Prior:
    """Return the prior of a `motion` of the base that wheels have measured."""
    return Prior(motion, np.diag(parameters.wheel_sigma(motion)) ** 2)


def sensor_prior(base: Prior, before: Mounting, after: Mounting) -> Prior:
    """Return the prior of the motion of a sensor from that of the `base`.

    Parameters
    ----------
    base : Prior
        Motion of the base between two scans.
    before, after : Mounting
        Mounting of the sensor on the base at either scan.
    """
    adjoint = after.aligned_pose.inverse().adjoint()
    return Prior(before.aligned_pose.inverse() @ base.transform @ after.aligned_pose,
                 adjoint @ base.covariance @ adjoint.T, base.velocity_change)
