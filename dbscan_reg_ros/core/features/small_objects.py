# SPDX-License-Identifier: Apache-2.0
"""Small objects of a scan, and poles: small objects without normals, such as chair legs and tree trunks."""
import dataclasses
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import as_complex
from ..geometry.tolerance import SIGMAS, TINY
from ..parameters.features import SegmentParameters
from .oriented_points import OrientedPoints
from .point_sequence import find_breaks
from .records import Features

_POINTS = 8
"""Number of oriented points around a pole."""
_AROUND = np.exp(2j * np.pi * np.arange(_POINTS) / _POINTS)
"""Directions from the centre of a pole to its oriented points, the first one towards the sensor."""
_SURFACES = 2.0
"""Weight of a return from a pole relative to a return from a wall: a pole constrains the motion along two axes."""


def with_poles(features: Features, size: float, parameters: SegmentParameters) -> Features:
    """Add the poles of a scan as oriented points on a circle around each pole, facing away from its centre.

    A small object none of whose points has a normal is a pole. A point with a normal constrains the motion across its
    surface; a pole constrains it in every direction. A pole is assumed to be round and as wide as its beams, at most
    `size`. The weights of the points that represent a pole add up to twice the weight of the pole's returns, as if each
    return lay on two surfaces.

    Parameters
    ----------
    features : Features
    size : float
        Poles are smaller than this [m].
    parameters : SegmentParameters

    Returns
    -------
    Features
        The features with poles; `features` itself if the scan has none.
    """
    if as_complex(features.normals).all():
        return features
    objects = find_small_objects(features, size, parameters)
    return with_poles_at(features, objects, size) if objects.without_normals.any() else features


def with_poles_at(features: Features, objects: 'SmallObjects', size: float) -> Features:
    """Add those of the `objects` as poles that have no normals; poles are at most as wide as a `size` [m]."""
    poles = objects.without_normals.nonzero()[0]
    front, width = objects.front[poles], objects.width[poles]
    half = np.minimum(0.5 * width, 0.5 * size)
    towards = -front / np.maximum(np.abs(front), TINY)
    normals = towards[:, None] * _AROUND
    points = (front - half * towards)[:, None] + half[:, None] * normals
    weights = np.minimum(_SURFACES * objects.returns[poles] / _POINTS, 1.0)
    return dataclasses.replace(features, poles=OrientedPoints(
        points.ravel(), normals.ravel(), objects.beam[poles].repeat(_POINTS), weights.repeat(_POINTS)))


class SmallObjects(NamedTuple):
    """The T small objects of a scan.

    Attributes
    ----------
    beam : (T,) int
        First beam with a return from each object.
    returns : (T,) int
        Number of returns from each object.
    nearest : (T,) float [m]
        Smallest range of each object.
    front : (T,) complex [m]
        Midpoint of the first and the last point of each object.
    width : (T,) float [m]
        Width of each object: the width covered by `returns` beams at the distance of `front`.
    without_normals : (T,) bool
        Whether no point of the object has a normal.
    """

    beam: IntArray
    returns: IntArray
    nearest: FloatArray
    front: ComplexArray
    width: FloatArray
    without_normals: BoolArray

    @property
    def middle(self) -> ComplexArray:
        """``(T,)`` complex [m]: centre of each object, under the assumption that it is round."""
        return self.front * ((self.nearest + 0.5 * self.width) / np.maximum(np.abs(self.front), TINY))


class _Ring(NamedTuple):
    """Points of a scan in beam order, starting at a break if the beams cover the full circle.

    Attributes
    ----------
    beams : (P,) int
        Beam of each point in increasing order; after a full circle, beam numbers continue above that of the last beam.
    points : (P,) complex [m]
    without_normal : (P,) bool
    breaks : (P - 1,) bool
        True if a point and the next one lie on different surfaces, as in `Features`.
    """

    beams: IntArray
    points: ComplexArray
    without_normal: BoolArray
    breaks: BoolArray


def find_small_objects(features: Features, size: float, parameters: SegmentParameters) -> SmallObjects:
    """Find surfaces (Eq. 5) smaller than a `size` [m] with a larger range, or no return, on both sides."""
    geometry = features.scan.geometry
    circle = round(2.0 * np.pi / abs(geometry.angle_increment)) if geometry.closed else geometry.size
    beams, points, without_normal, breaks = _ring(features, circle, parameters)
    if not len(points):
        return SmallObjects(beams, beams, np.abs(points), points, np.abs(points), points == 0.0)
    radius = np.abs(points)
    start = np.concatenate(([0], breaks.nonzero()[0] + 1))
    first, last = start, np.append(start[1:], len(points)) - 1
    inner = np.arange(len(first)) if geometry.closed else np.arange(1, len(first) - 1)
    before, after = last[inner - 1], first[(inner + 1) % len(first)]
    first, last = first[inner], last[inner]
    margin = parameters.depth_margin + SIGMAS * features.noise
    free = (radius[before] > radius[first] + margin) | ((beams[first] - beams[before]) % circle > 1)
    free &= (radius[after] > radius[last] + margin) | ((beams[after] - beams[last]) % circle > 1)
    free &= np.abs(points[last] - points[first]) < size
    inner, first, last = inner[free], first[free], last[free]
    front, returns = 0.5 * (points[first] + points[last]), last - first + 1
    return SmallObjects(
        beam=beams[first] % circle, returns=returns, nearest=np.minimum.reduceat(radius, start)[inner], front=front,
        width=returns * abs(geometry.angle_increment) * np.abs(front),
        without_normals=np.logical_and.reduceat(without_normal, start)[inner])


def _ring(features: Features, circle: int, parameters: SegmentParameters) -> _Ring:
    """Order the points so that no surface continues from the last to the first; `circle` beams cover 360 degrees."""
    geometry, beams, breaks = features.scan.geometry, features.beams, features.breaks
    points, without_normal = as_complex(features.points), as_complex(features.normals) == 0.0
    if not geometry.closed or not breaks.any():
        return _Ring(beams, points, without_normal, breaks)
    start = int(breaks.argmax()) + 1
    seam = find_breaks(points[[-1, 0]], np.array((beams[-1], beams[0] + circle)), geometry.angle_increment,
                       features.noise, parameters)
    return _Ring(np.concatenate((beams[start:], beams[:start] + circle)), np.roll(points, -start),
                 np.roll(without_normal, -start), np.concatenate((breaks[start:], seam, breaks[:start - 1])))
