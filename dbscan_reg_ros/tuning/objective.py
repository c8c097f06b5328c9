# SPDX-License-Identifier: Apache-2.0
"""Cost of a parameter set on a recording; lower is better."""
import dataclasses
import itertools
import math
from functools import lru_cache

import numpy as np

from ..core.geometry.se2 import SE2
from ..core.odometry.pipeline import Odometry
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..evaluation.comparison import METRES, TooShort, paired
from ..evaluation.known_motion import KnownMotion
from ..evaluation.metrics import apart, errors, path_lengths
from ..recordings import open_recording
from ..recordings.bags.clouds import CloudParameters
from ..recordings.poses import relative
from ..replays.trajectory import Trajectory, trajectory_of

OBJECTIVES = ('auto', 'truth', 'consistency')
HOPELESS = 1e3
"""Cost [m] of parameters that cannot be evaluated: almost no scan is used, or the sensor does not move."""
LOOPS = 30
LOOP_METRES, LOOP_NEAR = 10.0, 1.0
"""A loop is closed with an earlier scan if the distance driven since [m] is at least the first value and the distance
between the scans [m] at most the second."""


def cost_of(path, topic, parameters, objective='auto', limit=None):
    """Return the cost [m] of parameters: the mean error over 1 m on the first `limit` scans of the recording at `path`.

    With the objective ``truth``, the cost is the error against the true poses or the relations of the recording. With
    ``consistency``, it is the difference between a forward and a backward pass plus the gaps at loops. With ``auto``,
    the objective is ``truth`` if the truth is known, else ``consistency``.

    Raises
    ------
    RecordingError
        When the recording cannot be read, or `objective` is ``truth`` and its true motion is unknown.
    """
    clouds = CloudParameters.of(parameters, topic)
    known, parameters = _known(path, topic, clouds), parameters.for_odometry()
    scans = list(itertools.islice(open_recording(path, topic, clouds).scans(), limit))
    if objective == 'truth' or (objective == 'auto' and (known.truth or known.relations)):
        trajectory = trajectory_of(scans, parameters)
        try:
            return float(paired(known, trajectory, trajectory).a[0].mean())
        except TooShort:
            return HOPELESS
    return _inconsistency(scans, parameters)


@lru_cache
def _known(path, topic, clouds):
    """Return the known motion of a recording, read once and cached for all trials."""
    return KnownMotion.of(open_recording(path, topic, clouds))


def _inconsistency(scans, parameters):
    forward = Trajectory()
    features = [update.features for update in forward.follow(scans, Odometry(parameters))]
    backward = trajectory_of(_backward(scans), parameters)
    there, back = forward.pose_array(), backward.pose_array()[::-1]
    if not len(there) == len(back) > 1:
        return HOPELESS
    first, later = apart(there, METRES)
    if not len(first):
        return HOPELESS
    disagreement = errors(relative(back[first], back[later]), relative(there[first], there[later]))[0].mean()
    return float(disagreement + _open_loops(there, features))


def _backward(scans):
    """Return the scans in reversed time: reversed order, mirrored stamps, negated time increments."""
    ends = scans[0].stamp + scans[-1].stamp
    return [dataclasses.replace(scan, stamp=ends - scan.stamp, time_increment=-scan.time_increment)
            for scan in reversed(scans)]


def _open_loops(poses, features):
    """Return the mean gap between odometry and registration at loop closures, per metre driven."""
    way, gaps = path_lengths(poses), []
    for later in range(0, len(poses), max(len(poses) // LOOPS, 1)):
        before = np.flatnonzero(way[later] - way[:later] > LOOP_METRES)
        if not len(before):
            continue
        distance = np.hypot(*(poses[before, :2] - poses[later, :2]).T)
        earlier = before[distance.argmin()]
        if distance.min() > LOOP_NEAR:
            continue
        found = register(features[earlier], features[later])
        if found.status is Status.OK:
            motion = SE2.from_array(poses[earlier]).inverse() @ SE2.from_array(poses[later])
            error = motion.inverse() @ found.transform
            gaps.append(min(math.hypot(error.x, error.y), LOOP_NEAR) / (way[later] - way[earlier]))
    return float(np.mean(gaps)) if gaps else 0.0
