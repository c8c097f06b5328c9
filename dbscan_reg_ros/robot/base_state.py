# SPDX-License-Identifier: Apache-2.0
"""State of the robot's base, computed from the pose and twist of the lidar mounted on it."""
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2, lever_arm, turn_matrix, turned
from ..core.odometry.models.unobserved_motion import displacement_covariance
from ..core.odometry.records import OdometryUpdate
from ..core.parameters.tree import Parameters
from ..core.registration.records import Prior
from ..core.scan import SECOND
from .parameter_groups import NodePriorParameters

_IDENTITY = SE2()


@dataclass(frozen=True, eq=False)
class BaseState:
    """Pose and twist of the base at one scan."""

    stamp: int
    """Stamp of the scan [ns]."""
    pose: SE2
    """Pose of the base in the odometry frame."""
    covariance: NDArray[np.float64]
    """Covariance of `pose`, for (x, y, theta) in the odometry frame [m, m, rad] ``(3, 3)``."""
    twist: NDArray[np.float64]
    """Velocity (vx, vy, omega) of the base in its own frame [m/s, m/s, rad/s] ``(3,)``."""
    twist_covariance: NDArray[np.float64]
    """Covariance of `twist` ``(3, 3)``."""


@dataclass(frozen=True, eq=False)
class InitialPose:
    """Pose of the base when the odometry starts."""

    pose: SE2 = _IDENTITY
    """Pose in the odometry frame."""
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    """Covariance of `pose`, for (x, y, theta) in the odometry frame [m, m, rad] ``(3, 3)``."""


AT_ORIGIN = InitialPose()


def base_state(update: OdometryUpdate, origin: SE2, sensor_pose: SE2, initial: InitialPose = AT_ORIGIN) -> BaseState:
    """Compute the pose and twist of the base, with covariances, from those of the sensor.

    Parameters
    ----------
    update : OdometryUpdate
        Pose and twist of a sensor at `sensor_pose`.
    origin : SE2
        Pose of the sensor in the odometry frame when the odometry started.
    sensor_pose : SE2
        Pose of the sensor in the base frame at the time of the scan: `Mounting.aligned_pose`.
    initial : InitialPose
        Pose of the base when the odometry started.
    """
    sensor = origin @ update.pose
    pose = sensor @ sensor_pose.inverse()
    from_sensor = lever_arm(pose.x - sensor.x, pose.y - sensor.y) @ turn_matrix(origin.theta)
    from_initial = lever_arm(pose.x - initial.pose.x, pose.y - initial.pose.y)
    covariance = from_sensor @ update.covariance @ from_sensor.T + from_initial @ initial.covariance @ from_initial.T
    adjoint = sensor_pose.adjoint()
    return BaseState(update.stamp, pose, covariance, adjoint @ update.twist,
                     adjoint @ update.twist_covariance @ adjoint.T)


def predicted_state(state: BaseState, stamp: int, parameters: Parameters) -> BaseState:
    """Predict the state of the base at a `stamp` [ns] after that of a `state`, whose twist goes on.

    The covariances grow by that of the twist and by that of unknown accelerations.
    """
    time = (stamp - state.stamp) / SECOND
    vx, vy, omega = (state.twist * time).tolist()
    half = 0.5 * omega
    # The chord of the arc points into the mean direction and is shorter by sin(h) / h.
    chord = np.sinc(half / math.pi)
    step = SE2(0.0, 0.0, half) @ SE2(chord * vx, chord * vy, half)
    pose, back = state.pose @ step, step.inverse().adjoint()
    changed = displacement_covariance(time, parameters)
    moved = turned(time ** 2 * back @ state.twist_covariance @ back.T + changed, pose.theta)
    lever = lever_arm(pose.x - state.pose.x, pose.y - state.pose.y)
    return BaseState(stamp, pose, lever @ state.covariance @ lever.T + moved, state.twist,
                     state.twist_covariance + changed * (2.0 / time) ** 2)


def measured_prior(motion: SE2, parameters: NodePriorParameters) -> Prior:
    """Return the prior of a `motion` of the base that wheels have measured."""
    return Prior(motion, np.diag(parameters.wheel_sigma(motion)) ** 2)


def external_prior(driven: Prior | None, rotation: SE2 | None, predict: Callable[[], Prior | None],
                   parameters: NodePriorParameters) -> Prior | None:
    """Return the prior of the motion of the base from what was measured; None if nothing was.

    The `rotation` by the gyroscope is used in place of that of the wheels, with which the base was `driven`. Without
    wheels the translation is that of ``predict()``, the prediction of the motion model for the base.
    """
    if rotation is None:
        return driven
    base = driven or predict()
    return base and base.with_rotation(rotation.theta, parameters.wheel_sigma(rotation)[2])


def base_motion(prior: Prior, before: Mounting, after: Mounting) -> Prior:
    """Return the motion of the base that follows from a `prior` of a sensor; the covariance is not converted."""
    return replace(prior, transform=before.aligned_pose @ prior.transform @ after.aligned_pose.inverse())


def sensor_prior(base: Prior, before: Mounting, after: Mounting) -> Prior:
    """Return the prior of the motion of a sensor from that of the `base` between two scans.

    `before` and `after` are the mounting of the sensor on the base at either scan.
    """
    adjoint = after.aligned_pose.inverse().adjoint()
    return replace(base, transform=before.aligned_pose.inverse() @ base.transform @ after.aligned_pose,
                   covariance=adjoint @ base.covariance @ adjoint.T)
