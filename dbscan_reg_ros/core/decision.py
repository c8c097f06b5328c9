# SPDX-License-Identifier: Apache-2.0
"""What the best hypothesis is worth: status, covariance and the segments that it lays onto one another."""
import cmath
import dataclasses
import math
from functools import partial
from typing import NamedTuple

import numpy as np

from .alignment import derivatives, mean_square, normal_equations, shared_information
from .free_direction import between_walls, weakest_direction, without_slant
from .parameters import DecisionParameters, Parameters
from .records import Features, Hypothesis, Prior, Registration, Segments, Status
from .rotation import wrap_period
from .se2 import SE2, as_complex, turn_matrix, turned, wrap
from .selection import same
from .symmetric import inverse


def decide(fine, fine_score, overlap, found, coarse, coarse_score, reference: Features, current: Features, p: Parameters):
    """The `Registration` of the best of the refined hypotheses.

    Parameters
    ----------
    fine, fine_score, overlap : (H, 3), (H,), (H,) arrays
        Finely refined hypotheses, best first.
    found : Fit
        Of the best, for the points of the current scan's `cloud`.
    coarse, coarse_score : (G, 3), (G,) arrays
        All hypotheses after the coarse refinement: the rivals are among them.
    """
    best, limits = fine[0], p.decision
    covariance, held = uncertainty(best, found, current.cloud, max(reference.noise, current.noise), p)
    angle, free = held.angle, held.weak < limits.min_information
    level = slid(coarse, best, angle) if free else coarse
    rivals = ~same(level, best, limits.rival_distance, limits.rival_angle)
    top = coarse_score[~rivals].max(initial=fine_score[0])
    margin = float(top - coarse_score[rivals].max(initial=-1.0))
    covariance = covariance + scatter(best, coarse[rivals & (coarse_score > top - limits.min_margin)])
    status, reason = judge(float(fine_score[0]), margin, held, limits)
    hypotheses = tuple(Hypothesis(SE2.from_array(candidate), value) for candidate, value in zip(fine.tolist(), fine_score.tolist()))
    transform = hypotheses[0].transform
    matches = partial(match_segments, reference.segments, current.segments, transform, p.decision)
    return Registration(transform, covariance, status, float(overlap[0]), float(fine_score[0]), hypotheses,
                        math.remainder(angle, math.pi) if free else None, matches, reason, held.weak,
                        held.turn < limits.min_information)


def slid(candidates, one, angle):
    """Hypotheses ``(H, 3)``, each moved along the direction `angle` [rad] until it is level with `one` ``(3,)``."""
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    return candidates - np.outer((candidates - one) @ along, along)


def scatter(best, rivals):
    """What rivals ``(R, 3)`` as likely as the best ``(3,)`` add to its covariance, in its own frame."""
    if not len(rivals):
        return np.zeros((3, 3))
    off = rivals - best
    off[:, 2] = wrap(off[:, 2])
    off = off @ turn_matrix(best[2])
    return off.T @ off / (len(off) + 1)


def failed(reason):
    """A registration that found nothing."""
    return Registration(SE2(), np.diag([100.0, 100.0, 10.0]), Status.FAILED, reason=reason)


def judge(score, margin, held, parameters: DecisionParameters):
    """`Status` and the reason for it."""
    if score < parameters.min_score:
        return Status.FAILED, f'score {score:.2f} below {parameters.min_score}'
    if margin < parameters.min_margin:
        return Status.AMBIGUOUS, f'a rival scores within {max(margin, 0.0):.3f} of the best; {parameters.min_margin} asked for'
    if held.weak < parameters.min_information:
        return Status.DEGENERATE, few_points(held.weak, parameters.min_information)
    if held.turn < parameters.min_information:
        return Status.DEGENERATE, (f'only {held.turn:.2f} points, as if 1 m away, hold the rotation; '
                                   f'{parameters.min_information} asked for')
    return Status.OK, ''


