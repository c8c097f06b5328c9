# SPDX-License-Identifier: Apache-2.0
"""Parameters of a registration."""


from dataclasses import dataclass

from .schema import ParameterGroup, parameter

_MOST = 10000
_CLUSTERINGS = 'built_in', 'scikit_learn'
_CLUSTERING_HELP = ('Implementation of DBSCAN: built_in (fast), scikit_learn (sklearn.cluster.DBSCAN, as in the paper); the '
                    'clusters are the same.')


@dataclass(frozen=True)
class RotationParameters(ParameterGroup):
    """Clusters of angle differences (Eq. 9)."""

    directed: bool = parameter(True, 'lines keep the direction in which the beams pass them')
    weighted: bool = parameter(True, 'pairs weigh as much as their shorter line is long')
    clustering: str = parameter('built_in', _CLUSTERING_HELP, '', choices=_CLUSTERINGS)
    eps: float = parameter(0.0, 'neighbourhood of DBSCAN; 0: from the k-dist graph of each pair of scans', 'rad', 0.0, 3.2)
    eps_min: float = parameter(0.005, 'least neighbourhood taken from the k-dist graph', 'rad', 0.0001, 3.2)
    eps_max: float = parameter(0.05, 'greatest neighbourhood taken from the k-dist graph', 'rad', 0.0001, 3.2)
    min_samples: int = parameter(1, 'MinPts of DBSCAN', '', 1, 1000)
    max_width: float = parameter(0.1, 'a wider cluster is a chain and is clustered again; 0: never', 'rad', 0.0, 6.4)
    recluster_levels: int = parameter(1, 'times that a chain is clustered again, with half the neighbourhood each', '', 0, 10)
    median_scale: float = parameter(0.0, 'in a cluster\'s mean samples this far from its median weigh half; 0: distance does not matter',
                             'rad', 0.0, 3.2)
    max_hypotheses: int = parameter(5, 'clusters that are followed further, heaviest first', '', 1, _MOST)


@dataclass(frozen=True)
class TranslationParameters(ParameterGroup):
    """Clusters of translations (Eq. 10-15)."""

    form: str = parameter('signed', 'what a pair of lines says: signed (which way to go, from directed lines), squared (how far '
                          'only, Eq. 15: four solutions for two pairs)', '', choices=('signed', 'squared'))
    key_clusters: int = parameter(2, 'divergence: every sample of so many largest clusters is a candidate', '', 1, 1000)
    parallel_sigma: float = parameter(0.06, 'eps1 of Eq. 12: lines this far from parallel still count (one standard deviation)', 'rad',
                                0.0001, 1.6)
    min_crossing_sine: float = parameter(0.35, 'eps2 of Eq. 13, as the sine of the angle between two pairs', '', 0.0001, 1.0)
    max_pairs: int = parameter(14, 'line pairs used for each rotation, heaviest first', '', 2, 10000)
    end_weight: float = parameter(1.0, 'weight of matched end points against line pairs; 0: lines only', '', 0.0, 100.0)
    clustering: str = parameter('built_in', _CLUSTERING_HELP, '', choices=_CLUSTERINGS)
    eps: float = parameter(0.06, 'neighbourhood of DBSCAN; 0: from the k-dist graph of each pair of scans', 'm', 0.0, 100.0)
    eps_min: float = parameter(0.02, 'least neighbourhood taken from the k-dist graph', 'm', 0.0001, 100.0)
    eps_max: float = parameter(0.2, 'greatest neighbourhood taken from the k-dist graph', 'm', 0.0001, 100.0)
    min_samples: int = parameter(1, 'MinPts of DBSCAN', '', 1, 1000)
    max_width: float = parameter(0.15, 'a cluster spread wider is a chain and is clustered again; 0: never', 'm', 0.0, 100.0)
    recluster_levels: int = parameter(1, 'times that a chain is clustered again, with half the neighbourhood each', '', 0, 10)
    shortest_rotations: int = parameter(2, 'rotations, heaviest first, whose shortest translation is a hypothesis as well: between '
                              'parallel walls no lines cross', '', 0, 1000)


