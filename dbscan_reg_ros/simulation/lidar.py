# SPDX-License-Identifier: Apache-2.0
"""Model of a 2D lidar: measured ranges from true distances."""
import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..core.geometry.se2 import SE2
from ..core.scan_geometry import ScanGeometry

OUTLIER_RANGE = 10.0


@dataclass(frozen=True)
class Lidar:
    """A 2D lidar."""

    beams: int = 180
    angle_min: float = -0.5 * math.pi
    angle_increment: float = math.pi / 180.0
    """Bearing of the first beam and step between beams [rad]; a negative increment means clockwise beams."""
    range_min: float = 0.05
    range_max: float = 30.0
    """Limits of the ranges [m]; surfaces nearer or farther give no return."""
    rate: float = 10.0
    """Number of scans per second [Hz]."""
    duration: float = 0.0
    """Time from the first to the last beam [s]; with 0 all beams are measured at once."""
    noise: float = 0.01
    """Lower limit of the standard deviation of a range [m]."""
    noise_ratio: float = 0.0
    """Standard deviation of a range as a fraction of the range, where this is above `noise`."""
    dropouts: float = 0.0
    outliers: float = 0.0
    """Fraction of the beams without a return, and fraction with a random range between `range_min` and at most 10 m."""
    resolution: float = 0.0
    """Ranges are rounded to multiples of this [m]; with 0 they are not rounded."""
    mounting: SE2 = field(default_factory=SE2)
    """Pose of the sensor on the robot."""
    frame_id: str = 'laser'
    phase: float = 0.0
    """Time from the start of the path to the first scan [s]."""
    no_return: float = math.inf
    """Range that the driver sends for a beam without a return [m]."""
    stated: tuple[float, float] | tuple[()] = ()
    """Smallest and largest range that the driver states, if it does not state `range_min` and `range_max` [m]."""
    beams_vary: int = 0
    """The number of beams of a scan differs from `beams` by at most this."""
    reversed: bool = False
    """The driver sends the beams in the reverse order of their measurement, although its time increment is positive."""
    body: tuple[tuple[float, float, float], ...] = ()
    """tuple of (float, float, float) [rad, rad, m]: sectors in which the lidar sees the robot itself: first and last
    bearing, and range."""

    @cached_property
    def geometry(self) -> ScanGeometry:
        """Bearings and range limits of every scan."""
        range_min, range_max = self.stated or (self.range_min, self.range_max)
        return ScanGeometry(self.angle_min, self.angle_increment, self.beams, range_min, range_max)

    @property
    def time_increment(self):
        """Time from one beam to the next [s]."""
        return self.duration / (self.beams - 1) if self.beams > 1 else 0.0

    def times(self):
        """Return the time of each beam (N,), or of all beams (1,), from the start of the scan [s]."""
        if not self.duration:
            return np.zeros(1)
        times = self.time_increment * np.arange(self.beams)
        return times[::-1] if self.reversed else times

    def of_one_scan(self, rng):
        """Return the lidar with the number of beams of one scan, in the same field of view."""
        if not self.beams_vary:
            return self
        beams = self.beams + int(rng.integers(-self.beams_vary, self.beams_vary, endpoint=True))
        return dataclasses.replace(self, beams=beams, angle_increment=self.angle_increment * self.beams / beams)

    def measured(self, distances, rng):
        """Return measured ranges (N,) [m] for true `distances` (N,) [m]; `no_return` for beams without a return."""
        number = len(distances)
        for first, last, own in self.body:
            bearings = self.geometry.bearings
            distances = np.where((bearings >= first) & (bearings <= last), np.minimum(distances, own), distances)
        spread = np.maximum(self.noise, self.noise_ratio * np.minimum(distances, self.range_max))
        ranges = distances + rng.normal(0.0, spread)
        kind = rng.random(number)
        random = rng.uniform(self.range_min, max(self.range_min, min(OUTLIER_RANGE, self.range_max)), number)
        ranges = np.where(kind < self.outliers, random, ranges)
        if self.resolution:
            ranges = self.resolution * np.round(ranges / self.resolution)
        lost = (kind > 1.0 - self.dropouts) | (ranges < self.range_min) | (ranges > self.range_max)
        return np.where(lost, self.no_return, ranges)


