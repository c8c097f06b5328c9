# SPDX-License-Identifier: Apache-2.0
"""Parameters of a registration."""
from dataclasses import dataclass

import numpy as np

from ..geometry.tolerance import RESOLUTION
from .schema import ParameterGroup, parameter


def _geometric(first: float, last: float, count: int) -> list[float]:
    return [first * (last / first) ** (i / max(count - 1, 1)) for i in range(count)]


POLISH_SPREAD = 1.6
"""Kernel scale of a polishing iteration in multiples of the spread of the errors: most points keep their weight."""
COARSE_SCALE, FINE_SCALE, FINAL_SCALE = 0.25, 0.1, 0.03
"""Kernel scale [m] of the first coarse, of the last coarse and first fine, and of the last fine and first polishing
iteration: from the error of a hypothesis of two lines to several times the noise of a lidar."""
COARSE_SCALES, FINE_SCALES = (np.array(_geometric(*each)) for each in (
    (COARSE_SCALE, FINE_SCALE, 3), (FINE_SCALE, FINAL_SCALE, 2)))
"""Kernel scale [m] of each coarse iteration of all hypotheses, and of each fine one of those that are compared."""
SCORE_SCALE = 0.05
"""Kernel scale [m] of the score, of the covariance, and of the last pass of the search along a degenerate direction:
the errors of points on the right surfaces, with the noise of most lidars."""
MIN_NORMAL_COSINE = 0.5
"""Least cosine of the angle between the normals of two corresponding points: two walls of a corner do not correspond,
while normals that noise turns by up to 60 deg do."""
MIN_CROSSING_SINE = 0.35
"""Least sine of the angle between two lines that determine a translation (eps2 of Eq. 13), and between a wall and the
degenerate direction along which it is a landmark: the error of a line is magnified by at most three."""
SEARCH_DISTANCE = 1.0
"""Distance [m] that is searched to either side of a hypothesis along a degenerate direction: about half of that between
two doors, beyond which the next one fits as well."""
MAP_ITERATIONS = 4
"""Number of iterations that align a scan with the key-frame window; the motions of further ones are below the noise."""
MAX_COUNT = 10000
"""Upper limit of every parameter that the wide search multiplies."""


@dataclass(frozen=True)
class RotationParameters(ParameterGroup):
    """Clustering of the angle differences between lines of two scans (Eq. 9)."""

    eps: float = parameter(
        0.0, unit='rad', bounds=(0.0, 3.2), case="the paper's sigma of Eq. 9",
        help='Neighbourhood radius of DBSCAN over angle differences. Larger values merge clusters; smaller values '
             'split them; 0 estimates the radius from the k-dist graph of each pair of scans.')
    min_samples: int = parameter(
        1, bounds=(1, 1000), case="the paper's MinPts of Eq. 9",
        help='MinPts of DBSCAN over angle differences. Larger values drop small clusters as noise; 1 keeps every '
             'difference.')
    max_width: float = parameter(
        0.1, unit='rad', bounds=(0.0, 6.4), case='courses sparse, outages',
        help='A rotation cluster wider than this is clustered again with half the neighbourhood radius. Larger values '
             'accept wider clusters; smaller values split more; 0 never clusters again.')
    max_hypotheses: int = parameter(
        5, bounds=(1, MAX_COUNT), case='symptom: processing is too slow',
        help='Number of rotation clusters that become hypotheses, those with the largest weight first. Larger values '
             'also try rotations with little support and take longer; smaller values are faster.')


@dataclass(frozen=True)
class TranslationParameters(ParameterGroup):
    """Clustering of the translations that pairs of matched lines give (Eq. 10-15)."""

    end_weight: float = parameter(
        1.0, bounds=(0.0, 100.0), case='courses sparse, bursts',
        help='Weight of matched end points relative to pairs of lines. Larger values give corners and free ends more '
             'weight; 0 uses lines only.')
    eps: float = parameter(
        0.06, unit='m', bounds=(0.0001, 100.0), case="the paper's sigma of Eq. 15",
        help='Neighbourhood radius of DBSCAN over translations. Larger values merge clusters; smaller values split '
             'them.')
    min_samples: int = parameter(
        1, bounds=(1, 1000), case="the paper's MinPts of Eq. 15",
        help='MinPts of DBSCAN over translations. Larger values drop small clusters as noise; 1 keeps every '
             'translation.')
    shortest_rotations: int = parameter(
        2, bounds=(0, 1000), case='courses bursts, lidars',
        help='Number of rotations, those with the largest weight first, that also get a hypothesis with the shortest '
             'translation, since parallel walls do not constrain the translation along them. Larger values add '
             'hypotheses in corridors; 0 adds none.')


