# SPDX-License-Identifier: Apache-2.0
"""Two lidars that see the robot itself or each other's light, and one, two and three lidars, on five kinds of drive.

A further lidar has to be worth its time: three may not be worse than two, and what one sees of the robot or of the
light of the other may cost a tenth of the accuracy.
"""
import dataclasses
import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.core.odometry.calibration.odd_one import named
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.evaluation.metrics import evaluate
from dbscan_reg_ros.simulation import Lidar, corridor, follow, hall, rooms, simulate, with_people

from ..odometry.course import Course
from ..odometry.courses import FRONT, REAR
from ..odometry.drift import OURS, SeveralLidars
from ..odometry.drift import follow as tracked
from ..report import at_most


class Watched(LidarComparisons):
    """Comparisons that keep when a lidar was named first, and how many scans of the further lidars were not used.

    Attributes
    ----------
    names : int
        Number of lidars that were named then: 0, 1 or, of two, both.
    named_m : float
        Distance driven until then [m]; NaN if none was named.
    text : str
        Why, with that distance; empty if none was named.
    """

    def __init__(self) -> None:
        super().__init__()
        self.names, self.named_m, self.text, self._left_out, self._judged = 0, math.nan, '', 0, 0

    def uses(self, sensor, stamp, first_maps):
        """Whether the scan of a `sensor` may change the track; counted once the lidar is known."""
        uses = super().uses(sensor, stamp, first_maps)
        lidar = self.lidars.get(sensor.name)
        if lidar is not None and lidar.known:
            self._judged += 1
            self._left_out += not uses
        return uses

    def add(self, update, locate):
        """Add the `update` of a scan."""
        super().add(update, locate)
        for lidar in () if self.names else self.lidars.values():
            if lidar.disagrees or lidar.unfit:
                texts = [str(each) for each in named(SE2(), list(self.lidars.values())) if each]
                self.names, self.named_m = max(len(texts), 1), lidar.driven
                self.text = f'{"; ".join(texts) or "unfit"}, after {lidar.driven:.0f} m'

    @property
    def unused(self) -> float:
        """Fraction of the scans of known lidars that were not used."""
        return self._left_out / max(self._judged, 1)


KINDS = {'rooms': rooms, 'corridor': corridor, 'hall': hall,
         'wide corridor': lambda seed: corridor(width=3.5, doors=5, seed=seed),
         'people': lambda seed: with_people(hall(seed=seed), 4, seed)}
"""Kind of drive -> function of a seed that makes its world."""
LEFT = SE2(-0.35, 0.25, math.radians(135.0))
"""Mounting of a third scanner, at the rear left corner."""
SCANNERS = (FRONT, 12.5, 0.0), (REAR, 15.0, 0.019), (LEFT, 14.0, 0.033)
"""Mounting, rate [Hz] and phase [s] of each scanner."""
SECONDS = 25.0
SECTOR = math.radians(100.0), math.radians(120.0)
"""Bearings between which a scanner sees the robot, 0.3 m away."""
DISTURBED = {'body': {'body': ((*SECTOR, 0.3),)}, 'talk': {'outliers': 0.01}}
"""Case -> changed fields of the `Lidar`."""


def add_tables(report, args):
    """Add those of `TABLES` that `args` names to a `Report`, by default all, with a row for all drives."""
    tables = [TABLES[name] for name in TABLES if not args.only or name in args.only]
    if not tables:
        return
    cases = tuple(dict.fromkeys(case for table in tables for case in table.cases.values()))
    drives = [(kind, seed, cases, args.limit) for kind in KINDS for seed in range(args.seeds)]
    with workers(args.processes) as executor:
        found = list(executor.map(judged, *zip(*drives, strict=True)))
    kinds = {kind: [each for (name, *_), each in zip(drives, found, strict=True) if name == kind] for kind in KINDS}
    for table in tables:
        report.add_courses(table.title, {name: table.row(each) for name, each in (*kinds.items(), ('all', found))},
                           OURS, {'all': table.bounds})


def judged(kind, seed, cases, limit) -> dict:
    """Return case -> (mean error over 5 m [m], processor time [s], scans of all lidars), for one drive."""
    return {case: followed(_course(case, kind, seed, limit)) for case in cases}


def _course(case, kind, seed, limit) -> Course:
    """Return the drive of a case: a number of lidars, one of `DISTURBED`, or ``masked``."""
    if case == 'masked':
        return masked(seen_by(2, kind, seed, limit))
    return seen_by(2, kind, seed, limit, **DISTURBED[case]) if case in DISTURBED else seen_by(case, kind, seed, limit)