@dataclass(frozen=True)
class DensityParameters(ParameterGroup):
    """Density of the reference as a table, and how scans are compared to it (Eq. 16-21)."""

    max_points: int = parameter(200, 'points of the current scan that are compared, evenly along the scan', '', 10, 100000)
    cell_size: float = parameter(0.04, 'least cell of the table', 'm', 0.005, 10.0)
    max_cells: int = parameter(800, 'most cells along a side of the table', '', 50, 4000)
    max_distance: float = parameter(0.4, 'a point has no partner farther away than this', 'm', 0.02, 2.0)
    min_normal_cosine: float = parameter(0.5, 'cosine of the greatest angle between the normals of partners', '', -1.0, 1.0)
    violation_weight: float = parameter(0.7, 'weight of a point in the other scan\'s free space against one on its surface', '', 0.0, 100.0)
    violation_tolerance: float = parameter(0.15, 'a point this far in front of what the other scan saw begins to count', 'm', 0.01, 10.0)
    leverage_ridge: float = parameter(1.0, 'points count more where few face the same way; large: all alike', '', 0.001, 1000.0)


@dataclass(frozen=True)
class SelectionParameters(ParameterGroup):
    """From many hypotheses to one."""

    method: str = parameter('density', 'density (clusters are sieved, refined and compared by the reference\'s density), '
                            'divergence (least K-L divergence within the key clusters, the paper)', '',
                            choices=('density', 'divergence'))
    max_clusters: int = parameter(8, 'translation clusters that are followed without a prior, heaviest first', '', 1, _MOST)
    max_clusters_with_prior: int = parameter(20, 'those that are sieved with a prior', '', 1, _MOST)
    preselection_points: int = parameter(60, 'points used by the sieve and, without a prior, by the coarse refinement, besides those that '
                                  'face where few others do', '', 5, 10000)
    preselection_tolerance: float = parameter(0.25, 'distance from the outline at which a point supports no more', 'm', 0.01, 10.0)
    preselected: int = parameter(4, 'those that pass the sieve', '', 1, _MOST)
    min_support_ratio: float = parameter(0.6, 'without a prior hypotheses with less than this share of the best one\'s support are given up', '',
                               0.0, 1.0)
    wide_search_score: float = parameter(0.5, 'below this score, and without a prior where the result is not ok, the search is repeated with '
                             'more hypotheses', '', -1.0, 1.0)
    wide_search_factor: int = parameter(30, 'so many times as many; 1: it is not', '', 1, 100)
    max_landmarks: int = parameter(24, 'then two small things that stand free, as far apart in both scans, tell a motion as well: the '
                               'nearest so many; 0: none', '', 0, 50)
    landmark_size: float = parameter(1.0, 'they are smaller than this', 'm', 0.0, 10.0)
    wide_search_gain: float = parameter(0.02, 'its result has to score so much more', '', 0.0, 2.0)
    top_candidates: int = parameter(2, 'hypotheses refined finely and compared,', '', 1, 1000)
    max_score_gap: float = parameter(0.4, 'unless they score lower than the best by more than this', '', 0.0, 2.0)
    same_distance: float = parameter(0.05, 'hypotheses nearer than this are one', 'm', 0.0, 10.0)
    same_angle: float = parameter(0.02, 'and turned by less than this', 'rad', 0.0, 3.2)


@dataclass(frozen=True)
class DivergenceParameters(ParameterGroup):
    """Densities of the x and y coordinates (Eq. 16-18) and their K-L divergence (Eq. 19-21)."""

    bandwidth: float = parameter(0.0, 'h of Eq. 16; 0: Silverman\'s rule for each axis of the reference', 'm', 0.0, 100.0)
    grid: int = parameter(200, 'places along each axis at which the densities are compared', '', 2, 100000)
    margin: float = parameter(3.0, 'the places reach so many bandwidths beyond both scans', '', 0.0, 100.0)


_LEAST_KERNEL = 0.001


