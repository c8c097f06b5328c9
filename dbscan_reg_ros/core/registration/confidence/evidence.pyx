# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Evidence for and against motions."""
import numpy as np

from ...geometry import tolerance
from ..hypotheses import Assessment
from ..records import Evidence
from ..scoring import find_rivals
from ..uncertainty import uncertainty
from . import model as confidence_model

from libc.math cimport INFINITY, M_PI, cos, exp, fabs, log, log1p, sin, sqrt

from ...features.oriented_points cimport OrientedPoints
from ...geometry.exponential cimport decaying_exp
from ...geometry.plane cimport bin_of, cross, dot, length_of, modulus, rotated, wrap
from ...geometry.symmetric cimport Factors, factors, squared_distance
from ..views cimport SegmentViews, views_of_segments

cdef double SAME = tolerance.SAME, TINY = tolerance.TINY
# Largest distance [m] of ends that match, and of a segment from the line of another that matches.
cdef double SAME_PLACE = 0.15
# Least cosine of the angle between segments that match.
cdef double PARALLEL = 0.99
# Fraction of isolated points in a scan of uniformly random ranges.
cdef double ALL_RANDOM = 0.45


cdef double chance_conflicts(double reference, double current) noexcept nogil:
    """Return the fraction of points, 0..1, that lie in free space of the other scan though the motion is right.

    Random ranges are isolated. A place seems free where both beams that pass it are random, so that the fraction is the
    square of the fraction of isolated points. Where most ranges are random, they do not distinguish motions: the nearer
    the fraction is to `ALL_RANDOM`, the less is explained by it.
    """
    cdef double rate = min(reference, max(ALL_RANDOM - reference, 0.0)) + min(current, max(ALL_RANDOM - current, 0.0))
    return rate * rate


cdef inline int seen_at(const double[::1] near, const double[::1] far, double x, double y, double tolerance,
                        double* conflict) except? -1 nogil:
    """Return 0 where a scan sees nothing at a place, 1 where it is visible, 2 on the outline; and the `conflict`."""
    cdef Py_ssize_t number = bin_of(x, y, near.shape[0])
    cdef double radius = length_of(x, y), least = near[number], behind = radius - far[number]
    conflict[0] = min(max((least - radius - tolerance) * (1.0 / tolerance), 0.0), 1.0)
    if least <= 0.0 or behind >= 2.0 * tolerance:
        return 0
    return 2 if behind < tolerance and radius > least - tolerance else 1


cdef inline double nearest_of(double complex place, const double complex[::1] others) except? -1.0 nogil:
    """Return the distance of the nearest of the `others` [m]."""
    cdef double nearest = INFINITY
    cdef Py_ssize_t k
    for k in range(others.shape[0]):
        nearest = min(nearest, length_of(place.real - others[k].real, place.imag - others[k].imag))
    return nearest


cdef double crossing_of(SegmentViews reference, SegmentViews current, const double[:] candidate) except? -1.0 nogil:
    """Return the length [m] of the matched segments across their main direction."""
    cdef double c = cos(candidate[2]), s = sin(candidate[2]), overlap, length, total = 0.0
    cdef double complex turn = c + 1j * s, shift = candidate[0] + 1j * candidate[1], place, along, step
    cdef double complex doubled = 0.0
    cdef Py_ssize_t r, o
    for o in range(current.size):
        place, along, length = rotated(turn, current.middle[o]) + shift, rotated(turn, current.along[o]), 0.0
        for r in range(reference.size):
            step = place - reference.middle[r]
            if dot(along, reference.along[r]) <= PARALLEL or fabs(cross(reference.along[r], step)) >= SAME_PLACE:
                continue
            overlap = min(0.5 * (reference.length[r] + current.length[o]) - fabs(dot(reference.along[r], step)),
                          min(reference.length[r], current.length[o]))
            length = max(length, overlap)
        total += length
        along = rotated(along, along)
        doubled = (doubled.real + length * along.real) + 1j * (doubled.imag + length * along.imag)
    return 0.5 * (total - modulus(doubled))