def seen_by(count, kind, seed, limit=None, **changes) -> Course:
    """Return a drive seen by the first `count` scanners, with these `changes` of their `Lidar`."""
    world = KINDS[kind](seed=seed)
    path = follow(world.tour).until(SECONDS)
    seen = [simulate(world, path, Lidar(
        541, math.radians(-135.0), math.radians(0.5), 0.05, 30.0, rate, duration=0.75 / rate, noise=0.01,
        resolution=0.01, mounting=mounting, phase=phase, **changes), seed + 100 * rank)
        for rank, (mounting, rate, phase) in enumerate(SCANNERS[:count])]
    others = tuple((Sensor(f'lidar {rank}', FRONT.inverse() @ mounting, rank), simulation.scans)
                   for rank, ((mounting, *_), simulation) in enumerate(zip(SCANNERS, seen, strict=False)) if rank)
    return Course(seen[0].scans, reference=seen[0].truth, others=others).take(slice(limit))


def masked(course) -> Course:
    """Return the course without the returns between the bearings of `SECTOR`."""
    def without(scan):
        inside = (scan.geometry.bearings >= SECTOR[0]) & (scan.geometry.bearings <= SECTOR[1])
        return dataclasses.replace(scan, ranges=np.where(inside, math.nan, scan.ranges))
    return dataclasses.replace(course, scans=list(map(without, course.scans)), others=tuple(
        (sensor, list(map(without, scans))) for sensor, scans in course.others))


def followed(course) -> tuple:
    """Return the mean error over 5 m [m], the processor time [s] and the number of scans of all lidars."""
    begin = time.process_time()
    drive = tracked(SeveralLidars(course.others), course, 'lidars')
    seconds = time.process_time() - begin
    last = course.scans[-1].stamp
    count = len(course.scans) + sum(scan.stamp < last for _, scans in course.others for scan in scans)
    return evaluate(drive.poses, course.stamps, None, course.reference).get('rpe_5m_mean_m', math.nan), seconds, count


def _disturbed(drives) -> dict:
    """Return mean errors without a disturbance, with each of `DISTURBED`, and without the beams of the sector.

    ``ratio_CASE``: error by that without; ``ratio_CASE_error``: its standard error by the scatter of the drives.
    """
    errors = {name: np.array([drive[case][0] for drive in drives]) for name, case in TABLES['body'].cases.items()}
    without = errors.pop('without')
    row = {'without_m': float(without.mean())} | {f'{name}_m': float(values.mean()) for name, values in errors.items()}
    for name, values in errors.items():
        row[f'ratio_{name}'], row[f'ratio_{name}_error'] = ratio_of_means(values, without)
    return row


def ratio_of_means(values, others) -> tuple:
    """Return the ratio of the means of pairs of numbers ``(N,)``, and its standard error; NaN for a single pair.

    It is the ratio estimator of W. G. Cochran, "Sampling Techniques", Wiley 1977.
    """
    size, ratio = len(values), float(values.mean() / others.mean())
    if size == 1:
        return ratio, math.nan
    left = values - ratio * others
    return ratio, math.sqrt(float(left @ left) / (size * (size - 1))) / float(others.mean())


def _counted(drives) -> dict:
    """Return mean errors and processor times of a scan [ms], with one, two and three lidars.

    ``ratio_three``: error with three by that with two lidars; ``ratio_time``: time of a scan with three by that with
    one.
    """
    names = TABLES['number'].cases
    errors = {name: float(np.mean([drive[count][0] for drive in drives])) for name, count in names.items()}
    times = {name: 1e3 * float(np.divide(*np.sum([drive[count][1:] for drive in drives], axis=0)))
             for name, count in names.items()}
    return {f'{name}_m': error for name, error in errors.items()} | {
        f'ms_{name}': milliseconds for name, milliseconds in times.items()} | {
        'ratio_three': errors['three'] / errors['two'], 'ratio_time': times['three'] / times['one']}


class _Table(NamedTuple):
    """A table: its title, name -> case of `judged`, what makes a row of the results of drives, and bounds."""

    title: str
    cases: dict
    row: Callable
    bounds: dict


TABLES = {'body': _Table('own body and cross-talk',
                         {'without': 2, 'body': 'body', 'masked': 'masked', 'talk': 'talk'}, _disturbed,
                         {'ratio_body': at_most(1.1), 'ratio_talk': at_most(1.1)}),
          'number': _Table('number of lidars', {'one': 1, 'two': 2, 'three': 3}, _counted,
                           {'ratio_three': at_most(1.0), 'ratio_time': at_most(1.3)})}
