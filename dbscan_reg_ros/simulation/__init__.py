# SPDX-License-Identifier: Apache-2.0
"""Simulated lidar recordings with exact ground truth: scans and poses of a lidar along a path through a world."""
from .dead_reckoning import WheelErrors, wheel_odometry, yaw_rates
from .lidar import LIDARS, PRESETS, Lidar
from .paths import Path, follow
from .simulate import Simulation, demo, measure, simulate
from .worlds import Person, World, corridor, hall, rooms, with_people

__all__ = ['LIDARS', 'PRESETS', 'Lidar', 'Path', 'Person', 'Simulation', 'WheelErrors', 'World', 'corridor', 'demo',
           'follow', 'hall', 'measure', 'rooms', 'simulate', 'wheel_odometry', 'with_people', 'yaw_rates']
