# SPDX-License-Identifier: Apache-2.0
"""Two lidars and wheels, the first lidar with a wrong mounting or late stamps: which lidar is named, and when."""
import dataclasses
import math

from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.core.odometry.calibration.wheels import Wrong
from dbscan_reg_ros.evaluation.metrics import evaluate
from dbscan_reg_ros.recordings.poses import compose
from dbscan_reg_ros.replays.odometry import OdometryWithWheels
from dbscan_reg_ros.robot.parameter_groups import NodePriorParameters
from dbscan_reg_ros.simulation import Path, WheelErrors, wheel_odometry

from ..bounds import at_least, at_most
from ..odometry.courses import FRONT, REAR
from ..odometry.drift import SeveralLidars, follow

MOUNTING, LATE = SE2(0.04, -0.03, math.radians(3.0)), 0.06
USUAL, SLIPPING = WheelErrors(), WheelErrors(slips=((5.0, 8.0, 0.6), (14.0, 17.0, 1.5)))
CASES = {'both right': (SE2(), 0.0, USUAL), 'mounting 5 cm, 3 deg': (MOUNTING, 0.0, USUAL),
         'same, wheels slip': (MOUNTING, 0.0, SLIPPING), 'stamps 60 ms': (SE2(), LATE, USUAL)}
"""Case -> error of mounting and stamps [s] of the first lidar, and errors of the wheels."""
NAMED = {'ratio': at_most(2.0), 'named': at_least(1.0), 'named_s': at_most(20.0), 'others_count': at_most(0)}
BOUNDS = {'both right': {'others_count': at_most(0)}, 'mounting 5 cm, 3 deg': NAMED, 'same, wheels slip': NAMED,
          'stamps 60 ms': {'ratio': at_most(2.0), 'others_count': at_most(0)}}


class Watched(LidarComparisons):
    """Comparisons that keep when the wheels first showed which lidar is wrong.

    Attributes
    ----------
    shown : dict
        `Wrong` -> stamp [ns].
    """

    def __init__(self, base):
        super().__init__(base=base)
        self.shown = {}

    def add(self, update, locate, prior=None):
        """Add the `update` of a scan."""
        super().add(update, locate, prior)
        for lidar in self.lidars.values():
            self.shown.setdefault(lidar.wrong, update.stamp)


def measured(courses) -> dict:
    """Return a row for each case: ``others``, the drives on which the right lidar or one of two right ones is named."""
    rows = {}
    for case, errors in CASES.items():
        found = [_judged(course, seed, *errors) for seed, course in enumerate(courses)]
        named = [each['named_s'] for each in found if each['named_s'] is not None]
        error = sum(each['rpe_5m_m'] for each in found) / len(found)
        rows[case] = {'rpe_5m_m': error, 'ratio': error / rows.get('both right', {'rpe_5m_m': error})['rpe_5m_m'],
                      'named': len(named) / len(found), 'named_s': max(named, default=math.nan),
                      'others_count': sum(each['other'] for each in found)}
    return rows


def _judged(course, seed, mounting, late, errors) -> dict:
    """Error over 5 m, after how many seconds the first lidar was named, and whether another name was given."""
    # The followed frame is that of the first lidar, which is believed to be at `given`.
    given, begin = FRONT @ mounting, course.scans[0].stamp
    base = compose(course.reference, FRONT.inverse().as_array()[None])
    stamps, poses = wheel_odometry(Path(course.seconds, base), errors, seed=seed, start=begin)
    wheels = stamps, compose(poses, given.as_array()[None])
    (sensor, scans), = course.others
    others = ((dataclasses.replace(sensor, pose=given.inverse() @ REAR), scans),)
    shifted = [dataclasses.replace(scan, stamp=scan.stamp + round(1e9 * late)) for scan in course.scans]
    comparisons = Watched(given.inverse())
    track = SeveralLidars(others, comparisons, lambda odometry: OdometryWithWheels(
        odometry, wheels, Mounting(), NodePriorParameters()))
    run = follow(track, dataclasses.replace(course, scans=shifted, others=others), 'first lidar wrong')
    stamp = comparisons.shown.get(Wrong.FIRST) if mounting != SE2() or late else None
    wrong_names = set(comparisons.shown) - {Wrong.UNKNOWN} - ({Wrong.FIRST} if stamp else set())
    return {'rpe_5m_m': evaluate(run.poses, course.stamps, None, course.reference)['rpe_5m_mean_m'],
            'named_s': stamp and 1e-9 * (stamp - begin), 'other': bool(wrong_names)}
