# SPDX-License-Identifier: Apache-2.0
"""The odometry of a replay: with the scans of several lidars and the recorded wheel odometry, as in the node."""
from ..core.geometry.se2 import SE2
from ..core.odometry.pipeline import Odometry
from ..core.sensor import FIRST
from ..robot.external_prior import measured_prior, sensor_prior
from ..robot.pose_history import PoseHistory
from .lidars import lidars_of
from .sensor_mounting import prepared
from .several_lidars.odometry_with_others import OdometryWithOthers
from .trajectory import Trajectory

WHEELS = 'odometry'
"""Value of ``prior.source`` with which a replay uses the recorded wheel odometry."""


def recorded_wheels(parameters, recording):
    """Return the wheel odometry of a `recording`; None if it has none or the `parameters` do not use it."""
    return recording.wheel_odometry() if parameters.prior.source == WHEELS else None


def replay_odometry(parameters, others, topic, mounting, wheels, bodies=None):
    """Return the odometry for the scans of the first lidar of a recording.

    Parameters
    ----------
    parameters : NodeParameters
    others : list of FurtherLidar
    topic : str
    mounting : Mounting
        Topic and mounting of the first lidar.
    wheels : (stamps, poses) or None
        From `recorded_wheels`.
    bodies : OwnBodies, optional
        Receives each scan.
    """
    odometry = Odometry(parameters.for_odometry())
    if bodies:
        odometry = bodies.watching(odometry)
    if wheels:
        odometry = OdometryWithWheels(odometry, wheels, mounting, parameters.prior)
    return OdometryWithOthers(odometry, others, topic, mounting, parameters) if others else odometry


def wheel_parameters(parameters) -> set[str]:
    """Return the full names of the parameters that the use of recorded wheels needs; none if they are not used."""
    if parameters.prior.source != WHEELS:
        return set()
    names = {each.name for each in parameters.describe()}
    return {name for name in names if name.removeprefix('advanced.').startswith('prior.')} - {'prior.frame'}


def describe_prior(parameters, wheels) -> list:
    """Return a line about the external prior, as (name, text) pairs; none if none is wanted."""
    if parameters.prior.source != WHEELS:
        return []
    return [('prior', 'the recorded wheel odometry' if wheels else 'none, as the recording has no wheel odometry')]


def replayed_trajectory(recording, scans, lidars, parameters) -> Trajectory:
    """Run the odometry over the `scans` of the first lidar of a `recording`, without writing results.

    Parameters
    ----------
    recording : Recording
        Recording with the topic of the first lidar.
    scans : iterable of Scan
    lidars : Lidars
    parameters : NodeParameters
    """
    mounting, others = lidars_of(recording, lidars, parameters)
    odometry = replay_odometry(parameters, others, recording.topic, mounting, recorded_wheels(parameters, recording))
    trajectory = Trajectory(mounting.pose.theta, mounting.upside_down, numbers=odometry.numbers if others else [])
    for _ in trajectory.follow(prepared(scans, mounting, parameters.input_of(recording.topic)), odometry):
        pass
    return trajectory


class OdometryWithWheels:
    """Odometry with recorded wheel odometry as the external prior of each scan.

    Parameters
    ----------
    odometry : Odometry
    wheels : (stamps, poses)
        Stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad] of the base.
    mounting : Mounting
        Mounting of the first lidar, of which the odometry estimates the pose.
    parameters : NodePriorParameters

    Attributes
    ----------
    comparisons : LidarComparisons
        Those of the `odometry`.
    """

    def __init__(self, odometry, wheels, mounting, parameters):
        self._odometry, self._mounting, self._parameters = odometry, mounting, parameters
        self._ahead = zip(wheels[0].tolist(), wheels[1].tolist(), strict=True)
        self._poses = PoseHistory()
        self._last: int | None = None
        self.comparisons = odometry.comparisons

    def process(self, scan, prior=None, sensor=FIRST):
        """Return the update for a scan; arguments, results and errors are those of `Odometry.process`."""
        update = self._odometry.process(scan, prior or self._prior(scan.stamp), sensor)
        if not update.waits:
            self._last = scan.stamp
        return update

    def _prior(self, stamp):
        """Return the motion of the first lidar since the last scan of any lidar; None where the wheels have no data."""
        while not self._poses.reaches(stamp) and (following := next(self._ahead, None)):
            self._poses.add(following[0], SE2(*following[1]))
        motion = None if self._last is None else self._poses.motion(self._last, stamp)
        return motion and sensor_prior(measured_prior(motion, self._parameters), self._mounting, self._mounting)
