"""The direction that walls leave free, and the search along it (corridors)."""
import math

import numpy as np

from . import alignment


def weakest_direction(information):
    """Direction of the translation that a match determines least, the rotation being free.

    Parameters
    ----------
    information : (3, 3) array

    Returns
    -------
    angle : float [rad], modulo pi
    weak, strong : float
        Information along it and across it.
    """
    (xx, xy, x), (_, yy, y), (_, _, turn) = information.tolist()
    turn = max(turn, 1e-12)
    xx, xy, yy = xx - x * x / turn, xy - x * y / turn, yy - y * y / turn
    half, root = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    return 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi, max(half - root, 0.0), half + root


def search_free_direction(candidates, angles, reference, current, parameters, density):
    """Slide each candidate along its direction to where the few points that face that way fit best.

    Parameters
    ----------
    candidates : (H, 3) array
    angles : (H,) array [rad]
        In the reference's frame.
    reference, current : Features
    parameters : FreeDirectionParameters
    density : DensityParameters

    Returns
    -------
    (H, 3) array
    """
    cloud = current.cloud
    facing = np.abs((np.exp(1j * (candidates[:, 2] - angles))[:, None] * cloud.normals).real).max(axis=0)
    cloud = cloud.select(facing > parameters.facing)
    if len(cloud) < parameters.min_points:
        return candidates
    along = np.array((np.cos(angles), np.sin(angles), np.zeros(len(angles)))).T
    for reach, step, scale in ((parameters.reach, 2.0 * parameters.scale, 3.0 * parameters.scale),
                               (2.5 * parameters.scale, 0.4 * parameters.scale, parameters.scale)):
        count = math.floor(reach / step)
        shift = np.arange(-count, count + 1) * step
        moved = (candidates[:, None] + shift[:, None] * along[:, None]).reshape(-1, 3)
        fit = alignment.fit(moved, cloud, reference.surface, density.facing)
        component = (fit.normals * np.exp(1j * angles).repeat(len(shift))[:, None]).real
        violation = reference.view.violation(fit.places, cloud.tolerance(density.violation_tolerance))
        weight = fit.weight(scale)
        value = (weight * component ** 2 - density.violation * violation * (1.0 - weight)).sum(axis=1)
        value = value.reshape(-1, len(shift)) - 1e-9 * np.abs(shift)
        best = value.argmax(axis=1)
        candidates = candidates + shift[best][:, None] * along
    return candidates
