# SPDX-License-Identifier: Apache-2.0
"""The direction that walls leave free, and the search along it (corridors)."""
import math

import numpy as np

from . import point_to_line


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


def is_corridor_like(information, angle):
    """Whether all but few points face across the direction `angle` [rad], by their `information` ``(3, 3)``: not so in a round room."""
    (xx, xy, _), (_, yy, _), _ = information.tolist()
    c, s = math.cos(angle), math.sin(angle)
    return c * c * xx + 2.0 * c * s * xy + s * s * yy < _FEW * (xx + yy)


def without_near_parallel(rows, angle, least, of=None):
    """`point_to_line.jacobian` as if walls that are all but along the direction `angle` [rad] were exactly along it.

    They would hold the way along it by their slant; but where all points of one are off by 1 cm, a range that is too long or a
    map that is too narrow, the way is off by 10 cm if the slant is 6 deg.

    Parameters
    ----------
    rows : (3 or more, P) array
    angle : float [rad]
    least : float
        The walls are those of points whose normals have less than this component along the direction.
    of : (3 or more, P) array, optional
        Derivatives by these normals; `rows` themselves when not given.
    """
    of = rows if of is None else of
    along = _along(rows, angle) * (np.abs(_along(of, angle)) < least * np.hypot(of[0], of[1]))
    rows = rows.copy()
    rows[0] -= math.cos(angle) * along
    rows[1] -= math.sin(angle) * along
    return rows


def _along(rows, angle):
    return math.cos(angle) * rows[0] + math.sin(angle) * rows[1]


def search_degenerate_direction(candidates, angles, reference, current, parameters, density):
    """Slide each candidate along its direction to where the few points that face that way fit best.

    Parameters
    ----------
    candidates : (H, 3) array
    angles : (H,) array [rad]
        In the reference's frame.
    reference, current : Features
    parameters : DegeneracyParameters
    density : DensityParameters

    Returns
    -------
    (H, 3) array
    """
    cloud = current.sampled_points
    facing = np.abs((np.exp(1j * (candidates[:, 2] - angles))[:, None] * cloud.normals).real).max(axis=0)
    cloud = cloud.select(facing > parameters.min_facing)
    if len(cloud) < parameters.min_points:
        return candidates
    along = np.array((np.cos(angles), np.sin(angles), np.zeros(len(angles)))).T
    for reach, step, scale in ((parameters.search_distance, 2.0 * parameters.search_scale, 3.0 * parameters.search_scale),
                               (2.5 * parameters.search_scale, 0.4 * parameters.search_scale, parameters.search_scale)):
        count = math.floor(reach / step)
        shift = np.arange(-count, count + 1) * step
        moved = (candidates[:, None] + shift[:, None] * along[:, None]).reshape(-1, 3)
        fit = point_to_line.fit(moved, cloud, reference.likelihood_field, density.min_normal_cosine)
        component = (fit.normals * np.exp(1j * angles).repeat(len(shift))[:, None]).real
        violation = reference.free_space.violation(fit.places, cloud.tolerance(density.violation_tolerance))
        weight = fit.weight(scale)
        value = (weight * component ** 2 - density.violation_weight * violation * (1.0 - weight)).sum(axis=1)
        value = value.reshape(-1, len(shift)) - 1e-9 * np.abs(shift)
        best = value.argmax(axis=1)
        candidates = candidates + shift[best][:, None] * along
    return candidates


_FEW = 0.1
"""Share of all information about translations that a few points hold along a corridor, at most."""
