# SPDX-License-Identifier: Apache-2.0
"""The scans that ``bench fingerprint`` gives to both source trees, as plain arrays."""
import dataclasses
import math
import sys

import numpy as np

from dbscan_reg_ros.core.errors import DbscanRegError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.evaluation.trackers import SPREAD
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import LIDARS, follow, measure, rooms

from ..intel import Intel
from ..odometry.courses import COURSES

RECORDINGS = {'intel': 'intel/intel.log.gz', 'aces': 'aces/aces.log.gz', 'urg04lx': 'urg04lx/exp1',
              'lms511': 'lms511/static',
              'ccny_demo': 'ccny_demo/demo.bag'}
SIMULATED = ('rooms', 'corridors', 'halls', 'featureless', 'round', 'chairs', 'trees', 'lidars', 'leader', 'far_noise',
             'losses',
             'bursts', 'outages', 'sparse', 'narrow', 'passers', 'covered', 'spin', 'spinup')
PLACE = SE2(0.3, -0.2, math.radians(135.0))
MOUNTED = ('mounted', 'upside_down', 'moving')
SWAY, SWAY_PERIOD = (0.1, 0.05, math.radians(30.0)), 7.0
"""Largest way of a moving laser from its place [m, m, rad], and how long it takes to come back [s]."""
MOUNTED_SCANS = 300
PAIRS = 300
WHEELS = 'intel_wheels'
GROUPS = (*RECORDINGS, WHEELS, *SIMULATED, *MOUNTED, *(f'node_{name}' for name in MOUNTED), 'pairs')


def inputs(group, folder, limit=None) -> dict:
    """Name -> arrays, as `recorder` reads them, of each drive of a `group`.

    Parameters
    ----------
    group : str
        One of `GROUPS`.
    folder : Path
        Of the recordings; without a recording its group is empty.
    limit : int, optional
        The first scans only, and so many pairs.
    """
    if group in MOUNTED:
        scans, _ = mounted(group, limit)
        return {group: packed(scans)}
    if group.startswith('node_'):
        return {group: through_node(group.removeprefix('node_'), limit)}
    try:
        if group in SIMULATED:
            drives = [course.scans[:limit] for course in COURSES[group](folder)]
            return {f'{group}_{k}': packed(scans) for k, scans in enumerate(drives)}
        if group == 'pairs':
            return {group: pairs(Intel(folder / 'intel'), limit)}
        if group == WHEELS:
            return {group: with_wheels(open_recording(folder / RECORDINGS['intel']), limit)}
        return {group: packed(list(open_recording(folder / RECORDINGS[group]).scans())[:limit])}
    except DbscanRegError as missing:
        print(f'left out: {group}: {missing}', file=sys.stderr)
        return {}


def packed(scans, kind='odometry', **more) -> dict:
    """Return `Scan`s as plain arrays."""
    geometries = [scan.geometry for scan in scans]
    angles = [(g.angle_min, g.angle_increment, g.range_min, g.range_max, scan.time_increment)
              for g, scan in zip(geometries, scans, strict=True)]
    return {'kind': np.array(kind), 'stamps': np.array([scan.stamp for scan in scans], dtype=np.int64),
            'beams': np.array([g.size for g in geometries]), 'angles': np.array(angles),
            'ranges': np.concatenate([scan.ranges for scan in scans]), **more}


def with_wheels(recording, limit=None) -> dict:
    """Return the scans with the motion since the last one as measured by the wheels."""
    scans = list(recording.scans())[:limit]
    _, wheels = recording.wheel_odometry()
    told = np.vstack((np.full((1, 3), np.nan), relative(wheels[:-1], wheels[1:])))[:len(scans)]
    spreads = np.array([SPREAD(SE2.from_array(np.nan_to_num(motion))) for motion in told])
    return packed(scans, prior=told, prior_covariance=np.einsum('ni,ij->nij', spreads**2, np.eye(3)))


def pairs(log, limit=None) -> dict:
    """Return the first pairs of ``pairs.csv``."""
    chosen = np.array([(i, j) for i, j, _ in log.pairs[:min(limit or PAIRS, PAIRS)]])
    used, numbered = np.unique(chosen, return_inverse=True)
    return packed([log.scans[k] for k in used], 'register', pairs=numbered.reshape(-1, 2))


def places(kind, times):
    """(N, 3) where the laser of a `kind` of `MOUNTED` is on the base at `times` [s]."""
    sway = np.sin(2.0 * math.pi * times / SWAY_PERIOD) if kind == 'moving' else np.zeros(len(times))
    return PLACE.as_array() + sway[:, None] * SWAY


def mounted(kind, limit=None):
    """Return a drive through rooms with a laser that sits as `kind` says.

    The scans of an upright sensor that looks along the base, and those of the laser as its driver gives them.
    """
    lidar, world = LIDARS['rplidar_a'], rooms(seed=1)
    path, rng = follow(world.tour[:6], speed=1.0), np.random.default_rng(1)
    times = np.arange(min(limit or MOUNTED_SCANS, MOUNTED_SCANS)) / lidar.rate
    within = lidar.time_increment * np.arange(lidar.beams)
    upright, raw = [], []
    for time, place in zip(times, places(kind, times), strict=True):
        sensor = dataclasses.replace(lidar, mounting=SE2.from_array(place))
        scan = measure(world, path.poses_at(time + within), sensor, rng, round(1e9 * (1e6 + time)), time)
        g, yaw = scan.geometry, float(place[2])
        upright.append(regarded(scan, g.angle_min + yaw, g.angle_increment))
        raw.append(regarded(scan, -g.angle_min, -g.angle_increment) if kind == 'upside_down' else scan)
    return upright, raw


def regarded(scan, angle_min, angle_increment):
    """Return the scan with other bearings."""
    g = scan.geometry
    geometry = ScanGeometry(angle_min, angle_increment, g.size, g.range_min, g.range_max)
    return dataclasses.replace(scan, geometry=geometry)


def through_node(kind, limit=None) -> dict:
    """Return the same drive for the node, with the mounting as a parameter."""
    _, raw = mounted(kind, limit)
    if kind == 'moving':
        seconds = 1e-9 * (np.array([scan.stamp for scan in raw]) - raw[0].stamp)
        return packed(raw, 'node', arguments=np.array(['-p', 'mounting:=tf']), places=places(kind, seconds))
    arguments = ['-p', 'mounting:=laser_pose', '-p', f'laser_pose:={[float(value) for value in PLACE.as_array()]}',
                 '-p', f'upside_down:={str(kind == "upside_down").lower()}']
    return packed(raw, 'node', arguments=np.array(arguments))
