# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Evidence for and against motions."""
import numpy as np

from ...geometry import tolerance
from . import model as confidence_model

cimport cython
from libc.math cimport INFINITY, M_PI, cos, exp, fabs, log, log1p, sin, sqrt

from ...geometry.plane cimport bin_of, cross, distance, dot, length_of, modulus, rotated, vector, wrap
from ...geometry.symmetric cimport Factors, factors, squared_distance
from ..fit cimport KERNEL, ROTATED_X, ROTATED_Y, Fit
from ..point_to_line cimport Hypothesis
from ..uncertainty cimport ERROR, WEIGHT
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


cdef class Scene:
    """What one of the two scans saw."""

    def __cinit__(self, features):
        profile, segments = features.free_space, features.segments
        self.points, self.ends, self.segments = features.sampled_points, segments.fixed_ends, views_of_segments(segments)
        self.near, self.far, self.isolated = profile.near, profile.far, features.isolated


@cython.boundscheck(False)
cdef inline int seen_at(Scene scene, double x, double y, double tolerance, double *conflict) noexcept nogil:
    """Return 0 where a scan sees nothing at a place, 1 where it is visible, 2 on the outline; and the `conflict`."""
    cdef Py_ssize_t number = bin_of(x, y, scene.near.shape[0])
    cdef double radius = length_of(x, y), least = scene.near[number], behind = radius - scene.far[number]
    conflict[0] = min(max((least - radius - tolerance) * (1.0 / tolerance), 0.0), 1.0)
    if least <= 0.0 or behind >= 2.0 * tolerance:
        return 0
    return 2 if behind < tolerance and radius > least - tolerance else 1


@cython.boundscheck(False)
cdef inline double nearest_of(double complex place, const double complex[::1] others) noexcept nogil:
    """Return the distance of the nearest of the `others` [m]."""
    cdef double nearest = INFINITY
    cdef Py_ssize_t k
    for k in range(others.shape[0]):
        nearest = min(nearest, distance(place, others[k]))
    return nearest


@cython.boundscheck(False)
cdef double crossing_of(SegmentViews reference, SegmentViews current, Hypothesis *at, double c,
                        double s) noexcept nogil:
    """Return the length [m] of the matched segments across their main direction, for a heading by `c` and `s`."""
    cdef double overlap, length, total = 0.0
    cdef double complex heading = vector(c, s), place, along, step, doubled = vector(0.0, 0.0)
    cdef Py_ssize_t r, o
    for o in range(current.size):
        place, along, length = rotated(heading, current.middle[o]), rotated(heading, current.along[o]), 0.0
        place = vector(place.real + at.x, place.imag + at.y)
        for r in range(reference.size):
            step = vector(place.real - reference.middle[r].real, place.imag - reference.middle[r].imag)
            if dot(along, reference.along[r]) <= PARALLEL or fabs(cross(reference.along[r], step)) >= SAME_PLACE:
                continue
            overlap = min(0.5 * (reference.length[r] + current.length[o]) - fabs(dot(reference.along[r], step)),
                          min(reference.length[r], current.length[o]))
            length = max(length, overlap)
        total += length
        along = rotated(along, along)
        doubled = vector(doubled.real + length * along.real, doubled.imag + length * along.imag)
    return 0.5 * (total - modulus(doubled))


@cython.boundscheck(False)
cdef int collect(Scene reference, Scene current, Fit found, Hypothesis *at, double weak, double tolerance,
                 Findings *evidence) except -1:
    """Collect the evidence for and against a motion.

    Parameters
    ----------
    reference, current : Scene
    found : Fit
        Of the motion, weighed.
    at : Hypothesis
        The motion.
    weak : float
        Number of points that constrain its weakest direction.
    tolerance : float [m]
        Of the free space.
    evidence : Findings
        Is written.
    """
    cdef double[:, ::1] table = found.table
    cdef const double complex[::1] own = reference.points.points_view
    cdef double complex[::1] moved = np.empty(current.ends.shape[0], complex)
    cdef double c = cos(at.theta), s = sin(at.theta), conflict, squares = 0.0, total = 0.0, x, y
    cdef Py_ssize_t k
    evidence[0] = Findings(0.0, 0.0, 0, 0, 0, 0.0, 0.0, length_of(at.x, at.y), weak,
                           chance_conflicts(reference.isolated, current.isolated))
    with nogil:
        for k in range(table.shape[1]):
            seen_at(reference, table[ROTATED_X, k] + found.x, table[ROTATED_Y, k] + found.y, tolerance, &conflict)
            evidence.conflicts_current += conflict * (1.0 - table[KERNEL, k])
            squares += table[ERROR, k] * table[WEIGHT, k] * table[ERROR, k]
            total += table[WEIGHT, k]
        for k in range(own.shape[0]):
            x, y = own[k].real - at.x, own[k].imag - at.y
            evidence.on_outline += seen_at(current, c * x + s * y, c * y - s * x, tolerance, &conflict) == 2
            evidence.conflicts_reference += conflict
        for k in range(moved.shape[0]):
            # Eq. 8
            x = c * current.ends[k].real - s * current.ends[k].imag + at.x
            y = s * current.ends[k].real + c * current.ends[k].imag + at.y
            moved[k] = vector(x, y)
            count_end(reference, moved[k], reference.ends, x, y, tolerance, evidence)
        for k in range(reference.ends.shape[0]):
            x, y = reference.ends[k].real - at.x, reference.ends[k].imag - at.y
            count_end(current, reference.ends[k], moved, c * x + s * y, c * y - s * x, tolerance, evidence)
        evidence.conflicts_current /= max(table.shape[1], 1)
        evidence.conflicts_reference /= max(own.shape[0], 1)
        evidence.residual = sqrt(squares / max(total, TINY))
        evidence.crossing = crossing_of(reference.segments, current.segments, at, c, s)
    return 0


