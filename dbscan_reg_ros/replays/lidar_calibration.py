# SPDX-License-Identifier: Apache-2.0
"""Calibration of the lidars of a recording: mounting and time offset of each relative to the first."""
import math
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import DbscanRegError, ScanError
from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.odometry.calibration.compared_lidar import ComparedLidar
from ..core.odometry.calibration.comparisons import LidarComparisons
from ..core.odometry.calibration.relative_pose import Disagreement, difference
from ..core.odometry.pipeline import Odometry
from .lidars import prepared
from .odometry import ReplayOdometry

NOT_OBSERVABLE = 'not observable'
NAMES = 'x', 'y', 'yaw', 'time offset'
UNITS = 'm', 'm', 'deg', 's'
DIGITS = 4, 4, 3, 4
_MOST = 10_000
"""Number of the last scans of a lidar that the estimate uses."""
_EVERY, _FEWEST = 5, 8
"""One scan of so many is registered without a guess, and least number of those that have to agree."""
_NEAR = 0.3, math.radians(8.0)
"""Differences of mountings [m, rad] within which a location that begins with one of them finds the other."""


class CalibrationError(DbscanRegError):
    """A recording does not allow a calibration."""


@dataclass(frozen=True, eq=False)
class CalibratedLidar:
    """Mounting and time offset of a lidar, so that it agrees with the first one."""

    topic: str
    frame_id: str
    first: Mounting
    """Mounting of the first lidar, which counts as right."""
    given: Mounting
    """Mounting as given or recorded."""
    mounting: Mounting
    """Mounting by the scans."""
    given_offset: float
    """``input.time_offset`` of this lidar as given [s]."""
    time_offset: float
    """Value for ``input.time_offset`` of this lidar [s]."""
    sigmas: np.ndarray
    """Standard deviations of x, y [m] and yaw [rad] of `mounting`, and of `time_offset` [s] ``(4,)``."""
    observable: np.ndarray
    """Whether the drive determines each of them ``(4,)`` bool."""
    scans: int
    """Number of its scans that were compared with the map of the first lidar."""
    driven: float
    turned: float
    """Distance [m] and rotation [rad] over which they were compared."""
    error: Disagreement
    """By how much the given values differ, by more than 1 cm, 0.3 deg or 10 ms and two standard deviations."""

    def values(self) -> list:
        """Return (name, value, standard deviation, unit) of each result, with angles in deg; value None: unknown."""
        x, y, yaw = self.mounting.pose.as_tuple()
        scale = np.array([1.0, 1.0, math.degrees(1.0), 1.0])
        return [(name, float(value) if observable else None, float(sigma), unit)
                for name, value, sigma, observable, unit in zip(
                    NAMES, np.array([x, y, yaw, self.time_offset]) * scale, self.sigmas * scale, self.observable, UNITS,
                    strict=True)]

    def lines(self, base_frame) -> list:
        """Return the results as (name, text) pairs; the last one is a URDF joint."""
        rotations = f'{math.degrees(self.turned):.0f} deg'
        lines = [('lidar', f'{self.topic}: {self.scans} scans compared over {self.driven:.1f} m and {rotations}')]
        given = [*self.given.pose.as_tuple()[:2], math.degrees(self.given.pose.theta), self.given_offset]
        for (name, value, sigma, unit), before, digits in zip(self.values(), given, DIGITS, strict=True):
            if value is None:
                lines.append((name, NOT_OBSERVABLE))
                continue
            lines.append((name, f'{value:.{digits}f} {unit} +- {sigma:.{digits}f} {unit}, '
                          f'{_change(value - before, unit):+.{digits}f} from the given {before:.{digits}f}'))
        relative = self.first.pose.inverse() @ self.mounting.pose
        lines.append(('relative', f'{relative.brief()} in the frame of the first lidar'))
        lines.append(('verdict', f'{self.error}: set the values above' if any(self.error) else
                      'the given values fit: nothing to change'))
        return [*lines, ('joint', self.joint(base_frame))]

    def joint(self, base_frame) -> str:
        """Return the mounting as a joint of a URDF file, without its unknown height."""
        x, y, yaw = self.mounting.pose.as_tuple()
        roll = f'{math.pi:.6f}' if self.mounting.upside_down else '0'
        return (f'<joint name="{self.frame_id}_joint" type="fixed">\n'
                f'  <parent link="{base_frame}"/>\n  <child link="{self.frame_id}"/>\n'
                f'  <origin xyz="{x:.4f} {y:.4f} 0" rpy="{roll} 0 {yaw:.6f}"/>  <!-- z is not measured -->\n</joint>')

    def measures(self, base_frame) -> dict:
        """Return the results for a JSON file; null where a result is not observable."""
        results = {name.replace(' ', '_'): {'value': value, 'sigma': sigma if value is not None else None, 'unit': unit}
                   for name, value, sigma, unit in self.values()}
        return {'topic': self.topic, 'frame': self.frame_id, 'base_frame': base_frame, **results,
                'scans': self.scans, 'driven_m': self.driven, 'turned_deg': math.degrees(self.turned),
                'joint': self.joint(base_frame)}


