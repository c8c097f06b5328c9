"""Posts: small things that stand free and have no normals, such as the legs of chairs and the trunks of trees."""
import dataclasses

import numpy as np

from .records import Features
from .se2 import as_complex
from .segments import find_breaks
from .surface import Cloud

# Directions all around, the first of them towards the sensor.
_AROUND = np.exp(2j * np.pi * np.arange(8) / 8)


def with_posts(features: Features, size, parameters) -> Features:
    """The same, and in place of each post points all around it that face away from its middle.

    A run of points (Eq. 5) none of which has a normal is a post where what lies beside it is deeper, or nothing, on both
    sides. A point that has a normal holds the motion across its surface; a post holds it in every direction. It is taken to be
    round and as wide as its beams are, at most `size`. All its points together count as much as if each of its returns lay on
    two surfaces.

    Parameters
    ----------
    features : Features
    size : float [m]
        Posts are smaller than this.
    parameters : SegmentParameters

    Returns
    -------
    Features
    """
    bare = as_complex(features.normals) == 0.0
    if not bare.any():
        return features
    geometry, beams, points = features.scan.geometry, features.beams, as_complex(features.points)
    radius = np.abs(points)
    breaks = find_breaks(points, radius, beams, geometry, features.noise, parameters)
    turn = round(2.0 * np.pi / abs(geometry.angle_increment)) if geometry.closed else geometry.size
    if geometry.closed and breaks.any():
        # From a break on: no run goes on from the last beam to the first.
        start = breaks.argmax() + 1
        beams = np.concatenate((beams[start:], beams[:start] + turn))
        points, radius, bare = (np.roll(each, -start) for each in (points, radius, bare))
        breaks = find_breaks(points, radius, beams, geometry, features.noise, parameters)
    first = np.concatenate(([0], breaks.nonzero()[0] + 1))
    last = np.append(first[1:], len(points)) - 1
    at = np.logical_and.reduceat(bare, first).nonzero()[0]
    if not geometry.closed:
        at = at[(at > 0) & (at < len(first) - 1)]
    before, after = last[at - 1], first[(at + 1) % len(first)]
    first, last = first[at], last[at]
    margin = parameters.depth_margin + 3.0 * features.noise
    free = (radius[before] > radius[first] + margin) | ((beams[first] - beams[before]) % turn > 1)
    free &= (radius[after] > radius[last] + margin) | ((beams[after] - beams[last]) % turn > 1)
    free &= np.abs(points[last] - points[first]) < size
    if not free.any():
        return features
    first, last = first[free], last[free]
    count, front = last - first + 1, 0.5 * (points[first] + points[last])
    half = np.minimum(0.5 * count * abs(geometry.angle_increment) * np.abs(front), 0.5 * size)
    towards = -front / np.maximum(np.abs(front), 1e-9)
    normals = towards[:, None] * _AROUND
    around = (front - half * towards)[:, None] + half[:, None] * normals
    worth = np.minimum(2.0 * count / len(_AROUND), 1.0)
    posts = Cloud(*(each.ravel() for each in (around, normals)), *(each.repeat(len(_AROUND)) for each in (beams[first] % turn, worth)))
    return dataclasses.replace(features, posts=posts)
