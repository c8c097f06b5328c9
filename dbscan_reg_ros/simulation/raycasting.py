# SPDX-License-Identifier: Apache-2.0
"""Distances along rays, all beams against all surfaces at once."""
import numpy as np

EDGE = 1e-9
"""A ray that passes the end of a segment by this fraction of its length still hits it: joints have no gaps."""


def cast(origins, directions, segments, circles):
    """Distance from each origin to the first surface along its direction.

    Parameters
    ----------
    origins : (B, 2) or (1, 2) float [m]
    directions : (B, 2) float
        Unit vectors.
    segments : (S, 2, 2) float [m]
        Start and end of each.
    circles : (C, 3) float [m]
        Centre and radius of each.

    Returns
    -------
    (B,) float [m]
        `inf` where nothing is hit.
    """
    to_segments = _to_segments(origins, directions, segments)
    to_circles = _to_circles(origins, directions, circles)
    return np.minimum(to_segments.min(axis=1, initial=np.inf), to_circles.min(axis=1, initial=np.inf))


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
