# SPDX-License-Identifier: Apache-2.0
"""Status of a registration, its rivals, and the segments that match."""
import cmath
import dataclasses
import math
from functools import partial

import numpy as np

from ..features.records import Features, Segments
from ..geometry.se2 import SE2, as_complex, turn_matrix, wrap
from ..parameters.registration import DecisionParameters
from ..parameters.tree import Parameters
from .records import Hypothesis, Prior, Registration, Status
from .rotation import wrap_period
from .scoring import same
from .uncertainty import uncertainty


def decide(fine, fine_score, overlap, found, coarse, coarse_score, reference: Features, current: Features, p: Parameters):
    """The `Registration` of the best of the refined hypotheses.

    Parameters
    ----------
    fine, fine_score, overlap : (H, 3), (H,), (H,) arrays
        Finely refined hypotheses, best first.
    found : Fit
        Of the best, for the points of the current scan's `sampled_points`.
    coarse, coarse_score : (G, 3), (G,) arrays
        All hypotheses after the coarse refinement: the rivals are among them.
    """
    best, limits = fine[0], p.decision
    covariance, held = uncertainty(best, found, current.sampled_points, max(reference.noise, current.noise), p)
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
        return Status.DEGENERATE, few_points_reason(held.weak, parameters.min_information)
    if held.turn < parameters.min_information:
        return Status.DEGENERATE, (f'only {held.turn:.2f} points, as if 1 m away, hold the rotation; '
                                   f'{parameters.min_information} asked for')
    return Status.OK, ''


def few_points_reason(weak, asked):
    """The reason for ``DEGENERATE``."""
    return f'only {weak:.2f} points hold the motion along one direction; {asked} asked for'


def observability_ratio(registration: Registration, parameters: DecisionParameters):
    """How firmly a scan holds the motion, from 0 to 1: in parts of the points that are asked for when it is not known."""
    weak, asked = registration.weakest_information, parameters.weak_prior_information
    return 1.0 if weak is None or weak >= asked else weak / asked


def demoted_if_weak(registration: Registration, prior: Prior, parameters: DecisionParameters):
    """`registration`, no longer ``OK`` where few points hold a motion of which nothing was known before.

    Along a corridor that repeats itself another place fits a few points as well as the true one does.
    """
    weak, spread = registration.weakest_information, prior.translation_sigma
    if registration.status is not Status.OK or observability_ratio(registration, parameters) == 1.0 or spread <= parameters.weak_prior_sigma:
        return registration
    reason = f'{few_points_reason(weak, parameters.weak_prior_information)} where the motion is expected to {spread:.2f} m only'
    return dataclasses.replace(registration, status=Status.DEGENERATE, reason=reason)


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