@dataclass(frozen=True)
class DensityParameters(ParameterGroup):
    """Likelihood field of the reference, and how scans are compared with it (Eq. 16-18)."""

    max_points: int = parameter(
        200, bounds=(10, 100000), case='symptom: processing is too slow',
        help='Number of points, evenly spaced along a scan, with which hypotheses are scored. Larger values give more '
             'exact scores and take longer; smaller values are faster.')
    cell_size: float = parameter(
        0.04, unit='m', bounds=(0.005, 10.0), case='symptom: processing is too slow',
        help='Least cell size of the likelihood field. Larger values make the field faster to build and coarser; '
             'smaller values find the nearest point more exactly.')
    max_distance: float = parameter(
        0.4, unit='m', bounds=(0.02, 2.0), case='symptom: walls are drawn twice',
        help='Distance beyond which a point has no correspondence. Larger values let hypotheses converge from farther '
             'away and take longer; smaller values reject more outliers.')
    violation_weight: float = parameter(
        0.7, bounds=(0.0, 100.0), case='courses sparse, outages',
        help='Weight in the score of a point in the free space of the other scan, relative to a point on a surface. '
             'Larger values reject more hypotheses with points in free space; smaller values tolerate more dynamic '
             'points.')


@dataclass(frozen=True)
class SelectionParameters(ParameterGroup):
    """Selection of one hypothesis among many."""

    max_clusters: int = parameter(
        20, bounds=(1, MAX_COUNT), case='symptom: processing is too slow',
        help='Number of translation clusters that become hypotheses, those with the largest weight first. Larger '
             'values also try motions with little support and take longer; smaller values are faster.')
    preselection_tolerance: float = parameter(
        0.25, unit='m', bounds=(0.01, 10.0), case='symptom: walls are drawn twice',
        help='Distance from the outline of the reference beyond which a point does not support a hypothesis in the '
             'pre-selection. Larger values accept less exact hypotheses; smaller values require a closer fit.')
    preselected: int = parameter(
        4, bounds=(1, MAX_COUNT), case='symptom: processing is too slow',
        help='With a prior, number of translation clusters that pass the pre-selection. Larger values lose fewer good '
             'hypotheses and take longer; smaller values are faster.')
    min_support_ratio: float = parameter(
        0.6, bounds=(0.0, 1.0), case='symptom: processing is too slow',
        help='Without a prior, hypotheses whose support is below this fraction of the best support are dropped before '
             'the refinement. Larger values drop more hypotheses and are faster; smaller values drop fewer.')
    wide_search_factor: int = parameter(
        30, bounds=(1, 100), case='courses sparse, outages',
        help='Factor by which the wide search increases the numbers of hypotheses. Larger values also try motions '
             'with little support and take longer; 1 disables the wide search.')
    max_landmarks: int = parameter(
        24, bounds=(0, 50), case='course outages',
        help='Number of small objects, the nearest first, whose pairs give further hypotheses in the wide search. '
             'Larger values help among trees and poles and take longer; 0 uses none.')
    top_candidates: int = parameter(
        2, bounds=(1, 1000), case='courses sparse, bursts',
        help='Number of distinct hypotheses that are compared in the fine refinement. The best hypothesis and up to '
             'seven rivals are compared there in any case. Larger values also compare similar hypotheses and take '
             'longer; smaller values are faster.')
    max_score_gap: float = parameter(
        0.8, bounds=(0.0, 2.0), case='symptom: processing is too slow',
        help='Hypotheses are dropped before the fine refinement if their coarse score, reduced for points in free '
             'space, is lower than the best such score by more than this. Larger values compare more hypotheses; '
             'smaller values are faster.')


