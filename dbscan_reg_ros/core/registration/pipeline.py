# SPDX-License-Identifier: Apache-2.0
"""The registration of one scan onto another (Figure 13)."""
import numpy as np

from ..features.extraction import extract_features
from ..features.records import Features
from ..parameters.tree import Parameters, expect_parameters
from ..scan import Scan
from .clustering.translation import heaviest_motions, near_motions
from .confidence.assessment import assess
from .hypotheses import Candidates
from .landmarks import landmark_motions
from .problem import Problem, SearchStage
from .ranking import rank_by_density
from .records import Prior, Registration, Status, expect_prior
from .status import decide, failed


def register(reference: Scan | Features, current: Scan | Features, parameters: Parameters = Parameters(),
             prior: Prior | None = None, first_stage: SearchStage = SearchStage.NEAR) -> Registration:
    """Find the motion that aligns the current scan with the reference; no initial guess is needed.

    The beams of a scan count as measured at one instant: the motion during a scan is not removed (`Odometry` removes
    it). The standard deviations do not include the error from that motion.

    Parameters
    ----------
    reference, current : Scan or Features
        The earlier and the later scan, or their features from `extract_features`, which can be used in several
        registrations.
    parameters : Parameters
    prior : Prior, optional
        Predicted motion in the reference's frame. It is one more hypothesis, and the stage `SearchStage.NEAR` searches
        within its gate.
    first_stage : SearchStage
        The stage to begin with. Without a prior `SearchStage.NEAR` is skipped.

    Returns
    -------
    Registration
        ``p_R = transform.apply(p_O)`` (Eq. 8): the pose of the sensor at the current scan in the reference's frame.

    Raises
    ------
    ScanError
        When a scan has too few returns, or is neither a `Scan` nor `Features`.
    ParameterError
        When `parameters` are no `Parameters`.
    ArgumentError
        When `prior` is no `Prior`.
    """
    expect_parameters(parameters)
    expect_prior(prior)
    # Sections 2.1 and 2.2: filter and lines of both scans.
    reference, current = (as_features(each, parameters) for each in (reference, current))
    problem = Problem(reference, with_common_noise(reference, current), parameters, prior)
    # Sections 2.2.1 to 2.3, in up to three stages.
    if first_stage is SearchStage.WIDE:
        return search_wide(problem)
    if first_stage is SearchStage.NEAR and prior is not None:
        found = search_near(problem, prior, parameters.prior.max_score_outside_gate)
        if found.score > parameters.prior.max_score_outside_gate:
            return found
    found = search_normal(problem)
    return search_wide(problem) if needs_wide_search(found, problem) else found


def as_features(scan: Scan | Features, parameters: Parameters) -> Features:
    """Extract the features of a scan; `Features` are returned unchanged."""
    return scan if isinstance(scan, Features) else extract_features(scan, parameters)


def register_within_gate(reference: Features, current: Features, parameters: Parameters, prior: Prior) -> Registration:
    """Register like `register`, but consider only motions within the gate around the prior."""
    return search_near(Problem(reference, with_common_noise(reference, current), parameters, prior), prior)


def with_common_noise(reference: Features, current: Features) -> Features:
    """Return the features of the current scan; their noise ratio becomes 0 if that of the reference is 0.

    Both scans are of one sensor: if only one scan has noisier far ranges, this is due to chance or outliers.
    """
    if current.oriented_points.inverse_noise is None or reference.noise_ratio:
        return current
    return current.with_noise_ratio(0.0)


def search_near(problem: Problem, prior: Prior, min_score: float = -np.inf) -> Registration:
    """Select among the prior and the clusters within the gate around it; `min_score` as for `select_by_density`."""
    # Sections 2.2.1 and 2.2.2: rotations and translations; then section 2.3: selection by the density.
    motions = near_motions(problem, prior)
    return select_by_density(problem, Candidates(prior.transform.as_array()[None], motions), min_score)


def search_normal(problem: Problem) -> Registration:
    """Select among the heaviest clusters, the shortest translations and the prior."""
    return select_by_density(problem, heaviest_candidates(problem))


def search_wide(problem: Problem) -> Registration:
    """Select among `selection.wide_search_factor` times as many clusters, and the motions that match landmarks."""
    wide = problem.widened()
    exempt, others = heaviest_candidates(wide)
    if wide.parameters.selection.max_landmarks:
        landmarks = landmark_motions(wide.reference, wide.current, wide.parameters, wide.prior)
        others = np.concatenate((landmarks, others))
    return select_by_density(wide, Candidates(exempt, others))


def select_by_density(problem: Problem, candidates: Candidates, min_score: float = -np.inf) -> Registration:
    """Refine the hypotheses by the density of the reference and return the best of them (section 2.3).

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
    min_score : float
        If the best score cannot exceed this, the search ends early and returns ``FAILED`` with that score.
    """
    if not candidates.size:
        return failed('no segments of the two scans match')
    if not len(problem.current.sampled_points):
        return failed('no returns of the current scan have a normal')
    ranked = rank_by_density(problem, candidates, min_score)
    if ranked.best_score <= min_score:
        return failed(f'score {ranked.best_score:.2f}; expected more than {min_score:.2f}', ranked.best_score)
    return decide(problem, assess(problem, ranked))


def heaviest_candidates(problem: Problem) -> Candidates:
    """Return the heaviest translation clusters; shortest translations and the prior are exempt from pre-selection."""
    # Sections 2.2.1 and 2.2.2: rotations and translations.
    motions, shortest = heaviest_motions(problem)
    if problem.prior is None:
        return Candidates(shortest, motions)
    return Candidates(np.concatenate((problem.prior.transform.as_array()[None], shortest)), motions)


WIDE_SEARCH_SCORE = 0.5
"""Score below which the wide search follows; right results score less only where much of the view has changed."""


def needs_wide_search(found: Registration, problem: Problem) -> bool:
    """Whether the result of the normal stage is uncertain: its score is low, or without a prior it is not ``OK``."""
    p = problem.parameters.selection
    if p.wide_search_factor == 1:
        return False
    return found.score < WIDE_SEARCH_SCORE or (problem.prior is None and found.status is not Status.OK)

