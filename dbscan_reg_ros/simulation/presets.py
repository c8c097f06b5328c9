# SPDX-License-Identifier: Apache-2.0
"""Lidars as their drivers send them: order of the beams, limits, missing returns and number of beams."""
import math

from .lidar import LIDARS, Lidar


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
