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
    edges = segments[:, 1] - segments[:, 0]
    offsets = segments[:, 0] - origins[:, None]
    determinant = _cross(directions[:, None], edges)
    crossing = determinant != 0.0
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=crossing)
    distance = _cross(offsets, edges) * inverse
    along = _cross(offsets, directions[:, None]) * inverse
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


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
