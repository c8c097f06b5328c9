# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Assessment of refined hypotheses: which is the best, the evidence for it, its uncertainty, and its rivals."""
from itertools import compress

import numpy as np

from ...features.oriented_points import spacing
from ...geometry.se2 import SE2
from ...parameters.registration import SCORE_SCALE
from ..fit import polish
from ..hypotheses import Assessment
from ..records import Evidence, Hypothesis
from ..residuals import Observability
from ..scoring import find_rivals

from ...features.oriented_points cimport OrientedPoints
from ...geometry.ordering cimport sort_up_to_rounding
from ...geometry.plane cimport wrap
from ..fit cimport Agreement, Fit, fit_at
from ..point_to_line cimport Hypotheses, Hypothesis as Motion
from ..scoring cimport RIVAL_ANGLE, RIVAL_DISTANCE, VIOLATION_TOLERANCE, choose_distinct
from ..uncertainty cimport (Limits, Uncertainty, covariance_of, estimate, limits_of, make_walls_parallel,
                            wall_direction)
from ..views cimport Lines, lines_of
from .evidence cimport Findings, Scene, collect, odds_of, prior_gain


cdef class Assessor:
    """What hypotheses are assessed by: both scans, and parameters as numbers."""

    cdef object problem
    cdef Scene reference, current
    cdef Lines lines
    cdef Limits limits
    cdef double noise, scale, tolerance
    cdef bint scattered
    cdef Agreement agreement

    def __cinit__(self, problem):
        reference, current, p = problem.reference, problem.current, problem.parameters
        self.problem, self.reference, self.current = problem, Scene(reference), Scene(current)
        self.lines, self.limits = lines_of(reference.likelihood_field), limits_of(p.decision)
        self.noise, self.scale = max(reference.noise, current.noise), SCORE_SCALE
        self.tolerance, self.scattered = VIOLATION_TOLERANCE, current.scattered

    cdef Uncertainty examine(self, Motion *at, bint polishing, Findings *evidence) except *:
        """Write the evidence for a hypothesis and its log-odds, and return its uncertainty; polish it first."""
        cdef Fit found = self.polished(at) if polishing else self.fit(at, self.current.points)
        cdef Uncertainty uncertainty
        cdef double angle
        found.weigh(self.scale)
        found.derive_by_own(at.theta)
        angle = wall_direction(found.table)
        self.agreement = found.agreement(angle, self.scale)
        if self.scattered:
            make_walls_parallel(found.table, angle)
        uncertainty = estimate(found.table, self.noise, &self.limits, at.theta, False, False)
        collect(self.reference, self.current, found, at, uncertainty.weak, self.tolerance, evidence)
        at.odds = odds_of(evidence)
        if self.problem.prior is not None:
            at.odds += prior_gain(self.problem.prior, at)
        return uncertainty

    cdef Fit polished(self, Motion *at):
        """Polish a hypothesis by all oriented points; return its `Fit` for the sampled points."""
        refinement = self.problem.parameters.refinement
        cdef OrientedPoints sampled = self.current.points, all_points = sampled
        cdef Fit found
        if not refinement.polish_iterations:
            return self.fit(at, sampled)
        all_points = self.problem.current.oriented_points
        (at.x, at.y, at.theta), found = polish(np.array((at.x, at.y, at.theta)), self.fit(at, all_points), refinement)
        return found if all_points is sampled else found.of_every(spacing(all_points.size, sampled.size), sampled)

    cdef Fit fit(self, Motion *at, OrientedPoints points):
        """Return the `Fit` of points of the current scan at a hypothesis."""
        return fit_at(at, points, self.lines)


def assess(problem, Hypotheses found):
    """Assess refined hypotheses, best first.

    Those that are different motions are ordered by their log-odds; with a prior by their scores, which contain the
    distance from the prior. A single one is not compared. The best is polished.

    Parameters
    ----------
    problem : Problem
    found : Hypotheses

    Returns
    -------
    Assessment
    """
    d = problem.parameters.decision
    cdef Assessor assessor = Assessor(problem)
    cdef Uncertainty of_best
    cdef Findings evidence
    cdef Py_ssize_t h
    if found.size > 1:
        found.select(found.index[1], choose_distinct(found, found.size, RIVAL_DISTANCE, RIVAL_ANGLE, found.index[0],
                                                     found.index[1]))
    if found.size > 1:
        for h in range(found.size):
            assessor.examine(&found.rows[h], False, &evidence)
            found.number[0, h] = -(found.rows[h].odds if problem.prior is None else found.rows[h].score)
        sort_up_to_rounding(found.number[0, :found.size], found.index[0], found.index[1])
        found.select(found.index[0], found.size)
    of_best = assessor.examine(&found.rows[0], True, &evidence)
    hypotheses = tuple([Hypothesis(SE2(row.x, row.y, wrap(row.theta)), row.score, row.odds)
                        for row in found.rows[:found.size]])
    rivals = ()
    if found.size > 1:
        direction = of_best.angle if of_best.weak < assessor.limits.min_information else None
        rivals = tuple(compress(hypotheses, find_rivals(found.motions(), direction)))
    return Assessment(hypotheses, rivals, found.rows[0].overlap, covariance_of(&of_best),
                      Observability(of_best.angle, of_best.weak, of_best.rotation), Evidence(**evidence),
                      (assessor.agreement.shared, assessor.agreement.seen))


def evidence_of(problem, candidates):
    """Return the `Evidence` (list) for each of the hypotheses ``(H, 3)`` [m, m, rad]."""
    cdef Assessor assessor = Assessor(problem)
    cdef Hypotheses found = Hypotheses(candidates)
    cdef Findings evidence
    cdef Py_ssize_t h
    collected = []
    for h in range(found.size):
        assessor.examine(&found.rows[h], False, &evidence)
        collected.append(Evidence(**evidence))
    return collected
