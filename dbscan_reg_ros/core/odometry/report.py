# SPDX-License-Identifier: Apache-2.0
"""Report of one step of the odometry."""
from typing import NamedTuple

from ..features.records import Features
from ..geometry.se2 import SE2
from ..mapping.key_frame import KeyFrame
from ..registration.records import Prior, Registration, Status
from ..sensor import FIRST, Sensor
from .models.stamps import ScanInterval
from .records import OdometryUpdate
from .state import TrackState


class ReportedStep(NamedTuple):
    """Values to report for one scan; `pose` is the pose of the first sensor, without heading correction."""

    pose: SE2
    interval: ScanInterval
    status: Status
    registration: Registration | None = None
    key_frame: KeyFrame | None = None
    is_key_frame: bool = False
    sensor: Sensor = FIRST
    joined: bool = False
    repeats: bool = False
    contradicted: Prior | None = None


def report(state: TrackState, features: Features, step: ReportedStep) -> OdometryUpdate:
    """Return the update with the published pose of a scan; variances of a lidar's resolution are added."""
    number, frame = state.output.number, step.key_frame
    pose, increment = state.output.publish(step.pose)
    return OdometryUpdate(
        stamp=features.measured.stamp, pose=pose, covariance=state.covariance.published(pose.theta),
        twist=state.motion.twist.copy(), twist_covariance=state.covariance.published_twist(state.motion.variance),
        interval=step.interval.length, increment=increment, status=step.status, registration=step.registration,
        features=features, reference=None if frame is None else frame.features,
        reference_pose=step.sensor.pose_at(pose) if frame is None else state.output.corrected(frame.pose),
        is_key_frame=step.is_key_frame, restarted=step.interval.reason,
        wheel_correction=state.wheels.matrix.copy(),
        number=number, reference_number=None if frame is None else frame.number, sensor=step.sensor,
        joined=step.joined, repeats=step.repeats,
        contradicted=None if step.contradicted is None else step.sensor.first_prior(step.contradicted).transform)


def report_waiting(state: TrackState, features: Features, sensor: Sensor, repeats: bool = False) -> OdometryUpdate:
    """Return the last pose again: a scan of the `sensor` was not used, for example because it `repeats` the last."""
    return report(state, features, ReportedStep(
        state.pose, ScanInterval(0.0, 0.0, 0.0), Status.OK, sensor=sensor, repeats=repeats))