LIDARS = {
    'hokuyo_urg04lx': Lidar(682, math.radians(-120.0), math.radians(240.0) / 681, 0.06, 4.0, 10.0, duration=0.0667,
                            noise=0.01, noise_ratio=0.01, resolution=0.001),
    'hokuyo_utm30lx': Lidar(1081, math.radians(-135.0), math.radians(0.25), 0.1, 30.0, 40.0, duration=0.019, noise=0.01,
                            resolution=0.001),
    'lds': Lidar(360, 0.0, math.radians(1.0), 0.12, 3.5, 5.0, duration=0.199, noise=0.01, noise_ratio=0.02,
                 resolution=0.001),
    'rplidar_a': Lidar(720, math.pi, -math.radians(0.5), 0.15, 12.0, 10.0, duration=0.0999, noise=0.01,
                       noise_ratio=0.01, dropouts=0.02),
    'rplidar_s': Lidar(920, math.pi, -math.radians(360.0 / 920), 0.1, 30.0, 10.0, duration=0.0999, noise=0.02,
                       resolution=0.001),
    'sick_lms200': Lidar(180, -math.pi / 2, math.radians(1.0), 0.1, 30.0, 10.0, noise=0.01, resolution=0.01),
    'sick_lms5xx': Lidar(381, math.radians(-95.0), math.radians(0.5), 0.7, 80.0, 25.0, duration=0.021, noise=0.007,
                         resolution=0.001),
}
"""Name -> lidar with the values of its data sheet; a parameter file in `config` for the lidar has the same name."""


def _turning(beams, rate, range_min, range_max, **further):
    """Return a lidar that turns all the time, its beams sent counter-clockwise from the front."""
    step = 2.0 * math.pi / beams
    return Lidar(beams, 0.0, step, range_min, range_max, rate, **{'duration': (beams - 1) / beams / rate, **further})


def _facing(beams, degrees, range_min, range_max, rate, **further):
    """Return a lidar that turns all the time and measures only within a field of view [deg] to the front."""
    half, step = math.radians(0.5 * degrees), math.radians(degrees) / (beams - 1)
    return Lidar(beams, -half, step, range_min, range_max, rate, **{'duration': degrees / 360.0 / rate, **further})


PRESETS = LIDARS | {
    'depth_camera': _facing(640, 57.0, 0.45, 10.0, 30.0, duration=0.0, noise=0.005, noise_ratio=0.01,
                            no_return=math.nan),
    'gazebo': _turning(360, 5.0, 0.12, 3.5, duration=0.0),
    'ldrobot_ld19': _turning(450, 10.0, 0.02, 12.0, no_return=math.nan, stated=(0.02, 25.0), beams_vary=4,
                             reversed=True, resolution=0.001),
    'ldrobot_stl27l': _turning(2160, 10.0, 0.02, 25.0, no_return=math.nan, beams_vary=10, reversed=True,
                               resolution=0.001),
    'lds_01': _turning(360, 5.0, 0.12, 3.5, noise_ratio=0.02, no_return=0.0, reversed=True, resolution=0.001),
    'lds_02': _turning(460, 5.0, 0.16, 8.0, noise_ratio=0.015, no_return=math.nan, stated=(0.0, 100.0), beams_vary=4,
                       resolution=0.001),
    'lds_03': _turning(400, 10.0, 0.05, 12.0, no_return=math.nan, stated=(0.1, 100.0), beams_vary=4, reversed=True,
                       resolution=0.001),
    'omron_os32c': _facing(677, 270.4, 0.002, 50.0, 25.0, no_return=50.0, dropouts=0.02, resolution=0.001),
    'oradar_ms200': _turning(450, 10.0, 0.05, 20.0, no_return=0.0, reversed=True, resolution=0.001),
    'pepperl_fuchs_r2000': _turning(3600, 20.0, 0.1, 30.0, resolution=0.001),
    'pilz_psenscan': _facing(2749, 274.8, 0.05, 40.0, 33.0, resolution=0.001),
    'rplidar_a1': _turning(360, 5.5, 0.15, 12.0, noise_ratio=0.01, reversed=True),
    'rplidar_c1': _turning(500, 10.0, 0.15, 12.0, reversed=True),
    'sick_microscan3': _facing(551, 275.0, 0.05, 40.0, 33.0, resolution=0.001),
    'sick_tim': _facing(811, 270.0, 0.05, 25.0, 15.0, noise=0.02, stated=(0.0, 100.0), resolution=0.001),
    'ydlidar_g': _turning(900, 10.0, 0.28, 16.0, no_return=0.0, stated=(0.1, 16.0), resolution=0.001),
    'ydlidar_g6': _turning(1800, 10.0, 0.28, 25.0, no_return=0.0, stated=(0.1, 25.0), resolution=0.001),
    'ydlidar_tg': _turning(2000, 10.0, 0.05, 30.0, no_return=0.0, stated=(0.01, 50.0), resolution=0.001),
    'ydlidar_x2': _turning(430, 7.0, 0.1, 8.0, noise_ratio=0.01, no_return=0.0, stated=(0.1, 12.0), resolution=0.001),
    'ydlidar_x4': _turning(500, 10.0, 0.12, 10.0, noise_ratio=0.01, no_return=0.0, stated=(0.1, 12.0),
                           resolution=0.001),
}
"""Name -> lidar with the figures of ``doc/sensors.md``. Where no source states the noise, it is 10 mm; that of
triangulating lidars is 1 % of the range from 1 m on."""
