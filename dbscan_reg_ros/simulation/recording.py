# SPDX-License-Identifier: Apache-2.0
"""Recordings of a simulated robot: lidar, wheel odometry, gyroscope and truth along one path."""
import heapq
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..core.errors import RecordingError
from ..core.scan import Scan
from ..recordings import interpolate
from ..recordings.conversion import bag_writer, check_target, write_log
from ..recordings.message_fields import header_fields, pose_fields, pose_only_fields, scan_fields
from ..recordings.playback import NOT_MEASURED
from ..recordings.recording import Record, Recording, StampedPoses
from .simulate import Simulation


class SimulatedRecording(Recording):
    """The scans and true poses of a `Simulation` as a recording."""

    topic = 'scan'

    def __init__(self, name: str, simulation: Simulation):
        super().__init__(name)
        self._simulation = simulation
        self.frame_id = simulation.lidar.frame_id
        self.count = len(simulation.scans)

    def scans(self) -> Iterator[Scan]:
        """Return an iterator over the simulated scans."""
        return iter(self._simulation.scans)

    def truth(self) -> StampedPoses:
        """Return stamps ``(N,)`` [ns] and true poses ``(N, 3)`` [m, m, rad] of the sensor in the world."""
        return self._simulation.stamps, self._simulation.truth


ODOMETRY = 'nav_msgs/msg/Odometry'
TOPICS = {'/scan': 'sensor_msgs/msg/LaserScan', '/wheel_odom': ODOMETRY, '/imu': 'sensor_msgs/msg/Imu',
          '/truth': ODOMETRY, '/tf_static': 'tf2_msgs/msg/TFMessage'}


@dataclass(frozen=True, eq=False)
class RobotRecording:
    """Sensor data that a simulated robot records along one path."""

    simulation: Simulation
    """The scans of the first lidar, and its true poses."""
    wheels: tuple
    """(stamps (N,) int64 [ns], poses (N, 3) float [m, m, rad]): wheel odometry of the robot, from `wheel_odometry`."""
    turning: tuple = field(default_factory=lambda: (np.empty(0, dtype=np.int64), np.empty(0)))
    """(stamps (N,) int64 [ns], rates (N,) [rad/s]): yaw rates of the gyroscope, from `yaw_rates`."""
    others: tuple = ()
    """tuple of Simulation: scans of further lidars on the same path, written to the topics ``/scan_2``, ``/scan_3`` and
    so on."""

    def write(self, target) -> Counter:
        """Write a CARMEN log (``NAME.log``, ``NAME.log.gz``) or a ROS 2 bag; return kind or topic -> message count.

        A bag has the true poses and twists of the first lidar on ``/truth`` and the mountings of all lidars on
        ``/tf_static``. In a log, the laser poses are the true poses and the robot poses are the wheel odometry; a log
        does not contain the gyroscope or further lidars. Raises a RecordingError when no recording can be written at
        `target`, see `check_simulated`.
        """
        target = Path(target)
        check_simulated(target)
        if target.name.endswith(('.log', '.log.gz')):
            return write_log(target, self._records())
        counts: Counter[str] = Counter()
        with bag_writer(target) as (writer, serialize):
            kinds = TOPICS | {f'/scan_{number}': TOPICS['/scan'] for number, _ in enumerate(self.others, 2)}
            added = {topic: writer.add_topic(topic, kind, latched=topic == '/tf_static')
                     for topic, kind in kinds.items()}
            for stamp, topic, fields in self._messages():
                writer.write(added[topic], stamp, serialize(kinds[topic], fields))
                counts[topic] += 1
        return counts

    def _records(self):
        """Yield each scan with the sensor's true pose and the robot's pose from wheel odometry."""
        stamps = self.simulation.stamps
        wheels = interpolate(*self.wheels, np.clip(stamps, self.wheels[0][0], self.wheels[0][-1]))
        for scan, truth, robot in zip(self.simulation.scans, self.simulation.truth, wheels, strict=True):
            yield Record(scan, tuple(truth), tuple(robot))

    def _messages(self):
        """Yield the messages of all topics as (stamp [ns], topic, fields) in order of time."""
        simulation, scans = self.simulation, self.simulation.scans
        first, lidars = scans[0].stamp, [each.lidar for each in (simulation, *self.others)]
        further = [[(scan.stamp, f'/scan_{number}', scan_fields(scan)) for scan in other.scans]
                   for number, other in enumerate(self.others, 2)]
        return heapq.merge(
            [(first, '/tf_static', {'transforms': [_mounting(first, lidar) for lidar in lidars]})],
            ((scan.stamp, '/scan', scan_fields(scan)) for scan in scans), *further,
            ((scan.stamp, '/truth', pose_only_fields(scan.stamp, scan.frame_id, pose, 'world', twist))
             for scan, pose, twist in zip(scans, simulation.truth, _twists(simulation), strict=True)),
            ((int(stamp), '/wheel_odom', pose_only_fields(stamp, 'base_link', pose))
             for stamp, pose in zip(*self.wheels, strict=True)),
            ((int(stamp), '/imu', _turning(stamp, rate)) for stamp, rate in zip(*self.turning, strict=True)),
            key=lambda message: message[0])


def check_simulated(target):
    """Raise RecordingError if `target` exists, cannot be written, or has the name of a ROS 1 bag."""
    check_target(target)
    if target.suffix == '.bag':
        raise RecordingError(f'{target}: expected NAME.log, NAME.log.gz, or the folder of a ROS 2 bag, a name without '
                             'ending; the command convert makes a ROS 1 bag from it')


def _twists(simulation):
    """Return the true twists (N, 3) of the lidar in its frame [m/s, m/s, rad/s], from each scan to its neighbours."""
    poses = simulation.truth
    if len(poses) == 1:
        return np.zeros_like(poses)
    vx, vy, omega = (np.gradient(values, 1e-9 * simulation.stamps) for values in (*poses[:, :2].T,
                                                                                  np.unwrap(poses[:, 2])))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.column_stack((c * vx + s * vy, c * vy - s * vx, omega))


def _turning(stamp, rate):
    unknown = np.array([NOT_MEASURED, *np.zeros(8)])
    return {'header': header_fields(stamp, 'imu'), 'angular_velocity': {'z': float(rate)},
            'orientation_covariance': unknown, 'linear_acceleration_covariance': unknown}


def _mounting(stamp, lidar):
    place = pose_fields(lidar.mounting.as_array())
    return {'header': header_fields(stamp, 'base_link'), 'child_frame_id': lidar.frame_id,
            'transform': {'translation': place['position'], 'rotation': place['orientation']}}