@dataclass(frozen=True)
class RefinementParameters(ParameterGroup):
    """Robust point-to-line iterations on the density."""

    coarse_iterations: int = parameter(3, 'iterations of the coarse refinement; 0: nor is a free direction searched', '', 0, 100)
    coarse_scale: float = parameter(0.25, 'kernel of its first iteration', 'm', 0.001, 10.0)
    fine_iterations: int = parameter(2, 'iterations of the fine refinement; none for a clear winner, which the last ones follow', '', 0, 100)
    fine_scale: float = parameter(0.1, 'kernel of its first iteration and the last coarse one', 'm', 0.001, 10.0)
    final_scale: float = parameter(0.03, 'kernel of the last fine iteration', 'm', 0.001, 10.0)
    polish_iterations: int = parameter(5, 'last iterations, with a kernel that narrows to so many times the spread of the errors:', '', 0, 100)
    polish_spread: float = parameter(1.6, 'that many times', '', 1.2, 10.0)
    map_iterations: int = parameter(4, 'iterations against the window', '', 0, 100)
    map_first_scale: float = parameter(0.05, 'kernel of the first of them', 'm', 0.001, 10.0)
    map_scale: float = parameter(0.01, 'kernel of the last of them; at least the range noise', 'm',
                                    0.001, 10.0)
    score_scale: float = parameter(0.05, 'kernel of the score', 'm', 0.001, 10.0)
    damping: float = parameter(0.003, 'damping of a step, as a share of the translational information', '', 1e-6, 1.0)

    def coarse_scales(self):
        """Kernel [m] of each coarse iteration, from wide to narrow."""
        return _geometric(self.coarse_scale, self.fine_scale, self.coarse_iterations)

    def fine_scales(self):
        """Kernel [m] of each fine iteration, from wide to narrow."""
        return _geometric(self.fine_scale, self.final_scale, self.fine_iterations)

    def window_scales(self, noise):
        """Kernel [m] of each iteration against the window, for a range noise [m]."""
        return _geometric(self.map_first_scale, max(self.map_scale, noise), self.map_iterations)

    def narrowed(self, scale, spread):
        """The next kernel [m] of the last iterations, after one of `scale` [m] that left a `spread` [m] of the errors."""
        return min(max(self.polish_spread * spread, _LEAST_KERNEL), scale)


def _geometric(first, last, count):
    return [first * (last / first) ** (i / max(count - 1, 1)) for i in range(count)]


@dataclass(frozen=True)
class FreeDirectionParameters(ParameterGroup):
    """Search along a direction that the walls leave free (corridors)."""

    information_ratio: float = parameter(0.05, 'searched when the information along it is below this share of that across', '', 0.0, 1.0)
    search_distance: float = parameter(1.0, 'searched this far to both sides', 'm', 0.0, 100.0)
    search_scale: float = parameter(0.05, 'kernel of the last search', 'm', 0.005, 1.0)
    min_facing: float = parameter(0.35, 'points whose normal has at least this component along it decide', '', 0.0, 1.0)
    min_points: int = parameter(2, 'no search with fewer such points', '', 1, 1000)
    parallel_tolerance: float = parameter(0.25, 'odometry: points whose normals have less than this component along it do not hold a scan there, '
                             'nor does the window pull it along by them', '', 0.0, 1.0)


@dataclass(frozen=True)
class DecisionParameters(ParameterGroup):
    """Status and covariance of a registration."""

    rival_distance: float = parameter(0.2, 'hypotheses farther apart than this are rivals', 'm', 0.0, 10.0)
    rival_angle: float = parameter(0.09, 'or turned by more than this', 'rad', 0.0, 3.2)
    min_margin: float = parameter(0.05, 'AMBIGUOUS when a rival scores this close to the best', '', 0.0, 2.0)
    min_score: float = parameter(0.35, 'FAILED when the best scores less', '', -1.0, 1.0)
    min_information: float = parameter(1.5, 'DEGENERATE when fewer points than this hold the motion in some direction', '',
                                       0.01, 100000.0)
    weak_prior_sigma: float = parameter(0.5, 'odometry: a motion that is expected no better than this is unknown,', 'm', 0.0, 1000.0)
    weak_prior_information: float = parameter(10.0, 'and OK asks for so many points in its weakest direction', '', 0.0, 100000.0)
    parallel_tolerance: float = parameter(0.15, 'points whose normals have less than this component along the weakest direction do not count '
                             'among those: where their wall lies is not known well enough', '', 0.0, 1.0)
    covariance_scale: float = parameter(0.7, 'factor on the variance of a point, for errors that neighbours share', '', 0.001,
                                        10000.0)
    few_points_scale: float = parameter(8.0, 'so many points in the weakest direction have twice the variance that their number says', '', 0.0,
                           1000.0)
    match_angle: float = parameter(0.1, 'segments turned by less than this are the same wall', 'rad', 0.0, 3.2)
    match_distance: float = parameter(0.1, 'and nearer than this to its line', 'm', 0.0, 10.0)

    def prior_information(self):
        """Diagonal of the information that holds before any scan is looked at: 10 m and pi."""
        return 0.01, 0.01, 0.1
