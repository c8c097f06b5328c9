# SPDX-License-Identifier: Apache-2.0
"""Posts: small things that stand free and have no normals, such as the legs of chairs and the trunks of trees."""
import dataclasses
from typing import NamedTuple

import numpy as np

from ..geometry.se2 import as_complex
from .oriented_points import OrientedPoints
from .records import Features
from .segments import find_breaks

# Directions all around, the first of them towards the sensor.
_AROUND = np.exp(2j * np.pi * np.arange(8) / 8)


def with_poles(features: Features, size, parameters) -> Features:
    """The same, and in place of each post points all around it that face away from its middle.

    A small thing that stands free is a post if none of its points has a normal. A point that has one holds the motion across
    its surface; a post holds it in every direction. It is taken to be round and as wide as its beams are, at most `size`. All
    its points together count as much as if each of its returns lay on two surfaces.

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
    things = find_small_objects(features, size, parameters)
    chosen = things.bare.nonzero()[0]
    if not len(chosen):
        return features
    beams, returns, _, front, width, _ = (each[chosen] for each in things)
    half = np.minimum(0.5 * width, 0.5 * size)
    towards = -front / np.maximum(np.abs(front), 1e-9)
    normals = towards[:, None] * _AROUND
    around = (front - half * towards)[:, None] + half[:, None] * normals
    weights = np.minimum(2.0 * returns / len(_AROUND), 1.0)
    poles = OrientedPoints(*(each.ravel() for each in (around, normals)), *(each.repeat(len(_AROUND)) for each in (beams, weights)))
    return dataclasses.replace(features, poles=poles)


class SmallObjects(NamedTuple):
    """Small things that stand free, T of them.

    Attributes
    ----------
    beam : (T,) int
        The first that returned from it.
    returns : (T,) int
        How many.
    nearest : (T,) float [m]
        Range of the nearest of them.
    front : (T,) complex [m]
        The middle between the first and the last of them.
    width : (T,) float [m]
        Of so many beams, there.
    bare : (T,) bool
        None of its points has a normal.
    """

    beam: np.ndarray
    returns: np.ndarray
    nearest: np.ndarray
    front: np.ndarray
    width: np.ndarray
    bare: np.ndarray

    @property
    def middle(self):
        """``(T,)`` complex [m]: the middle of each, if it is round."""
        return self.front * ((self.nearest + 0.5 * self.width) / np.maximum(np.abs(self.front), 1e-9))


def find_small_objects(features: Features, size, parameters) -> SmallObjects:
    """Runs of points (Eq. 5) smaller than a `size` [m] beside which it is deeper, or nothing, on both sides."""
    geometry, beams, points = features.scan.geometry, features.beams, as_complex(features.points)
    if not len(points):
        return SmallObjects(beams, beams, np.abs(points), points, np.abs(points), points == 0.0)
    bare = as_complex(features.normals) == 0.0
    radius = np.abs(points)
    breaks = find_breaks(points, radius, beams, geometry, features.noise, parameters)
    turn = round(2.0 * np.pi / abs(geometry.angle_increment)) if geometry.closed else geometry.size
    if geometry.closed and breaks.any():
        # From a break on: no run goes on from the last beam to the first.
        start = breaks.argmax() + 1
        beams = np.concatenate((beams[start:], beams[:start] + turn))
        points, radius, bare = (np.roll(each, -start) for each in (points, radius, bare))
        breaks = find_breaks(points, radius, beams, geometry, features.noise, parameters)
    start = np.concatenate(([0], breaks.nonzero()[0] + 1))
    first, last = start, np.append(start[1:], len(points)) - 1
    at = np.arange(len(first)) if geometry.closed else np.arange(1, len(first) - 1)
    before, after = last[at - 1], first[(at + 1) % len(first)]
    first, last = first[at], last[at]
    margin = parameters.depth_margin + 3.0 * features.noise
    free = (radius[before] > radius[first] + margin) | ((beams[first] - beams[before]) % turn > 1)
    free &= (radius[after] > radius[last] + margin) | ((beams[after] - beams[last]) % turn > 1)
    free &= np.abs(points[last] - points[first]) < size
    at, first, last = at[free], first[free], last[free]
    front, returns = 0.5 * (points[first] + points[last]), last - first + 1
    return SmallObjects(beams[first] % turn, returns, np.minimum.reduceat(radius, start)[at], front,
                  returns * abs(geometry.angle_increment) * np.abs(front), np.logical_and.reduceat(bare, start)[at])
