# SPDX-License-Identifier: Apache-2.0
"""The known true motion of a recording, and the error measures that can be computed from it."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se2 import SE2
from ..recordings.poses import relative
from ..recordings.truth import Relations, find_relations, load_relations, true_poses
from .matching import Matched, match
from .metrics import evaluate, final_error, related


class KnownMotion(NamedTuple):
    """Motion known from a recording and the files beside it; an attribute is None if it is unknown.

    Attributes
    ----------
    truth : (stamps (N,) int64 [ns], poses (N, 3) float [m, m, rad])
        True poses of the sensor, from `true_poses`.
    relations : Relations
        True motions between pairs of scans.
    wheels : (stamps, poses)
        Wheel odometry, from `Recording.wheel_odometry`.
    """

    truth: tuple[NDArray[np.int64], NDArray[np.float64]] | None
    relations: Relations | None
    wheels: tuple[NDArray[np.int64], NDArray[np.float64]] | None

    @classmethod
    def of(cls, recording) -> 'KnownMotion':
        """Read the known motion of a `Recording`; raise RecordingError if a file beside it cannot be read."""
        relations = find_relations(recording.path)
        return cls(true_poses(recording), relations and load_relations(relations), recording.wheel_odometry())

    @property
    def is_known(self) -> bool:
        """Whether there are true poses or relations."""
        return bool(self.truth or self.relations)

    def true_poses(self, stamps) -> Matched:
        """Return the true poses at `stamps` ``(N,)`` [ns]: interpolated, but NaN where the truth has a hole."""
        if self.truth is None:
            return Matched(np.full((len(stamps), 3), np.nan), 'the true poses are unknown')
        return match(*self.truth, stamps, sparse=True)

    def between(self, first, second) -> SE2 | None:
        """Return the true motion between two stamps [ns]; None if it is unknown."""
        stamps = np.array((first, second), dtype=np.int64)
        if self.truth:
            poses = match(*self.truth, stamps[:1], sparse=True).poses, match(*self.truth, stamps[1:], sparse=True).poses
            if np.isfinite(poses).all():
                return SE2.from_array(relative(*poses)[0])
        if self.relations:
            start, end, found = related(stamps, self.relations)
            motions = self.relations.motions[found]
            for turned, way in ((False, motions[start < end]), (True, motions[start > end])):
                if len(way):
                    motion = SE2.from_array(way[0])
                    return motion.inverse() if turned else motion
        return None

    def measures(self, stamps, poses) -> dict:
        """Compute every error measure of the `poses` ``(N, 3)`` of the sensor at `stamps` ``(N,)`` [ns] of scans.

        Return measure -> value, from `metrics.evaluate` and `metrics.final_error`; empty if no true motion is known.
        """
        poses = np.asarray(poses, dtype=float).reshape(-1, 3)
        if not len(poses):
            return {}
        measures = evaluate(poses, stamps, self.relations) if self.relations else {}
        if self.truth:
            reference = self.true_poses(stamps).poses
            known = np.isfinite(reference).all(axis=1)
            if known.sum() > 1:
                measures |= evaluate(poses, reference=reference) | final_error(poses[known], reference[known])
        return measures


NOTHING_KNOWN = KnownMotion(None, None, None)


def errors_of(recording, stamps, poses) -> dict:
    """Compute the error measures of estimated `poses` with the known motion of a recording."""
    return KnownMotion.of(recording).measures(stamps, poses)
