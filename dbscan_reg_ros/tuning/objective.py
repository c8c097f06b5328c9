# SPDX-License-Identifier: Apache-2.0
"""Cost of a parameter set on a recording; lower is better."""
import dataclasses
import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..core.geometry.se2 import SE2
from ..core.registration.pipeline import register
from ..core.registration.records import Status
from ..evaluation.comparison import METRES, TooShort, paired
from ..evaluation.known_motion import KnownMotion
from ..evaluation.metrics import apart, errors, path_lengths
from ..recordings import open_recording
from ..recordings.bags.clouds import CloudParameters
from ..recordings.poses import relative
from ..replays.lidars import RecordedLidar, lidars_of, prepared
from ..replays.odometry import recorded_motion, replay_odometry, replayed_trajectory
from ..replays.trajectory import Trajectory

OBJECTIVES = ('auto', 'truth', 'consistency')
HOPELESS = 1e3
"""Cost [m] of parameters that cannot be evaluated: almost no scan is used, or the sensor does not move."""
LOOPS = 30
LOOP_METRES, LOOP_NEAR = 10.0, 1.0
"""A loop is closed with an earlier scan if the distance driven since [m] is at least the first value and the distance
between the scans [m] at most the second."""


def cost_of(path, lidars, parameters, objective='auto', limit=None):
    """Return the cost [m] of parameters on the first `limit` scans of the recording at `path`.

    The odometry is that of a replay with all `lidars`, those of its first lidar are the scans that count. With the
    objective ``truth``, the cost is the mean error over 1 m against the true poses or the relations of the recording.
    With ``consistency``, it is the difference between a forward and a backward pass plus the gaps at loops. With
    ``auto``, the objective is ``truth`` if the truth is known, else ``consistency``.

    Raises a RecordingError when the recording cannot be read, or `objective` is ``truth`` and its true motion is
    unknown; a MountingError when the mounting of one of several lidars is not known.
    """
    recording = lidars.open(path, parameters)
    known = _known(path, lidars.first, CloudParameters.of(parameters, lidars.first, lidars.mountings))
    scans = list(itertools.islice(recording.scans(), limit))
    if objective == 'truth' or (objective == 'auto' and (known.truth or known.relations)):
        trajectory = replayed_trajectory(recording, scans, lidars, parameters)
        try:
            return float(paired(known, trajectory, trajectory).a[0].mean())
        except TooShort:
            return HOPELESS
    return _inconsistency(recording, scans, lidars, parameters)


@lru_cache
def _known(path, topic, clouds):
    """Return the known motion of a recording, read once and cached for all trials."""
    return KnownMotion.of(open_recording(path, topic, clouds))


def _inconsistency(recording, scans, lidars, parameters):
    """Return the mean difference over 1 m between a forward and a backward pass, plus the gaps at loops [m]."""
    mounting, others = lidars_of(recording, lidars, parameters)
    motion = recorded_motion(parameters, recording)
    scans = list(prepared(scans, mounting, parameters.input_of(recording.topic)))
    forward, backward = Trajectory(), Trajectory()
    features = [update.features for update in forward.follow(
        scans, replay_odometry(parameters, others, recording.topic, mounting, motion))]
    ends = scans[0].stamp + scans[-1].stamp
    others = [BackwardLidar(other.recording, other.mounting, other.limits, ends) for other in others]
    motion = motion.backward(ends)
    for _ in backward.follow(_backward(scans, ends),
                             replay_odometry(parameters, others, recording.topic, mounting, motion)):
        pass
    there, back = forward.pose_array(), backward.pose_array()[::-1]
    if not len(there) == len(back) > 1:
        return HOPELESS
    first, later = apart(there, METRES)
    if not len(first):
        return HOPELESS
    disagreement = errors(relative(back[first], back[later]), relative(there[first], there[later]))[0].mean()
    return float(disagreement + _open_loops(there, features))


def _backward(scans, ends):
    """Return the scans in reversed time: reversed order, stamps mirrored to `ends` - stamp, negated time increments."""
    return [dataclasses.replace(scan, stamp=ends - scan.stamp, time_increment=-scan.time_increment)
            for scan in reversed(scans)]


@dataclass(frozen=True, eq=False)
class BackwardLidar(RecordedLidar):
    """A further lidar whose scans come in reversed time, as from `_backward` with `ends` [ns]."""

    ends: int

    def scans(self, parameters):
        """Return an iterator over the scans of this lidar in reversed time, as `RecordedLidar.scans` prepares them."""
        return iter(_backward(list(super().scans(parameters)), self.ends))


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