def _change(difference, unit):
    """Return a difference, wrapped to a half turn if its `unit` is deg."""
    return math.remainder(difference, 360.0) if unit == 'deg' else difference


def calibrate_lidars(recording, mounting, others, parameters, progress=iter) -> list:
    """Compare further lidars with the map of the first one over a recording; return a `CalibratedLidar` for each.

    `mounting` is that of the first lidar, on whose topic the `recording` is; it counts as right. Those of the `others`
    (`RecordedLidar`) may be far off. `progress` passes on the scans of the first lidar. Raises a CalibrationError when
    too few scans of a lidar could be compared, or a further lidar has point clouds.
    """
    for other in others:
        if other.recording.mounting:
            raise CalibrationError(f'{other.recording.path}: {other.recording.topic} has point clouds; expected laser '
                                   'scans: only the first lidar may have point clouds')
    comparisons = _compared(recording, mounting, others, parameters, progress)
    guessed = [_moved(other, mounting, comparisons.far_off(other.recording.topic)) for other in others]
    if guessed != others:
        comparisons = _compared(recording, mounting, guessed, parameters, progress)
    return [_calibrated(comparisons.lidars.get(other.recording.topic), other, given, mounting,
                        parameters.input_of(other.recording.topic).time_offset[0])
            for other, given in zip(guessed, others, strict=True)]


class _Comparisons(LidarComparisons):
    """Comparisons that use no further lidar, and register some of its scans without a guess, too."""

    def __init__(self) -> None:
        super().__init__(spacing=0.0, only=True, most=_MOST)
        self._found: defaultdict[str, list[SE2]] = defaultdict(list)
        self._count = 0

    def add(self, update, locate):
        """Add the `update` of a scan."""
        super().add(update, locate)
        if update.sensor.rank:
            self._count += 1
            location = locate(update, guess=False) if not self._count % _EVERY else None
            if location:
                self._found[update.sensor.name].append(update.pose.inverse() @ location.pose)

    def far_off(self, topic) -> SE2 | None:
        """Return the mounting of a lidar that most of its scans show, if the given one is far from it."""
        found = self._found[topic]
        near = max(([other for other in found if _is_near(each, other)] for each in found), key=len, default=[])
        if len(near) <= max(_FEWEST, len(found) // 2) or _is_near(self.lidars[topic].given, near[0]):
            return None
        return near[0] @ SE2.from_array(np.mean([(near[0].inverse() @ each).as_array() for each in near], axis=0))


def _is_near(a: SE2, b: SE2) -> bool:
    """Whether a location that begins with one of two mountings can find the other."""
    motion = a.inverse() @ b
    return math.hypot(motion.x, motion.y) < _NEAR[0] and abs(motion.theta) < _NEAR[1]


def _moved(other, first, pose):
    """Return a lidar, mounted at a `pose` in the frame of the `first` one instead, unless that is None."""
    if pose is None:
        return other
    mounting = Mounting(first.aligned_pose @ pose @ SE2(theta=other.mounting.pose.theta), other.mounting.upside_down)
    return replace(other, mounting=mounting)


def _compared(recording, mounting, others, parameters, progress) -> _Comparisons:
    """Return the comparisons of the further lidars over a recording."""
    comparisons = _Comparisons()
    odometry = ReplayOdometry(Odometry(parameters.for_odometry(), comparisons=comparisons), others, recording.topic,
                              mounting, parameters)
    for scan in prepared(progress(recording.scans()), mounting, parameters.input_of(recording.topic)):
        with suppress(ScanError):
            odometry.process(scan)
    return comparisons


def _calibrated(compared: ComparedLidar | None, other, given, first, time_offset) -> CalibratedLidar:
    """Return the results for one lidar, compared as `other`, with the mounting that was `given`."""
    topic = other.recording.topic
    if compared is None or not compared.known:
        count = len(compared.comparisons) if compared else 0
        raise CalibrationError(
            f'{other.recording.path}: only {count} scans of {topic} could be compared with the map of the first lidar; '
            'check whether both see the same walls, and upside_down')
    estimate = compared.estimate
    # The scans are rotated by the given yaw, so the estimate contains its error only.
    pose = first.aligned_pose @ estimate.pose @ SE2(theta=other.mounting.pose.theta)
    return CalibratedLidar(
        topic, other.recording.frame_id, first, given.mounting, Mounting(pose, other.mounting.upside_down),
        time_offset, time_offset + estimate.time_offset, estimate.sigmas, estimate.observable,
        len(compared.comparisons), compared.driven, compared.turned,
        difference(given.mounting.pose, estimate._replace(pose=pose)))
