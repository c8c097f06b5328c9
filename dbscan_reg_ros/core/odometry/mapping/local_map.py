# SPDX-License-Identifier: Apache-2.0
"""Local map: the points of the latest key frame and the points of older key frames in its surroundings."""
import cmath
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...features.oriented_points import OrientedPoints
from ...parameters.registration import DensityParameters
from .key_frame import KeyFrame


def older_map_points(older: Sequence[KeyFrame], latest: KeyFrame, density: DensityParameters) -> OrientedPoints:
    """Collect the points of older key frames that complete the latest key frame, in the frame of the latest.

    In each cell of the map the points of the newest key frame are kept. Points in the free space of the latest key
    frame are dropped, and so are points farther from it than the largest range of any key frame.

    Parameters
    ----------
    older : sequence of KeyFrame
        The oldest first.
    latest : KeyFrame
    density : DensityParameters
    """
    features, clouds = latest.features, [frame.features.sampled_points for frame in older]
    to_latest = latest.pose.inverse()
    sizes, motions = [len(oriented) for oriented in clouds], [to_latest @ frame.pose for frame in older]
    rotation = np.repeat([cmath.rect(1.0, motion.theta) for motion in motions], sizes)
    translation = np.repeat([complex(motion.x, motion.y) for motion in motions], sizes)
    age_rank = np.repeat(np.arange(len(older)), sizes)
    points, normals, beams = (
        np.concatenate([getattr(oriented, name) for oriented in clouds]) for name in ('points', 'normals', 'beams'))
    own_points = features.oriented_points.points
    max_range = max(np.abs(each).max(initial=0.0) for each in (points, own_points))
    points = rotation * points + translation
    kept = (np.abs(points) <= max_range) & (features.free_space.violation(points, density.violation_tolerance) == 0.0)
    kept[kept] = newest_in_cell(points[kept], age_rank[kept], own_points, density.cell_size)
    return OrientedPoints(points[kept], (rotation * normals)[kept], beams[kept])


def newest_in_cell(points: NDArray[np.complex128], age_rank: NDArray[np.intp], latest: NDArray[np.complex128],
                   cell_size: float) -> NDArray[np.bool_]:
    """Return ``(P,)``: whether no point in the same cell has a higher rank or belongs to the `latest` key frame."""
    cells = np.concatenate((points, latest)) / cell_size
    age_rank = np.concatenate((age_rank, np.full(len(latest), len(cells))))
    _, cell = np.unique(np.rint(cells.real) * _ROW + np.rint(cells.imag), return_inverse=True)
    newest = np.zeros(len(cells), dtype=int)
    np.maximum.at(newest, cell, age_rank)
    kept: NDArray[np.bool_] = age_rank == newest[cell]
    return kept[:len(points)]


_ROW = 2.0 ** 26
"""Cells per row of the map: larger than any map, so that each cell has a unique index."""
