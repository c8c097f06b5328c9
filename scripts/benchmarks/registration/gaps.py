# SPDX-License-Identifier: Apache-2.0
"""The first scan after a gap, in the map before it: from the place where it is found, or from another one."""
import functools
import math

import numpy as np

from dbscan_reg_ros import Odometry
from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.odometry.models.stamps import Jump, ScanInterval
from dbscan_reg_ros.core.odometry.models.unobserved_motion import motion_without_scans
from dbscan_reg_ros.core.odometry.references import search_parameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.problem import SearchStage
from dbscan_reg_ros.core.registration.records import Prior
from dbscan_reg_ros.core.registration.status import place_terms
from dbscan_reg_ros.simulation import LIDARS, corridor, hall, rooms

from ..odometry.course import Course, simulated
from ..odometry.places import wood

WORLDS = {'rooms': rooms, 'halls': hall, 'corridors': corridor, 'trees': wood}
SENSORS = 'rplidar_a', 'lds'
GAPS = 2.2, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0
"""[s]"""
BEFORE, AFTER, SPEED = 10.0, 35.0, 0.7
"""Seconds of a drive before a gap and from its beginning on; [m/s]."""
OTHERS = 3
"""Scans from other places for each gap."""
FAR = 15.0
"""Least distance [m] of another place of the Intel log."""
STRIDE, MAPPED = 130, 120
"""After how many scans of the Intel log the next map of so many scans begins."""
NEAR = 0.3, 0.1
"""A match is right within this [m], [rad] of the truth."""


def simulated_matches(lidar, kind, seed) -> list:
    """Return the `matches` of a simulated drive; the other places are in worlds of its kind and of others."""
    rng = np.random.default_rng(seed)
    course = _drive(lidar, kind, seed)
    others = [_drive(lidar, each, seed + 1) for each in (kind, kind, *WORLDS)]
    return matches(course, int(np.searchsorted(course.seconds, BEFORE)), rng,
                   lambda: _any_scan(others[rng.integers(len(others))], rng))


def intel_matches(intel, half) -> list:
    """Return the `matches` in maps of parts of the Intel log, of every second one from 0 or 1 on (`half`).

    The other places are far away in the same building.
    """
    rng, found = np.random.default_rng(0), []
    course = Course(intel.scans, reference=intel.reference)
    for first in range(half * STRIDE, len(course.scans) - 2 * STRIDE, 2 * STRIDE):
        part = course.take(slice(first, None))
        away = np.hypot(*(course.reference - part.reference[0])[:, :2].T) > FAR
        found += matches(part, MAPPED, rng, lambda far=course.take(away): _any_scan(far, rng))
    return found


def matches(course, count, rng, another) -> list:
    """Return ``(terms, right)`` of the first scan after each of the `GAPS`, and of scans of other places.

    Parameters
    ----------
    course : Course
    count : int
        Number of scans before the gap, which make the map.
    rng : numpy.random.Generator
    another : function
        Returns a scan of another place.
    """
    found, (window, last) = [], _mapped(course.scans[:count])
    for gap in GAPS:
        k = int(np.searchsorted(course.seconds, course.seconds[count - 1] + gap))
        true = [(course.scans[k], SE2.from_array(course.reference[0]).inverse() @ SE2.from_array(course.reference[k]))
                ] if k < len(course.scans) else []
        for scan, truth in [*true, *((another(), None) for _ in range(OTHERS))]:
            found += _match(window, last, scan, gap, truth)
    return found


def _match(window, last, scan, gap, truth) -> list:
    """Return ``(terms (1, T), right (1,))`` of a scan in a map, or nothing where no hypothesis is found."""
    parameters, frame = Parameters(), window.latest
    interval = ScanInterval(0.1, gap, 0.0, jump=Jump.FORWARD, missing=True)
    motion = motion_without_scans(last.twist, interval, parameters)
    prior = Prior(frame.pose.inverse() @ last.pose @ motion.transform, motion.covariance)
    try:
        features = extract_features(scan, parameters)
    except ScanError:
        return []
    result = register(window.local_map_of(''), features, search_parameters(parameters), prior, SearchStage.NORMAL)
    if result.evidence is None:
        return []
    error = truth and truth.inverse() @ frame.pose @ result.transform
    right = error is not None and math.hypot(error.x, error.y) < NEAR[0] and abs(error.theta) < NEAR[1]
    return [(np.array([place_terms(result)]), np.array([right]))]


def _mapped(scans):
    """Return the key frames of scans as a `KeyFrameWindow`, and the last `OdometryUpdate`."""
    odometry, window, update = Odometry(), None, None
    for scan in scans:
        try:
            update = odometry.process(scan)
        except ScanError:
            continue
        if update.is_key_frame:
            frame = KeyFrame(update.features, update.pose, number=update.number)
            window = KeyFrameWindow((frame,)) if window is None else window.with_frame(
                frame, odometry.parameters.odometry.window_size)
    return window, update


@functools.lru_cache(8)
def _drive(lidar, kind, seed) -> Course:
    return simulated(WORLDS[kind](seed=seed), LIDARS[lidar], seed, seconds=BEFORE + AFTER, speed=SPEED)


def _any_scan(course, rng):
    return course.scans[rng.integers(len(course.scans))]