def collect_evidence(const double[:, :] candidates, fits, weak, reference, current, parameters):
    """Collect the evidence for and against each of the motions.

    Parameters
    ----------
    candidates : (H, 3) array [m, m, rad]
    fits : Fit
        Of them, for the current scan's `sampled_points`.
    weak : (H,) sequence of float
        Number of points that constrain the weakest direction of each.
    reference, current : Features
    parameters : Parameters

    Returns
    -------
    list of H Evidence
    """
    cdef const double[:, ::1] error = fits.error
    cdef const unsigned char[:, ::1] alike = fits.alike
    cdef const double complex[:, ::1] place = fits.places
    cdef OrientedPoints compared = current.sampled_points, owned = reference.sampled_points
    cdef const double complex[::1] own = owned.points_view
    cdef const double complex[::1] ends_r = reference.segments.fixed_ends
    cdef const double complex[::1] ends_o = current.segments.fixed_ends
    cdef const double[::1] near_r = reference.free_space.near, far_r = reference.free_space.far
    cdef const double[::1] near_o = current.free_space.near, far_o = current.free_space.far
    cdef Py_ssize_t size = error.shape[1], count = own.shape[0], h, k, on_outline, matched, unmatched
    cdef const double[::1] weights = compared.weights_view
    cdef double tolerance = parameters.density.violation_tolerance, scale = parameters.refinement.score_scale
    cdef double chance = chance_conflicts(reference.isolated, current.isolated)
    cdef double factor = -0.5 / (scale * scale), same_place = SAME_PLACE, crossing
    cdef double weight, conflict, of_current, of_reference, squares, total, c, s, x, y, apart
    cdef double complex[::1] moved = np.empty(ends_o.shape[0], complex)
    cdef SegmentViews ours = views_of_segments(reference.segments), theirs = views_of_segments(current.segments)
    found = []
    for h in range(candidates.shape[0]):
        of_current = of_reference = squares = total = 0.0
        on_outline = matched = unmatched = 0
        with nogil:
            c, s = cos(candidates[h, 2]), sin(candidates[h, 2])
            for k in range(size):
                # Gaussian kernel (Eq. 18), 0 where the normals disagree.
                weight = decaying_exp(factor * error[h, k] * error[h, k]) if alike[h, k] else 0.0
                seen_at(near_r, far_r, place[h, k].real, place[h, k].imag, tolerance, &conflict)
                of_current += conflict * (1.0 - weight)
                weight *= weights[k]
                squares += error[h, k] * weight * error[h, k]
                total += weight
            for k in range(count):
                x, y = own[k].real - candidates[h, 0], own[k].imag - candidates[h, 1]
                on_outline += seen_at(near_o, far_o, c * x + s * y, c * y - s * x, tolerance, &conflict) == 2
                of_reference += conflict
            for k in range(ends_o.shape[0]):
                # Eq. 8
                x = c * ends_o[k].real - s * ends_o[k].imag + candidates[h, 0]
                y = s * ends_o[k].real + c * ends_o[k].imag + candidates[h, 1]
                moved[k] = x + 1j * y
                apart = nearest_of(moved[k], ends_r)
                matched += apart < same_place
                if apart >= 2.0 * same_place and seen_at(near_r, far_r, x, y, tolerance, &conflict):
                    unmatched += 1
            for k in range(ends_r.shape[0]):
                x, y = ends_r[k].real - candidates[h, 0], ends_r[k].imag - candidates[h, 1]
                apart = nearest_of(ends_r[k], moved)
                matched += apart < same_place
                if (apart >= 2.0 * same_place
                        and seen_at(near_o, far_o, c * x + s * y, c * y - s * x, tolerance, &conflict)):
                    unmatched += 1
            crossing = crossing_of(ours, theirs, candidates[h])
        found.append(Evidence(
            of_current / max(size, 1), of_reference / max(count, 1), on_outline, matched, unmatched,
            crossing, sqrt(squares / max(total, TINY)),
            length_of(candidates[h, 0], candidates[h, 1]), weak[h], chance))
    return found