cdef inline void count_end(Scene scene, double complex place, const double complex[::1] others, double x, double y,
                           double tolerance, Findings *evidence) noexcept nogil:
    """Count a segment end as matched or unmatched, which the `scene` sees at (x, y), by the ends of the other scan."""
    cdef double conflict, apart = nearest_of(place, others)
    evidence.matched_ends += apart < SAME_PLACE
    if apart >= 2.0 * SAME_PLACE and seen_at(scene, x, y, tolerance, &conflict):
        evidence.unmatched_ends += 1


cdef double INTERCEPT = confidence_model.INTERCEPT
cdef double[8] COEFFICIENTS = [*confidence_model.COEFFICIENTS.values()]


cdef inline double excess(double conflicts, double chance) noexcept nogil:
    """Return how much the square root of a fraction of conflicts exceeds what chance explains."""
    return sqrt(conflicts + chance) - sqrt(chance)


cdef inline void write_terms(Findings *evidence, double *terms) noexcept nogil:
    """Write the terms (8,) of the log-odds, in the order of `confidence.model.COEFFICIENTS`."""
    cdef double weak = max(evidence.weak, 0.0), chance = evidence.chance
    terms[0] = excess(evidence.conflicts_current, chance) + excess(evidence.conflicts_reference, chance)
    terms[1], terms[2] = log1p(evidence.on_outline), log1p(evidence.matched_ends)
    terms[3], terms[4] = log1p(evidence.unmatched_ends), log(SAME + max(evidence.crossing, 0.0))
    terms[5], terms[6], terms[7] = evidence.residual, evidence.distance, weak / (2.0 + weak)


cdef double odds_of(Findings *evidence) noexcept nogil:
    """Return the log-odds by the evidence."""
    cdef double[8] terms
    cdef double odds = 0.0
    cdef Py_ssize_t k
    write_terms(evidence, terms)
    for k in range(8):
        odds += COEFFICIENTS[k] * terms[k]
    return INTERCEPT + odds


def evidence_terms(evidence):
    """Return the terms ``(8,)`` of the log-odds, in the order of `confidence.model.COEFFICIENTS`."""
    cdef Findings findings = evidence._asdict()
    cdef double[8] terms
    write_terms(&findings, terms)
    return tuple([terms[k] for k in range(8)])


def log_odds(evidence, prior=None, candidate=None):
    """Return the logarithm of the odds that the true motion is among the hypotheses, by the evidence of the best.

    With a `Prior` its gain for the `candidate` ``(3,)`` [m, m, rad] is added to that of the `Evidence`.
    """
    cdef Findings findings = evidence._asdict()
    cdef Hypothesis at
    if prior is None or candidate is None:
        return odds_of(&findings)
    at.x, at.y, at.theta = candidate
    return odds_of(&findings) + prior_gain(prior, &at)


cdef double prior_gain(prior, Hypothesis *at) except? -1.0:
    """Return what a prior adds to the log-odds of a motion (Bayes' rule).

    It is the logarithm of the density at the motion over that of the motions which the model was fitted to. The density
    is a mixture: the normal distribution of the prior and, with a small weight because a prior may be wrong, the density
    of any motion.
    """
    expected = prior.transform
    cdef const double[:, :] covariance = prior.covariance
    cdef double t0 = expected.theta, c = cos(t0), s = sin(t0), density
    cdef double x = at.x - <double> expected.x, y = at.y - <double> expected.y
    cdef double wrong = confidence_model.WRONG_PRIORS, anywhere = confidence_model.ANY_MOTION
    cdef double[3] off = [c * x + s * y, c * y - s * x, wrap(at.theta - t0)]
    cdef Factors f = factors(covariance[0, 0], covariance[0, 1], covariance[0, 2], covariance[1, 1], covariance[1, 2],
                             covariance[2, 2])
    density = exp(-0.5 * squared_distance(covariance, off)) / sqrt((2.0 * M_PI) ** 3 * (f.a * f.b * f.c))
    return log((1.0 - wrong) * anywhere * density + wrong)