def few_points(weak, asked):
    """The reason for ``DEGENERATE``."""
    return f'only {weak:.2f} points hold the motion along one direction; {asked} asked for'


def firmness(registration: Registration, parameters: DecisionParameters):
    """How firmly a scan holds the motion, from 0 to 1: in parts of the points that are asked for when it is not known."""
    weak, asked = registration.weakest, parameters.vague_information
    return 1.0 if weak is None or weak >= asked else weak / asked


def doubted(registration: Registration, prior: Prior, parameters: DecisionParameters):
    """`registration`, no longer ``OK`` where few points hold a motion of which nothing was known before.

    Along a corridor that repeats itself another place fits a few points as well as the true one does.
    """
    weak, spread = registration.weakest, prior.spread
    if registration.status is not Status.OK or firmness(registration, parameters) == 1.0 or spread <= parameters.vague:
        return registration
    reason = f'{few_points(weak, parameters.vague_information)} where the motion is expected to {spread:.2f} m only'
    return dataclasses.replace(registration, status=Status.DEGENERATE, reason=reason)


def uncertainty(candidate, found, cloud, noise, p: Parameters):
    """Covariance ``(3, 3)`` of a motion in the current sensor's frame, and what holds it, `Held`.

    The information is that of the points of a `cloud` as they were `found` there, a `Fit`, each as uncertain as the points that
    fit are, at least the range `noise` [m].
    """
    rows, own = derivatives(found.normals[0], found.arms[0]), own_derivatives(cloud.sharpened(cloud.normals), candidate[2], found.arms[0])
    weight = cloud.weighed(found.weight(p.refinement.score_scale))[0]
    covariance, held = match_covariance(found.error[0], weight, rows, own, noise, p.decision)
    return turned(covariance, -candidate[2]), held


def own_derivatives(normals, theta, arms):
    """``(3, P)`` `derivatives` by the points' own `normals` (complex), turned by `theta` [rad]."""
    return derivatives((cmath.exp(1j * theta) * normals).conj(), arms)


def match_covariance(error, weight, rows, own, noise, parameters: DecisionParameters, free_way=False, free_turn=False):
    """As `uncertainty`, from the errors [m] of points, their weights and derivatives, and the noise [m] of a range.

    Parameters
    ----------
    error, weight : (P,) arrays
    rows, own : (3, P) arrays
        As for `shared_information`.
    free_way, free_turn : bool
        The latest key frame leaves the translation along a direction, or the rotation, free: others have to hold it beyond
        chance, or cannot.
    """
    information, shared = normal_equations(rows, weight), shared_information(rows, weight, own)
    angle, weak, _ = weakest_direction(shared)
    if weak < parameters.vague_information and between_walls(shared, angle):
        straight, own_straight = (without_slant(each, angle, parameters.slant, of=rows) for each in (rows, own))
        shared = shared_information(straight, weight, own_straight)
    points = float(weight.sum())
    held = what_holds(information, shared, points, parameters)
    if free_way:
        chance = _chance(points) * (weakest_direction(information)[1] - held.weak)
        held = held._replace(weak=max(held.weak - chance, 0.0))
    if free_turn:
        held = held._replace(turn=0.0)
    return calibrated(information, shared, mean_square(error, weight) + noise ** 2, held, parameters), held


class Held(NamedTuple):
    """What holds a motion.

    Attributes
    ----------
    angle : float [rad]
        The direction of the translation that is known least.
    weak : float
        Points that hold it.
    turn : float
        Points, as if 1 m away, that hold the rotation.
    """

    angle: float
    weak: float
    turn: float


