# SPDX-License-Identifier: Apache-2.0
"""The local map: the latest key frame, and around it what older ones saw."""
import cmath

import numpy as np

from ...features.oriented_points import OrientedPoints


def seen_around(older, latest, density) -> OrientedPoints:
    """The points of older key frames that belong to a map in the frame of the latest.

    Of the points in one cell of the table those of the newest key frame count. What stands in front of what the latest saw is
    gone, and what lies farther off than any of them saw is out of sight.

    Parameters
    ----------
    older : sequence of KeyFrame
        Oldest first.
    latest : KeyFrame
    density : DensityParameters
    """
    here, clouds = latest.features, [frame.features.sampled_points for frame in older]
    ways = [latest.pose.inverse() @ frame.pose for frame in older]
    turn, way = (np.repeat(each, [len(cloud) for cloud in clouds]) for each in (
        [cmath.exp(1j * each.theta) for each in ways], [complex(each.x, each.y) for each in ways]))
    rank = np.repeat(np.arange(len(older)), [len(cloud) for cloud in clouds])
    points, normals, beams = (np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in ('points', 'normals', 'beams'))
    farthest = max(np.abs(each).max(initial=0.0) for each in (points, here.oriented_points.points))
    points = turn * points + way
    kept = (np.abs(points) <= farthest) & (here.free_space.violation(points, density.violation_tolerance) == 0.0)
    kept[kept] = _newest(points[kept], rank[kept], here.oriented_points.points, density.cell_size)
    return OrientedPoints(points[kept], (turn * normals)[kept], beams[kept])


def _newest(points, rank, latest, cell):
    """``(P,)`` bool: the `points` in whose cell there is none of a higher rank, and none of the `latest`."""
    places = np.concatenate((points, latest)) / cell
    rank = np.concatenate((rank, np.full(len(latest), len(places))))
    _, cells = np.unique(np.rint(places.real) * _ROW + np.rint(places.imag), return_inverse=True)
    newest = np.zeros(len(places), dtype=int)
    np.maximum.at(newest, cells, rank)
    return (rank == newest[cells])[:len(points)]


_ROW = 2.0 ** 26
"""More cells than any table has along a side."""
