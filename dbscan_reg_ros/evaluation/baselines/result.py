# SPDX-License-Identifier: Apache-2.0
"""Result of a baseline for two scans, and the least-squares motion between paired points."""
import math
from dataclasses import dataclass

from ...core.geometry.se2 import SE2
from ...core.registration.records import Status

TRANSLATION_CHANGE = 1e-4
ROTATION_CHANGE = 1e-4
MOST_STEPS = 50


@dataclass(frozen=True)
class Result:
    """Result with the attributes of `core.registration.records.Registration` that every method can provide.

    Attributes
    ----------
    transform : SE2
        Pose of the current sensor in the reference's frame: ``p_R = transform.apply(p_O)`` (Eq. 8).
    status : Status
        ``OK`` if the iteration converged, else ``FAILED``.
    """

    transform: SE2
    status: Status


def iterate(step, guess) -> Result:
    """Apply ``step(transform) -> transform`` until the transform changes by less than 0.1 mm and 0.1 mrad.

    `step` returns None if it finds no correspondences; the result is then FAILED.
    """
    transform = guess
    for _ in range(MOST_STEPS):
        better = step(transform)
        if better is None:
            return Result(transform, Status.FAILED)
        change = transform.inverse() @ better
        transform = better
        if abs(change.x) + abs(change.y) < TRANSLATION_CHANGE and abs(change.theta) < ROTATION_CHANGE:
            return Result(transform, Status.OK)
    return Result(transform, Status.FAILED)


def fit(reference, current) -> SE2:
    """Return the least-squares motion from the points `current` ``(K, 2)`` [m] to `reference` ``(K, 2)`` [m]."""
    centre_r, centre_c = reference.mean(axis=0), current.mean(axis=0)
    a, b = current - centre_c, reference - centre_r
    theta = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    x, y = centre_r - SE2(0.0, 0.0, theta).apply(centre_c)
    return SE2(float(x), float(y), theta)