def what_holds(information, shared, points, parameters: DecisionParameters) -> Held:
    """What of the `information` ``(3, 3)`` of so many `points` is `shared` by both scans: noise on the normals holds nothing.

    Where only noise holds the rotation, as in a round room, a match turns to where that of both scans happens to agree.
    """
    angle, weak, _ = weakest_direction(shared)
    turn = _turn_information(shared, information, parameters)[0]
    noise = max(_turn_information(information, information, parameters)[0] - turn, 0.0)
    return Held(angle, weak, max(turn - _chance(points) * noise, 0.0))


def _chance(points):
    """The share of what noise seems to hold in which so many `points` of two scans may agree by chance."""
    return _CHANCE * math.sqrt(_ALIKE / max(points, 1.0))


def _turn_information(shared, information, parameters):
    """Of the rotation, whatever the translation, and the translation along x and y [m/rad] that goes with it."""
    (xx, xy, _), (_, yy, _), _ = information.tolist()
    x, y, turn = shared[2].tolist()
    xx, yy = xx + parameters.min_information, yy + parameters.min_information
    determinant = xx * yy - xy * xy
    along, across = (xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant
    return turn + along * x + across * y, along, across


def motion_along(angle, shared, parameters: DecisionParameters):
    """``(3,)``: a way of 1 m along `angle` [rad], and the turn [rad] that goes with it by the `shared` information ``(3, 3)``.

    What is held as long as nothing turns, as the way along the wall of a round room is, may be free where it turns.
    """
    (xx, xy, x), (_, yy, y), (_, _, turn) = shared.tolist()
    c, s = math.cos(angle), math.sin(angle)
    turns = min(c * c * xx + 2.0 * c * s * xy + s * s * yy, turn) > parameters.min_information
    return np.array([c, s, -(x * c + y * s) / turn if turns else 0.0])


def motion_around(information, shared, parameters: DecisionParameters):
    """``(3,)``: a turn of 1 rad, and the way [m] that goes with it; arguments as for `calibrated`."""
    _, *way = _turn_information(shared, information, parameters)
    return np.array((*way, 1.0))


def calibrated(information, shared, variance, held: Held, parameters: DecisionParameters):
    """Covariance of a motion from the information ``(3, 3)`` of its points, each with the `variance` [m^2].

    What holds a direction is the `shared` information ``(3, 3)``. Few points hold it less surely than their number says:
    their errors are not independent. What less than `min_information` hold is free.

    Returns
    -------
    (3, 3) array
    """
    variance = variance * parameters.covariance_scale
    known, _, known_turn = parameters.prior_information()
    posterior = information / variance
    posterior.flat[::4] += parameters.prior_information()
    covariance = inverse(posterior)
    along, free = motion_along(held.angle, shared, parameters), 1.0 / known
    extra = free if held.weak < parameters.min_information else min(variance * parameters.few / held.weak ** 2, free)
    covariance += extra * along[:, None] * along
    if held.turn < parameters.min_information:
        turn = motion_around(information, shared, parameters)
        covariance += turn[:, None] * turn / known_turn
    return covariance


_CHANCE = 3.0
"""So many standard deviations of noise may agree by chance."""
_ALIKE = 5.0
"""The normals of so many neighbours are made of the same points."""


def match_segments(reference: Segments, current: Segments, transform: SE2, parameters: DecisionParameters):
    """Pairs ``(K, 2)`` of segments that lie on one line, side by side, once the current ones are moved."""
    if not (len(reference) and len(current)):
        return np.empty((0, 2), dtype=int)
    turned = np.abs(wrap_period(reference.direction[:, None] - current.direction - transform.theta, 2.0 * np.pi))
    moved = cmath.exp(1j * transform.theta) * as_complex(current.midpoint) + complex(transform.x, transform.y)
    step = (moved - as_complex(reference.midpoint)[:, None]) * np.exp(-1j * reference.direction)[:, None]
    apart = np.abs(step.real) - 0.5 * (reference.length[:, None] + current.length)
    alike = (turned < parameters.match_angle) & (np.abs(step.imag) < parameters.match_distance) & (apart < 0.0)
    return np.array(alike.nonzero()).T
