# SPDX-License-Identifier: Apache-2.0
"""Translations from squared line equations, which do not determine the sign (section 2.2.2, Eq. 12-15)."""
import math

import numpy as np

from ...features.records import Segments
from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2, as_complex
from ...parameters.registration import TranslationParameters
from ..records import TranslationSamples
from ..rotation import Rotations


def squared_form(reference: Segments, current: Segments, rotations: Rotations, weights: FloatArray,
                 parameters: TranslationParameters) -> TranslationSamples:
    """Return the samples of `squared_samples` for every rotation, each with weight 1; `weights` is ignored."""
    del weights
    solutions = [squared_samples(reference, current, phi, parameters) for phi in rotations.phi.tolist()]
    samples = as_complex(np.concatenate([np.empty((0, 2)), *solutions]))
    rotation = np.repeat(np.arange(len(solutions)), [len(each) for each in solutions])
    return TranslationSamples(samples, np.ones(len(samples)), rotation)


def squared_samples(reference: Segments, current: Segments, phi: float,
                    parameters: TranslationParameters) -> FloatArray:
    """Solve all pairs of non-parallel squared line equations for one rotation.

    Two pairs of lines (Eq. 13) give ``(n1 . t)^2 = d1^2`` and ``(n2 . t)^2 = d2^2`` (Eq. 15): four translations.
    Translations with the right signs form one key cluster, and those with both signs wrong a second one; translations
    with one wrong sign scatter.

    Parameters
    ----------
    reference, current : Segments
    phi : float
        The rotation [rad].
    parameters : TranslationParameters

    Returns
    -------
    (4 K, 2) array [m]
    """
    angle, distance = line_equations(reference, current, phi, parameters)
    nx, ny = -np.sin(angle), np.cos(angle)
    first, second = np.triu_indices(len(angle), 1)
    determinant = nx[first] * ny[second] - ny[first] * nx[second]
    crossing = np.abs(determinant) > parameters.min_crossing_sine
    first, second, determinant = first[crossing], second[crossing], determinant[crossing, None]
    one = np.stack((ny[second], -nx[second]), axis=1) * distance[first, None] / determinant
    two = np.stack((-ny[first], nx[first]), axis=1) * distance[second, None] / determinant
    return np.concatenate((one + two, one - two, two - one, -one - two))


def line_equations(reference: Segments, current: Segments, phi: float,
                   parameters: TranslationParameters) -> tuple[FloatArray, FloatArray]:
    """Match the lines that the rotation makes parallel (Eq. 12), and compute their distances (Eq. 14).

    eps1 starts at `translation.parallel_sigma` and shrinks until no more pairs are left than the current scan has
    segments.

    Returns
    -------
    angle : (L,) array [rad]
        Direction of each pair: the mean of the directions of its two lines, modulo pi.
    distance : (L,) array [m]
        Distance from the rotated midpoint of the current scan's segment (Eq. 10) to the reference's line.
    """
    difference = reference.direction[:, None] - (current.direction + phi)
    difference = (difference + 0.5 * math.pi) % math.pi - 0.5 * math.pi
    size = np.sort(np.abs(difference), axis=None)
    eps1 = parameters.parallel_sigma
    if len(size) > len(current):
        eps1 = min(eps1, size[len(current)])
    r, o = np.nonzero(np.abs(difference) < eps1)
    angle = reference.direction[r] - 0.5 * difference[r, o]
    apart = reference.midpoint[r] - SE2(0.0, 0.0, phi).apply(current.midpoint)[o]
    return angle, np.abs(np.cos(angle) * apart[:, 1] - np.sin(angle) * apart[:, 0])
