# SPDX-License-Identifier: Apache-2.0
"""Status of a registration, its rivals, and the segments that match.

The odometry may change the status afterwards: doc/architecture.md lists where.
"""
import dataclasses
import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ..features.records import Segments
from ..geometry.array_types import FloatArray, IntArray
from ..geometry.se2 import SE2, as_complex, rotated, wrap_period
from ..geometry.tolerance import SAME
from ..parameters.registration import DecisionParameters
from .confidence.evidence import evidence_terms, log_odds
from .confidence.model import LIKELY, PLACE_COEFFICIENTS, PLACE_INTERCEPT, confidence, probability
from .hypotheses import Assessment
from .problem import Problem
from .records import UNKNOWN_HEADING, Evidence, Hypothesis, Prior, Registration, Status
from .residuals import PRIOR_INFORMATION, Observability


def decide(problem: Problem, assessed: Assessment) -> Registration:
    """Build the `Registration` from the best of the assessed hypotheses."""
    reference, current, p = problem.reference, problem.current, problem.parameters.decision
    (best, *_), rivals, observed, covariance = (assessed.hypotheses, assessed.rivals, assessed.observed,
                                                assessed.covariance)
    certainty = confidence(best.log_odds, [each.log_odds for each in rivals])
    status, reasons = judge(best.score, assessed.evidence, observed, certainty, p)
    if rivals and certainty < p.min_confidence:
        covariance = covariance + rival_covariance(best, rivals)
        reasons.append(f'rivals: {len(rivals)}')
    if status is not Status.OK and covariance[2, 2] > UNKNOWN_HEADING ** 2:
        reasons.append('heading unknown')
    found = Registration(
        best.transform, covariance, status, overlap=assessed.overlap, score=best.score, hypotheses=assessed.hypotheses,
        degenerate_direction=math.remainder(observed.angle, math.pi) if observed.weak < p.min_information else None,
        find_matches=partial(match_segments, reference.segments, current.segments, best.transform),
        reason='; '.join(reasons), weakest_information=observed.weak,
        rotation_unobservable=observed.rotation < p.min_information, confidence=certainty, evidence=assessed.evidence,
        rivals=rivals, agreement=assessed.agreement)
    return found if problem.prior is None else demoted_if_poor(found, p)


def rival_covariance(best: Hypothesis, rivals: Sequence[Hypothesis]) -> FloatArray:
    """Return the covariance ``(3, 3)`` that rivals add to that of the `best` hypothesis, in the frame of the best.

    Each rival is weighted with the probability that it is right and the best hypothesis is wrong.
    """
    return spread(best.transform, [each.transform for each in rivals],
                  [probability(each.log_odds - best.log_odds) for each in rivals])


def spread(pose: SE2, others: Sequence[SE2], weights: Sequence[float]) -> FloatArray:
    """Return the sum ``(3, 3)`` of w d d^T over other poses with weights w, offset by d from a `pose`, in its frame."""
    inverse = pose.inverse()
    off = np.array([(inverse @ each).as_tuple() for each in others])
    covariance: FloatArray = (off.T * weights) @ off
    return covariance


def failed(reason: str, score: float = 0.0) -> Registration:
    """Return a ``FAILED`` registration with the identity as transform and a large covariance."""
    return Registration(SE2(), np.diag(1.0 / PRIOR_INFORMATION), Status.FAILED, score=score, reason=reason)


def judge(score: float, evidence: Evidence, observed: Observability, certainty: float,
          parameters: DecisionParameters) -> tuple[Status, list[str]]:
    """Return the status of a result from its score, evidence and confidence, and all reasons; none for ``OK``."""
    few, low, least = [], [], parameters.min_information
    if observed.weak < least:
        few.append(few_points_reason(observed.weak, least))
    if observed.rotation < least:
        few.append(f'the rotation is constrained by {observed.rotation:.2f} points (scaled to 1 m), expected at least '
                   f'{least}')
    if score < parameters.min_score:
        low.append(low_score_reason(score, parameters.min_score))
    if certainty < parameters.min_confidence:
        low.append(f'confidence {certainty:.2f}, expected at least {parameters.min_confidence:.3g}')
    if score < parameters.min_score and probability(log_odds(evidence)) < LIKELY:
        return Status.FAILED, low + few
    if few:
        return Status.DEGENERATE, few + low
    return (Status.AMBIGUOUS, low) if certainty < parameters.min_confidence else (Status.OK, [])


