# SPDX-License-Identifier: Apache-2.0
"""Detection of dynamic points (people, doors, robots), which lie in free space of key frames, and movable objects."""
import numpy as np
from numpy.typing import NDArray

from ...accelerated.steps import beside, confirm, detached_points, dynamic_points, information_ratio
from ...features.records import Features
from ...geometry.se2 import SE2
from ...parameters.tree import Parameters
from .key_frame_window import KeyFrameWindow


def without_dynamic_points(features: Features, pose: SE2, window: KeyFrameWindow, parameters: Parameters,
                           sensor: str = '') -> Features:
    """Remove the dynamic points of a scan, and reduce the weights of movable objects.

    Movable objects and poles keep their weight if a key frame from another position contains them at the same place.

    Parameters
    ----------
    features : Features
    pose : SE2
        Pose of the scan in the odometry frame.
    window : KeyFrameWindow
    parameters : Parameters
    sensor : str
        Name of the sensor of the scan. Only its own key frames show free space: a lidar at another height sees over
        what this one sees.
    """
    p = parameters.odometry
    features, candidates = _remove_dynamic(features, pose, window.of_sensor(sensor), parameters)
    walls = features.wall_points
    movable = candidates.nonzero()[0]
    if len(movable) and information_ratio(walls, movable) < p.movable_information_ratio:
        movable = movable[:0]
    if features.poles:
        movable = np.concatenate((movable, np.arange(len(walls), len(features.oriented_points))))
    if not len(movable):
        return features
    points = features.oriented_points.select(movable)
    confirmed = confirm(window, pose, points, p.static_baseline, parameters.refinement.score_scale,
                        parameters.density.min_normal_cosine)
    return features.downweighted(movable, np.maximum(confirmed, p.movable_weight))


def _remove_dynamic(features: Features, pose: SE2, window: KeyFrameWindow,
                    parameters: Parameters) -> tuple[Features, NDArray[np.bool_]]:
    """Remove the dynamic points; also return which of the remaining wall points are movable."""
    p, walls = parameters.odometry, features.wall_points
    points = features.oriented_points
    movable = detached_points(walls, p.movable_size, p.dynamic_margin, features.scan.geometry.closed)
    if not p.dynamic_key_frames:
        return features, movable
    free_space, static = window.free_space(p.dynamic_key_frames), np.ones(len(points), dtype=bool)
    static[:len(walls)] = ~movable
    dynamic = dynamic_points(points, pose, free_space, p.dynamic_margin, static)
    if not dynamic.any():
        return features, movable
    removed = dynamic[:len(walls)]
    movable = (movable | beside(walls, removed, p.dynamic_margin))[~removed]
    return features.without(dynamic), movable
