# SPDX-License-Identifier: Apache-2.0
"""Key-frame decision: whether a scan becomes a key frame.

A scan becomes the latest key frame if `is_due` is true. If only `completes_map` is true, the scan is inserted into the
window before the latest key frame. The first scans of a track, of a further sensor and of a chain become key frames
without this decision (`update.start`, `join`, `follow`).
"""
import math

from ..mapping.key_frame_window import KeyFrameWindow
from ..mapping.scan_to_map import sees_new_surface
from ..parameters.tree import Parameters
from .alignment import Aligned
from .references import Match


def is_due(match: Match, aligned: Aligned, overlap: float, window: KeyFrameWindow, sensor: str, p: Parameters) -> bool:
    """Whether a scan becomes the latest key frame.

    It does if it is far from the latest one of its sensor, rotated, or has too little overlap; if it was registered to
    another reference, or its sensor has no key frame; and always if `odometry.reference` is ``previous``.

    Parameters
    ----------
    match : Match
    aligned : Aligned
    overlap : float
        `Registration.overlap` of the scan.
    window : KeyFrameWindow
    sensor : str
        Name of the sensor of the scan.
    p : Parameters
    """
    frame = match.key_frame
    motion = frame.pose.inverse() @ aligned.pose
    return (p.odometry.reference == 'previous' or sensor not in window.sensors
            or frame is not window.frames_of(sensor)[-1]
            or math.hypot(motion.x, motion.y) > p.odometry.key_frame_distance
            or abs(motion.theta) > p.odometry.key_frame_angle or overlap < p.odometry.key_frame_overlap)


def completes_map(match: Match, aligned: Aligned, p: Parameters) -> bool:
    """Whether a scan sees surfaces that no key frame contains and that would constrain a degenerate direction."""
    direction, correspondences = match.degenerate_direction, aligned.correspondences
    if direction is None or correspondences is None:
        return False
    return sees_new_surface(match.features, aligned.pose, correspondences, direction, p)
