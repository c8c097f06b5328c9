# SPDX-License-Identifier: Apache-2.0
"""Ray casting: distances from the sensor to the nearest surface along all beams at once."""
import numpy as np

EDGE = 1e-9
"""Segments are extended by this fraction of their length at both ends, so that joints of walls have no gaps."""
_RAYS_AT_ONCE = 128
"""Number of rays in one batch; the arrays of rays and surfaces then stay in the processor cache."""


def cast(origins, directions, segments, circles):
    """Compute the distance from the origin of each ray to the first surface along its direction.

    Parameters
    ----------
    origins : (B, 2) or (1, 2) float [m]
        Origin of each ray, or one origin for all rays.
    directions : (B, 2) float
        Unit vector along each ray.
    segments : (S, 2, 2) float [m]
        Start and end of each segment.
    circles : (C, 3) float [m]
        Centre and radius of each circle.

    Returns
    -------
    (B,) float [m]
        Distance along each ray; `inf` if it hits no surface.
    """
    distances, shared = np.empty(len(directions)), len(origins) == 1
    for first in range(0, len(directions), _RAYS_AT_ONCE):
        some = slice(first, first + _RAYS_AT_ONCE)
        rays = origins if shared else origins[some], directions[some]
        distances[some] = np.minimum(_to_segments(*rays, segments).min(axis=1, initial=np.inf),
                                     _to_circles(*rays, circles).min(axis=1, initial=np.inf))
    return distances


def _to_segments(origins, directions, segments):
    # Components one by one, as arrays without gaps, which is faster than with pairs of numbers.
    x, y = np.ascontiguousarray(directions.T)[..., None]
    (first_x, first_y), edges = segments[:, 0].T, segments[:, 1] - segments[:, 0]
    edge_x, edge_y = np.ascontiguousarray(edges.T)
    offset_x, offset_y = first_x - origins[:, :1], first_y - origins[:, 1:]
    determinant = x * edge_y - y * edge_x
    crossing = determinant != 0.0
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=crossing)
    distance = (offset_x * edge_y - offset_y * edge_x) * inverse
    along = (offset_x * y - offset_y * x) * inverse
    hit = crossing & (distance >= 0.0) & (along >= -EDGE) & (along <= 1.0 + EDGE)
    return np.where(hit, distance, np.inf)


def _to_circles(origins, directions, circles):
    offsets = circles[:, :2] - origins[:, None]
    middle = (offsets * directions[:, None]).sum(axis=-1)
    half_chord_squared = circles[:, 2]**2 - (offsets**2).sum(axis=-1) + middle**2
    half_chord = np.sqrt(np.maximum(half_chord_squared, 0.0))
    near, far = middle - half_chord, middle + half_chord
    hit = (half_chord_squared >= 0.0) & (far >= 0.0)
    return np.where(hit, np.where(near >= 0.0, near, far), np.inf)