def low_score_reason(score: float, minimum: float) -> str:
    """Return the reason for ``FAILED`` or ``AMBIGUOUS`` where the `score` is too low."""
    return f'score {score:.2f}, expected at least {minimum} (advanced.decision.min_score)'


def few_points_reason(weak: float, minimum: float) -> str:
    """Return the reason for ``DEGENERATE`` where `weak` points constrain the translation along one direction."""
    return f'the translation along one direction is constrained by {weak:.2f} points, expected at least {minimum}'


def observability_ratio(registration: Registration, parameters: DecisionParameters) -> float:
    """Return how well a scan constrains the motion, 0..1: its effective points / `decision.weak_prior_information`."""
    weak, asked = registration.weakest_information, parameters.weak_prior_information
    return 1.0 if weak is None or weak >= asked else weak / asked


def demoted_if_poor(registration: Registration, parameters: DecisionParameters) -> Registration:
    """Return the registration, ``AMBIGUOUS`` instead of ``OK`` where the score is below `decision.min_score`.

    The confidence owes much to a prior, so that after one the scans have to fit each other as well. A result without
    evidence, that of the method of the paper, is returned unchanged.
    """
    poor = registration.score < parameters.min_score and registration.evidence is not None
    if registration.status is not Status.OK or not poor:
        return registration
    reason = low_score_reason(registration.score, parameters.min_score)
    return dataclasses.replace(registration, status=Status.AMBIGUOUS, reason=reason)


def place_confidence(registration: Registration) -> float:
    """Return the probability, 0..1, that a scan is from the place where it was found, and from no other.

    `Registration.confidence` takes for granted that both scans see the same place. After a gap they need not.
    """
    if registration.evidence is None:
        return registration.confidence
    return probability(PLACE_INTERCEPT + sum(coefficient * term for coefficient, term in zip(
        PLACE_COEFFICIENTS.values(), place_terms(registration), strict=True)))


def place_terms(registration: Registration) -> tuple[float, ...]:
    """Return the terms ``(9,)`` of the log-odds, in the order of `PLACE_COEFFICIENTS`; it must have evidence."""
    assert registration.evidence is not None
    evidence = registration.evidence
    return *evidence_terms(evidence), registration.hypotheses[0].log_odds - log_odds(evidence)


WEAK_PRIOR_SIGMA = 0.5
"""Standard deviation [m] of a predicted translation above which it does not distinguish repeated structures."""


def demoted_if_weak(registration: Registration, prior: Prior, parameters: DecisionParameters) -> Registration:
    """Return the registration, ``DEGENERATE`` instead of ``OK`` where few points constrain it after a weak prior.

    In a corridor with repeated structure, a few points may fit equally well at another position.
    """
    weak, sigma = registration.weakest_information, prior.translation_sigma
    if registration.status is not Status.OK or weak is None or weak >= parameters.weak_prior_information:
        return registration
    if sigma <= WEAK_PRIOR_SIGMA:
        return registration
    reason = (f'{few_points_reason(weak, parameters.weak_prior_information)}, as the predicted translation has a '
              f'standard deviation of {sigma:.2f} m')
    return dataclasses.replace(registration, status=Status.DEGENERATE, reason=reason)


def match_segments(reference: Segments, current: Segments, transform: SE2) -> IntArray:
    """Return the pairs ``(K, 2)`` of segments that overlap on one line after the transform of the current ones."""
    if not (len(reference) and len(current)):
        return np.empty((0, 2), dtype=int)
    rotation = np.abs(wrap_period(reference.direction[:, None] - current.direction - transform.theta, 2.0 * np.pi))
    moved = rotated(as_complex(current.midpoint), transform.theta) + complex(transform.x, transform.y)
    step = rotated(moved - as_complex(reference.midpoint)[:, None], -reference.direction[:, None])
    apart = np.abs(step.real) - 0.5 * (reference.length[:, None] + current.length)
    alike = (rotation < SAME) & (np.abs(step.imag) < SAME) & (apart < 0.0)
    pairs: IntArray = np.array(alike.nonzero()).T
    return pairs
