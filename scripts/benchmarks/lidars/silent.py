# SPDX-License-Identifier: Apache-2.0
"""Two lidars, one of them silent for ten seconds: gaps and steps of the odometry, and the accuracy of its twists.

Scanners are switched off by doors and cables: there may be no gap that a controller notices, no jump, and no twist that
is surer or much less sure than that of the other lidar alone.
"""
import math

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.sensor import FIRST
from dbscan_reg_ros.robot.scan_buffer import RecordedScans
from dbscan_reg_ros.simulation import follow

from ..odometry.courses import FRONT
from ..odometry.drift import OURS
from ..report import at_most
from .several import KINDS, SECONDS, seen_by

BEGIN, END = 0.32, 0.72
"""Ratios of the length of a drive from which and until which a lidar is silent: for 10 s of 25 s."""
AFTER = 1.0
"""Time [s] after each change in which steps of the poses count."""
TURNS, STEADY = 0.2, 0.1
"""A step counts if the turn rate changes by less than the second number [rad/s] in this time [s] before and after."""
CASES = {'front silent': 0, 'rear silent': 1}
"""Case -> rank of the silent lidar."""
BOUNDS = {'gap_s': at_most(0.2), 'step_m': at_most(0.02), 'step_deg': at_most(0.3), 'ratio_twist': at_most(1.5)}


def add_table(report, args):
    """Add a table with a row for each case to a `Report`: the worst of all drives."""
    drives = [(kind, seed, rank, args.limit) for rank in CASES.values() for kind in KINDS for seed in range(args.seeds)]
    with workers(args.processes) as executor:
        found = list(executor.map(judged, *zip(*drives, strict=True)))
    rows = {case: {name: max(each[name] for drive, each in zip(drives, found, strict=True) if drive[2] == rank)
                   for name in BOUNDS} for case, rank in CASES.items()}
    report.add_courses('one of two silent', rows, OURS, dict.fromkeys(CASES, BOUNDS))


def judged(kind, seed, rank, limit) -> dict:
    """Return the figures of one drive in which the lidar of this `rank` is silent.

    ``gap_s``: longest time between two poses. ``step_m``, ``step_deg``: largest error of the motion between two poses
    in the time `AFTER` the lidar becomes silent and is back, except at changes of the turn rate: this simulated base
    begins and ends rotations at once, and steps of up to 0.9 deg are there with both lidars, too.
    ``ratio_twist``: largest ratio of the standard deviations of the twist, on average while the lidar is silent, to
    those with the other lidar alone.
    """
    course = seen_by(2, kind, seed, limit)
    lidars = [(FIRST, course.scans), *course.others]
    begin, end = course.scans[0].stamp, course.scans[-1].stamp
    changes = [1e-9 * ratio * (end - begin) for ratio in (BEGIN, END)]

    def is_silent(scan):
        return changes[0] < 1e-9 * (scan.stamp - begin) < changes[1]

    heard = [(sensor, [scan for scan in scans if sensor.rank != rank or not is_silent(scan)])
             for sensor, scans in lidars]
    updates = _updates(heard)
    path = follow(KINDS[kind](seed=seed).tour).until(SECONDS)
    times = 1e-9 * np.array([update.stamp - begin for update in updates])
    true, found = [SE2.from_array(pose) @ FRONT for pose in path.poses_at(times)], [update.pose for update in updates]
    rates = [_turn_rates(path, times + offset) for offset in (-TURNS, 0.0, TURNS)]
    counts = (np.ptp(rates, axis=0) < STEADY) & np.any(
        [(times >= change) & (times < change + AFTER) for change in changes], axis=0)
    steps = [_motion(true, k).inverse() @ _motion(found, k) for k in np.flatnonzero(counts)]
    alone = _updates(lidars[1 - rank:2 - rank])
    twists = [np.mean([np.sqrt(update.twist_covariance.diagonal()) for update in each if is_silent(update)], axis=0)
              for each in (updates, alone)]
    return {'gap_s': 1e-9 * float(np.diff([update.stamp for update in updates]).max()),
            'step_m': max(math.hypot(step.x, step.y) for step in steps),
            'step_deg': math.degrees(max(abs(step.theta) for step in steps)),
            'ratio_twist': float((twists[0] / twists[1]).max())}


def _turn_rates(path, times) -> np.ndarray:
    """Return the true turn rates ``(N,)`` at `times` [s] in rad/s."""
    span = 0.01
    return np.diff(np.unwrap([path.poses_at(times + offset)[:, 2] for offset in (-span, span)], axis=0), axis=0)[0] / (
        2.0 * span)


def _motion(poses, k) -> SE2:
    return poses[k - 1].inverse() @ poses[k]


def _updates(lidars) -> list:
    """Return the updates of the scans of `lidars`, in the order of their stamps, without those that are not used."""
    odometry = Odometry()
    scans = RecordedScans(scans for _, scans in lidars).before()
    updates = (odometry.process(each.scan, None, lidars[each.lidar][0]) for each in scans)
    return [update for update in updates if not update.waits]
