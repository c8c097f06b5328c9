# SPDX-License-Identifier: Apache-2.0
"""Ray casting: distances from the sensor to the nearest surface along all beams at once."""
import numpy as np

EDGE = 1e-9
"""Segments are extended by this fraction of their length at both ends, so that joints of walls have no gaps."""
_MARGIN = 1e-6
"""Margin [m] by which a ray may miss a surface that is looked at closely; far above all rounding errors."""


def cast(origins, directions, segments, circles):
    """Compute the distance from the origin of each ray to the first surface along its direction.

    The line of most rays passes most surfaces at a distance. Those pairs are sorted out first, by the cross products of
    the directions and the vectors to ends of segments and to centres of circles, which are products of matrices.

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
    distances = np.full(len(directions), np.inf)
    origins = np.broadcast_to(origins, directions.shape)
    x, y = directions.T
    lines = np.column_stack((y, -x, origins[:, 1] * x - origins[:, 0] * y))
    starts, ends, centres = (lines @ np.vstack((points.T, np.ones(len(points))))
                             for points in (segments[:, 0], segments[:, 1], circles[:, :2]))
    reach = np.abs(segments[:, 1] - segments[:, 0]).sum(axis=1) + 1.0
    starts *= ends
    rays, surfaces = _pairs(starts <= _MARGIN * reach**2)
    np.minimum.at(distances, rays, _to_segments(origins[rays], directions[rays], segments[surfaces]))
    rays, surfaces = _pairs(np.abs(centres, out=centres) <= circles[:, 2] + _MARGIN)
    np.minimum.at(distances, rays, _to_circles(origins[rays], directions[rays], circles[surfaces]))
    return distances


def _pairs(near):
    """Return the indices of rays and surfaces where the (B, S) array is true."""
    return np.divmod(np.flatnonzero(near), max(near.shape[1], 1))


def _to_segments(origins, directions, segments):
    """Return the distance (N,) along each ray to its segment; `inf` if it does not hit it."""
    (x, y), (offset_x, offset_y) = directions.T, (segments[:, 0] - origins).T
    edge_x, edge_y = (segments[:, 1] - segments[:, 0]).T
    determinant = x * edge_y - y * edge_x
    crossing = determinant != 0.0
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=crossing)
    distance = (offset_x * edge_y - offset_y * edge_x) * inverse
    along = (offset_x * y - offset_y * x) * inverse
    hit = crossing & (distance >= 0.0) & (along >= -EDGE) & (along <= 1.0 + EDGE)
    return np.where(hit, distance, np.inf)


def _to_circles(origins, directions, circles):
    """Return the distance (N,) along each ray to its circle, also from inside; `inf` if it does not hit it."""
    offsets = circles[:, :2] - origins
    middle = (offsets * directions).sum(axis=-1)
    half_chord_squared = circles[:, 2]**2 - (offsets**2).sum(axis=-1) + middle**2
    half_chord = np.sqrt(np.maximum(half_chord_squared, 0.0))
    near, far = middle - half_chord, middle + half_chord
    hit = (half_chord_squared >= 0.0) & (far >= 0.0)
    return np.where(hit, np.where(near >= 0.0, near, far), np.inf)