@dataclass(frozen=True)
class RefinementParameters(ParameterGroup):
    """Robust point-to-line iterations on the likelihood field."""

    polish_iterations: int = parameter(
        5, bounds=(0, 100), case='symptom: processing is too slow',
        help='Number of polishing iterations of the best hypothesis, with a kernel that narrows to the spread of the '
             'errors. Larger values converge more exactly and take longer; 0 disables polishing.')
    map_first_scale: float = parameter(
        0.05, unit='m', bounds=(0.001, 10.0), case='symptom: walls are drawn twice',
        help='Kernel scale of the first iteration against the key-frame window. Larger values correct larger errors; '
             'smaller values resist outliers more.')
    map_scale: float = parameter(
        0.01, unit='m', bounds=(0.001, 10.0), case='symptom: walls are drawn twice',
        help='Kernel scale of the last iteration against the key-frame window, and standard deviation of a point '
             'relative to the prediction. If the range noise is larger, it is used instead. Larger values use more '
             'points and give the prediction more weight; smaller values resist outliers more.')
    damping: float = parameter(
        0.003, bounds=(1e-6, 1.0), case='symptom: the pose drifts along corridors',
        help='Damping of an iteration as a fraction of the translational information. Larger values move less along '
             'degenerate directions and converge more slowly; smaller values move more.')

    def window_scales(self, noise: float) -> list[float]:
        """Kernel scale [m] of each iteration against the key-frame window, for a range noise [m]."""
        return _geometric(self.map_first_scale, max(self.map_scale, noise), MAP_ITERATIONS)

    def narrowed(self, scale: float, spread: float) -> float:
        """Kernel scale [m] of the next polishing iteration, from the last `scale` [m] and `spread` of errors [m]."""
        return min(max(POLISH_SPREAD * spread, RESOLUTION), scale)


@dataclass(frozen=True)
class DegeneracyParameters(ParameterGroup):
    """Search along a degenerate direction (corridors)."""

    information_ratio: float = parameter(
        0.05, bounds=(0.0, 1.0), case='courses corridors, bursts',
        help='A direction is degenerate, and searched, when the information along it is below this fraction of the '
             'information perpendicular to it. Larger values search more often and take longer; smaller values search '
             'only in bare corridors.')
    parallel_tolerance: float = parameter(
        0.25, bounds=(0.0, 1.0), case='courses featureless, lidars',
        help='In the odometry, walls whose normals have a smaller component than this along the least constrained '
             'direction are treated as parallel to it. Larger values treat more walls as parallel; smaller values '
             'trust near-parallel walls more.')


@dataclass(frozen=True)
class DecisionParameters(ParameterGroup):
    """Status and covariance of a registration."""

    min_confidence: float = parameter(
        0.95, bounds=(0.0, 1.0), case='symptom: the pose jumps once and is correct again',
        help='The status is AMBIGUOUS when the confidence, the probability that the motion is right, is below this. '
             'The odometry, whose gate checks each result as well, allows twice the probability of an error. '
             'Larger values report AMBIGUOUS more often; smaller values report OK for more wrong results.')
    min_score: float = parameter(
        0.35, bounds=(-1.0, 1.0), case='symptom: the pose jumps once and is correct again',
        help='With a prior, in the odometry and for loops, a result with a lower score is never OK. A result with a '
             'lower score is FAILED if the evidence says that the motion is more likely wrong than right. Larger '
             'values reject more matches; smaller values accept poorer ones.')
    min_information: float = parameter(
        1.5, bounds=(0.01, 100000.0), case='symptom: `degenerate` is reported too often or too late',
        help='The status is DEGENERATE when fewer effective points than this constrain some direction or the rotation. '
             'Larger values report DEGENERATE more often; smaller values report it less often.')
    weak_prior_information: float = parameter(
        10.0, bounds=(0.0, 100000.0), case='courses aces, sparse',
        help='Number of effective points that must constrain every direction for the status OK after a weak '
             'prior. Larger values report OK less often in corridors; smaller '
             'values report it more often.')
    parallel_tolerance: float = parameter(
        0.15, bounds=(0.0, 1.0), case='courses leader, lidars',
        help='Points whose normal has a smaller component than this along a corridor are not counted as effective '
             'points of this direction. Larger values treat more walls as parallel; smaller values trust near-parallel '
             'walls more.')
    covariance_scale: float = parameter(
        0.7, bounds=(0.001, 10000.0), case='symptom: covariances that a filter finds too small or too large',
        help='Factor on the variance of each point, which calibrates the covariance. Larger values report larger '
             'covariances; smaller values report smaller ones.')
    few_points_scale: float = parameter(
        8.0, bounds=(0.0, 1000.0), case='courses corridors, leader',
        help='Number of effective points at which the variance of the least constrained direction is doubled, because '
             'the errors of few points are not independent. Larger values report larger covariances in corridors; 0 '
             'disables the correction.')
