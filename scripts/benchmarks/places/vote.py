# SPDX-License-Identifier: Apache-2.0
"""A plain vote, with which the localiser is compared: every scan is registered to every view of the map."""
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.records import Status

from .starts import PARAMETERS

SCANS, STEP, TURN = 5, 0.7, 0.6
"""Number of scans that vote, and the distance and angle [m, rad] of which one is driven between them."""
SAME, SAME_TURN = 0.5, math.radians(5.0)
"""Results that differ by less than these [m, rad] vote for one pose; the second best differs by twice as much."""
MOST = 0.999
"""Largest confidence of one result."""
MARGIN = 12.0
"""The best sum of ``-log(1 - confidence)`` is an answer if it is ahead of the second by so much."""


class Vote:
    """The vote in the map `known`, for one start after the other."""

    def __init__(self, known):
        self._views = [(SE2.from_array(pose), view.features(PARAMETERS))
                       for pose, view in zip(known.poses, known.views, strict=True)]

    def answer(self, scans):
        """Return the number of the last scan that voted, and its pose (3,) in the map or None."""
        odometry, voters, last = Odometry(PARAMETERS), [], 0
        for number, scan in enumerate(scans):
            update = odometry.process(scan)
            step = voters[-1].pose.inverse() @ update.pose if voters else None
            if step is None or math.hypot(step.x, step.y) > STEP or abs(step.theta) > TURN:
                voters.append(update)
                last = number
                if len(voters) == SCANS:
                    break
        places, weights = [], []
        for voter in voters:
            onward = voter.pose.inverse() @ voters[-1].pose
            for pose, features in self._views:
                found = register(features, voter.features, PARAMETERS)
                if found.status is Status.OK:
                    places.append((pose @ found.transform @ onward).as_array())
                    weights.append(-math.log(1.0 - min(found.confidence, MOST)))
        if not places:
            return last, None
        places = np.array(places)
        off = places[:, None] - places
        away, turned = np.hypot(off[..., 0], off[..., 1]), np.abs(wrap(off[..., 2]))
        sums = ((away < SAME) & (turned < SAME_TURN)) @ np.array(weights)
        best = int(sums.argmax())
        rivals = sums[(away[best] > 2.0 * SAME) | (turned[best] > 2.0 * SAME_TURN)]
        return last, places[best] if sums[best] - rivals.max(initial=0.0) > MARGIN else None
