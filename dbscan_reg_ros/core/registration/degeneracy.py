# SPDX-License-Identifier: Apache-2.0
"""The degenerate direction of a match, and the search along it (corridors)."""
import math

import numpy as np

from ..geometry.array_types import BoolArray, FloatArray
from ..geometry.se2 import DOF, unit_complex
from ..geometry.ties import first_largest
from ..geometry.tolerance import TINY
from .search import Problem


def weakest_direction(information: FloatArray) -> tuple[float, float, float]:
    """Find the direction in which a match constrains the translation least, for an unknown rotation.

    Parameters
    ----------
    information : (3, 3) array

    Returns
    -------
    angle : float [rad], modulo pi
    weak, strong : float
        Information along that direction and perpendicular to it.
    """
    (xx, xy, x), (_, yy, y), (_, _, rotation) = information.tolist()
    rotation = max(rotation, TINY)
    xx, xy, yy = xx - x * x / rotation, xy - x * y / rotation, yy - y * y / rotation
    half, root = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    return 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi, max(half - root, 0.0), half + root


def is_corridor_like(information: FloatArray, angle: float) -> bool:
    """Whether few points have normals along the direction `angle` [rad], judged from the information ``(3, 3)``."""
    (xx, xy, _), (_, yy, _), _ = information.tolist()
    c, s = math.cos(angle), math.sin(angle)
    return bool(c * c * xx + 2.0 * c * s * xy + s * s * yy < CORRIDOR_RATIO * (xx + yy))


CORRIDOR_RATIO = 0.1
"""A corridor has less than this ratio of the information along its axis to the information in both directions."""


def without_near_parallel(rows: FloatArray, motion: FloatArray, min_component: float,
                          of: FloatArray | None = None) -> FloatArray:
    """Return a `point_to_line.jacobian` in which near-parallel walls count as parallel to a degenerate `motion`.

    Unless they count as parallel, these walls seem to constrain the motion along them. But an error of 1 cm that all
    points of a wall share, due to a range offset or the map, shifts it by 10 cm at an angle of 6 deg.

    Parameters
    ----------
    rows : (3 or more, P) array
    motion : (3,) array
        A translation of 1 m and the rotation that goes with it [rad], as `uncertainty.parallel_motion` returns
        it. In a curved corridor it is an arc.
    min_component : float
        A wall is near-parallel where the motion moves its points by less than this [m] across it.
    of : (3 or more, P) array, optional
        Jacobian, computed with the normals of the walls, from which near-parallel walls are found; by default `rows`.
    """
    of = rows if of is None else of
    near_parallel: BoolArray = np.abs(motion @ of[:DOF]) < min_component * np.hypot(of[0], of[1])
    across = (motion @ rows[:DOF]) * near_parallel
    rows = rows.copy()
    rows[:2] -= motion[:2, None] * across
    return rows


def search_degenerate_direction(candidates: FloatArray, angles: FloatArray, problem: Problem) -> FloatArray:
    """Shift each candidate along its degenerate direction to where the points with normals in this direction fit best.

    Parameters
    ----------
    candidates : (H, 3) array
    angles : (H,) array [rad]
        Degenerate direction of each candidate in the reference's frame.
    problem : Problem

    Returns
    -------
    (H, 3) array
    """
    p, density, points = problem.parameters.degeneracy, problem.parameters.density, problem.current.sampled_points
    facing = np.abs((unit_complex(candidates[:, 2] - angles)[:, None] * points.normals).real).max(axis=0)
    points = points.select(facing > problem.parameters.translation.min_crossing_sine)
    if len(points) < p.min_points:
        return candidates
    along = np.array((np.cos(angles), np.sin(angles), np.zeros(len(angles)))).T
    last = problem.parameters.refinement.score_scale
    for reach, step, scale in (p.search_distance, 2.0 * last, 3.0 * last), (2.5 * last, 0.4 * last, last):
        count = math.floor(reach / step)
        # The shortest come first: of equal values that of the shortest shift is chosen.
        shift = np.array(sorted(range(-count, count + 1), key=abs)) * step
        moved = (candidates[:, None] + shift[:, None] * along[:, None]).reshape(-1, DOF)
        found = problem.fit(moved, points)
        component = (found.normals * unit_complex(angles).repeat(len(shift))[:, None]).real
        violation = problem.reference.free_space.violation(found.places, points.tolerance(density.violation_tolerance))
        weight = found.weight(scale)
        value = (weight * component ** 2 - density.violation_weight * violation * (1.0 - weight)).sum(axis=1)
        best = first_largest(value.reshape(-1, len(shift)) - TINY * np.abs(shift))
        candidates = candidates + shift[best][:, None] * along
    return candidates
