# SPDX-License-Identifier: Apache-2.0
"""Translations from squared line equations, which leave the sign open (section 2.2.2, Eq. 12-15)."""
import math

import numpy as np

from ...features.records import Segments
from ...geometry.se2 import SE2
from ...parameters.registration import TranslationParameters


def squared_samples(reference: Segments, current: Segments, phi, parameters: TranslationParameters):
    """All solutions of all pairs of non-parallel squared line equations for one rotation.

    Two pairs of lines (Eq. 13) ask for ``(n1 . t)^2 = d1^2`` and ``(n2 . t)^2 = d2^2`` (Eq. 15): four translations.
    Those with the right signs, and all those opposite, meet in two key clusters; the mixed signs scatter.

    Parameters
    ----------
    phi : float
        The rotation [rad].

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


def line_equations(reference: Segments, current: Segments, phi, parameters: TranslationParameters):
    """Pairs of lines that the rotation makes parallel (Eq. 12), and how far apart they lie (Eq. 14).

    eps1 starts at `parallel` and shrinks until no more pairs are left than the current scan has segments.

    Returns
    -------
    angle : (L,) array [rad]
        Direction of each pair: the mean of its two lines', modulo pi.
    distance : (L,) array [m]
        From the midpoint of the current scan's segment, rotated (Eq. 10), to the reference's line.
    """
    turn = reference.direction[:, None] - (current.direction + phi)
    turn = (turn + 0.5 * math.pi) % math.pi - 0.5 * math.pi
    size = np.sort(np.abs(turn), axis=None)
    eps1 = parameters.parallel_sigma if len(size) <= len(current) else min(parameters.parallel_sigma, size[len(current)])
    r, o = np.nonzero(np.abs(turn) < eps1)
    angle = reference.direction[r] - 0.5 * turn[r, o]
    apart = reference.midpoint[r] - SE2(0.0, 0.0, phi).apply(current.midpoint)[o]
    return angle, np.abs(np.cos(angle) * apart[:, 1] - np.sin(angle) * apart[:, 0])