cdef double INTERCEPT = confidence_model.INTERCEPT
cdef double[8] COEFFICIENTS = [*confidence_model.COEFFICIENTS.values()]


cdef inline double excess(double conflicts, double chance) noexcept nogil:
    """Return how much the square root of a fraction of conflicts exceeds what chance explains."""
    return sqrt(conflicts + chance) - sqrt(chance)


def evidence_terms(evidence):
    """Return the terms ``(8,)`` of the log-odds, in the order of `confidence.model.COEFFICIENTS`."""
    cdef double current, reference, outline, matched, unmatched, crossing, residual, distance, weak, chance
    current, reference, outline, matched, unmatched, crossing, residual, distance, weak, chance = evidence
    weak = max(weak, 0.0)
    return (excess(current, chance) + excess(reference, chance), log1p(outline), log1p(matched), log1p(unmatched),
            log(SAME + max(crossing, 0.0)), residual, distance, weak / (2.0 + weak))


def log_odds(evidence, prior=None, candidate=None):
    """Return the logarithm of the odds that the true motion is among the hypotheses, by the evidence of the best.

    With a `Prior` its gain for the `candidate` ``(3,)`` [m, m, rad] is added to that of the `Evidence`.
    """
    cdef double odds = 0.0, term
    cdef Py_ssize_t k
    for k, term in enumerate(evidence_terms(evidence)):
        odds += COEFFICIENTS[k] * term
    odds = INTERCEPT + odds
    return odds if prior is None or candidate is None else odds + prior_gain(prior, candidate)


cdef double prior_gain(prior, const double[:] candidate) except? -1.0:
    """Return what a prior adds to the log-odds of a motion (Bayes' rule).

    It is the logarithm of the density at the motion over that of the motions which the model was fitted to. The density
    is a mixture: the normal distribution of the prior and, with a small weight because a prior may be wrong, the density
    of any motion.
    """
    expected = prior.transform
    cdef const double[:, ::1] covariance = np.ascontiguousarray(prior.covariance, dtype=float)
    cdef double t0 = expected.theta, c = cos(t0), s = sin(t0), x, y, density
    cdef double wrong = confidence_model.WRONG_PRIORS, anywhere = confidence_model.ANY_MOTION
    cdef double[3] off
    cdef Factors f = factors(covariance[0, 0], covariance[0, 1], covariance[0, 2], covariance[1, 1], covariance[1, 2],
                             covariance[2, 2])
    x, y = candidate[0] - <double> expected.x, candidate[1] - <double> expected.y
    off[0], off[1], off[2] = c * x + s * y, c * y - s * x, wrap(candidate[2] - t0)
    density = exp(-0.5 * squared_distance(covariance, off)) / sqrt((2.0 * M_PI) ** 3 * (f.a * f.b * f.c))
    return log((1.0 - wrong) * anywhere * density + wrong)


def assess(problem, fine):
    """Assess the best hypothesis: its uncertainty, its rivals, the evidence for it, and all log-odds.

    Parameters
    ----------
    problem : Problem
    fine : Ranking
        Finely refined hypotheses, including rivals; its `best` is the fit of the current scan's `sampled_points`.

    Returns
    -------
    Assessment
    """
    reference, current, p = problem.reference, problem.current, problem.parameters
    candidates, best = fine.candidates, fine.candidates[0]
    covariance, observed = uncertainty(best, fine.best, current.sampled_points, max(reference.noise, current.noise), p)
    rivals = find_rivals(candidates, observed.angle if observed.weak < p.decision.min_information else None, p.decision)
    evidence, = collect_evidence(candidates[:1], fine.best, (observed.weak,), reference, current, p)
    odds = [log_odds(evidence, problem.prior, best)]
    if len(candidates) > 1:
        odds += fine.odds[1:].tolist()
    return Assessment(covariance, observed, rivals, evidence, odds)
