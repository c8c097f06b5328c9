# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the method: default, unit, bounds and one line of help, in one place.

ROS descriptors, YAML files, the command-line help and the parameter reference are made from these
classes. A full name is ``group.field``, for example ``rotation.sigma``.
"""
import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

from .errors import ParameterError


def parameter(default, help, unit='', minimum=None, maximum=None, choices=None, read_only=False):
    """A dataclass field that knows what it means; a tuple of numbers as default is a list of that length."""
    return dataclasses.field(default=default, metadata={
        'help': help, 'unit': unit, 'minimum': minimum, 'maximum': maximum, 'choices': choices,
        'read_only': read_only})


@dataclass(frozen=True)
class Description:
    """What is known of one parameter by its full name."""

    name: str
    type: type
    default: object
    help: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple | None
    read_only: bool

    @property
    def bounds(self) -> str:
        """The allowed values in words; empty where every value of the type is."""
        if self.choices is not None:
            return f'one of {", ".join(map(repr, self.choices))}'
        unit = f' {self.unit}' if self.unit else ''
        if self.minimum is not None and self.maximum is not None:
            return f'{self.minimum} to {self.maximum}{unit}'
        if self.minimum is not None:
            return f'at least {self.minimum}{unit}'
        return '' if self.maximum is None else f'at most {self.maximum}{unit}'


class ParameterGroup:
    """A frozen dataclass of parameters that checks each value as it is made."""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = check(_describe('', field), getattr(self, field.name))
            object.__setattr__(self, field.name, value)


class ParameterTree:
    """A frozen dataclass of parameters and groups of parameters, read and made by full names."""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            if not _is_group(field):
                object.__setattr__(self, field.name, check(_describe('', field), getattr(self, field.name)))

    @classmethod
    def describe(cls) -> tuple:
        """A `Description` of every parameter, in order."""
        return tuple(_describe(prefix, field) for prefix, field in _parameter_fields(cls))

    def flatten(self) -> dict:
        """Full name -> value."""
        return {prefix + field.name: getattr(getattr(self, prefix[:-1]) if prefix else self, field.name)
                for prefix, field in _parameter_fields(type(self))}

    def replace(self, values):
        """A copy with `values` (full name -> value) changed, all or none.

        Raises
        ------
        ParameterError
            When a name is unknown, a value has the wrong type or lies outside its bounds, or two contradict each other.
        """
        descriptions = {d.name: d for d in self.describe()}
        own, groups = {}, {}
        for name, value in values.items():
            if name not in descriptions:
                raise ParameterError(f'unknown parameter {name!r}; {suggest(name, descriptions)}')
            group, _, field = name.rpartition('.')
            (groups.setdefault(group, {}) if group else own)[field] = check(descriptions[name], value)
        return dataclasses.replace(self, **own, **{
            group: dataclasses.replace(getattr(self, group), **fields) for group, fields in groups.items()})


def check(description, value):
    """`value` in the parameter's own type.

    Raises
    ------
    ParameterError
        When it has another type or lies outside its bounds.
    """
    d = description
    if d.type is tuple:
        return _check_list(d, value)
    if d.type is float and type(value) is int and value.bit_length() < 1024:
        value = float(value)
    if type(value) is not d.type:
        raise ParameterError(f'{d.name} = {_shown(value)}: expected {_article(d.type)}')
    if d.type is float and not math.isfinite(value):
        raise ParameterError(f'{d.name} = {value!r}: expected a finite number')
    if (d.choices is not None and value not in d.choices or d.minimum is not None and value < d.minimum
            or d.maximum is not None and value > d.maximum):
        raise ParameterError(f'{d.name} = {value!r}: expected {d.bounds}')
    return value


def _check_list(d, values):
    if isinstance(values, str) or not hasattr(values, '__len__') or len(values) != len(d.default):
        raise ParameterError(f'{d.name} = {_shown(values)}: expected {len(d.default)} numbers')
    kind = type(d.default[0])
    return tuple(check(dataclasses.replace(d, name=f'{d.name}[{i}]', type=kind), value)
                 for i, value in enumerate(values))


def _shown(value):
    """A value as a user writes it: arrays of any library as the list of their numbers."""
    if hasattr(value, 'tolist'):
        value = value.tolist()
    return repr(list(value) if isinstance(value, (tuple, bytes, bytearray)) else value)


def _is_group(field):
    return field.default is dataclasses.MISSING


def _parameter_fields(tree):
    """(prefix of the full name, dataclass field) of every parameter of the class `tree`, in order."""
    for field in dataclasses.fields(tree):
        if _is_group(field):
            for inner in dataclasses.fields(field.default_factory):
                yield f'{field.name}.', inner
        else:
            yield '', field


def _describe(prefix, field):
    return Description(prefix + field.name, type(field.default), field.default, **field.metadata)


def _article(kind):
    return {float: 'a number', int: 'a whole number', bool: 'true or false', str: 'a text'}[kind]


def suggest(name, names) -> str:
    """Which of `names` was meant by the unknown `name`, as the end of a message."""
    import difflib
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f'did you mean {close[0]!r}?' if close else 'see the parameter reference for the names'


@dataclass(frozen=True)
class ScanParameters(ParameterGroup):
    """Which returns of a scan are used, and how good they are."""

    range_min: float = parameter(0.0, "returns nearer than this are ignored; 0: the sensor's own limit", 'm', 0.0, 1000.0)
    range_max: float = parameter(0.0, "returns farther than this are ignored; 0: the sensor's own limit", 'm', 0.0, 1000.0)
    min_returns: int = parameter(8, 'a scan with fewer returns is skipped', 'beams', 3, 100000)
    noise_min: float = parameter(0.004, 'least range noise assumed, whatever the scan says', 'm', 0.0001, 1.0)
    noise_max: float = parameter(0.05, 'greatest range noise assumed', 'm', 0.0001, 1.0)
    noise_share_max: float = parameter(0.05, 'greatest range noise assumed as a share of the range: far returns that are noisier '
                                       'than near ones count less; 0: all count the same', '', 0.0, 0.5)


@dataclass(frozen=True)
class RingBandParameters(ParameterGroup):
    """Ring band filter (Eq. 3-4)."""

    test: str = parameter('consensus', 'what makes a beam an outlier: anchor (slopes from the beam before the ring, the '
                          'paper), consensus (on no line through two others of its ring), off', '',
                          choices=('anchor', 'consensus', 'off'))
    inner_threshold: int = parameter(2, 'T1: this many outliers in the inner ring remove the candidate', 'beams', 1, 4)
    outer_threshold: int = parameter(3, 'T2: this many outliers in the outer ring make it a corner', 'beams', 1, 8)
    gross: float = parameter(0.05, 'an outlier farther than this from its neighbours\' line is removed, never averaged; '
                             '0: always averaged', 'm', 0.0, 100.0)
    slope_tolerance: float = parameter(0.2, 'anchor: a slope this far from the ring\'s median is an outlier', 'rad', 0.001, 3.2)
    jump: float = parameter(0.5, 'anchor: rings whose neighbours lie farther apart are not judged', 'm', 0.01, 100.0)
    noise_factor: float = parameter(3.0, 'consensus: tolerance in multiples of the range noise', '', 0.0, 100.0)
    relative_tolerance: float = parameter(0.01, 'consensus: tolerance as a share of the range', '', 0.0, 1.0)


@dataclass(frozen=True)
class SegmentParameters(ParameterGroup):
    """Line segments (Eq. 5-7) and normals."""

    breakpoint_factor: float = parameter(8.0, 'k of Eq. 5: neighbours farther apart than k times the beam spacing are '
                                         'separate', '', 1.0, 100.0)
    breakpoint_noise: float = parameter(5.0, 'added to the threshold of Eq. 5, in multiples of the range noise', '', 0.0, 100.0)
    max_gap: int = parameter(8, 'a gap of more beams than this separates surfaces', 'beams', 1, 1000)
    corners: str = parameter('split', 'what a corner is: split (the point farthest from a chord), slope (where the slope of '
                             'the ranges jumps, the paper)', '', choices=('split', 'slope'))
    corner_thresholds: int = parameter(64, 'slope: so many thresholds dk_th of Eq. 6 are tried', '', 2, 10000)
    corner_penalty: float = parameter(200.0, 'slope: what a further segment must save of the squared errors, in units of the '
                                      'squared range noise; 0: the least mean error wins, however many segments', '', 0.0, 1e6)
    sections: int = parameter(0, 'lines are fitted to the means of so many equal sections (Eq. 7; the paper takes 5); 0: to '
                              'all points', '', 0, 1000)
    split_distance: float = parameter(0.03, 'a point this far from the chord, plus noise, is a corner', 'm', 0.0, 10.0)
    split_noise: float = parameter(3.0, 'added to split_distance, in multiples of the range noise', '', 0.0, 100.0)
    split_levels: int = parameter(6, 'a run is cut into at most two to this power', '', 1, 16)
    join_noise: float = parameter(2.5, 'neighbours are one line when their joint residual stays below this many times '
                                  'the range noise', '', 0.0, 100.0)
    join_gap: float = parameter(1.0, 'neighbours farther apart are never joined', 'm', 0.0, 100.0)
    min_points: int = parameter(4, 'a segment has at least this many points', 'beams', 2, 1000)
    min_length: float = parameter(0.15, 'a segment is at least this long', 'm', 0.0, 100.0)
    most: int = parameter(100, 'so many segments of a scan are kept, the longest', '', 2, 1000)
    depth_margin: float = parameter(0.15, 'an end is free when the next return lies this much deeper', 'm', 0.0, 10.0)
    corner_reach: float = parameter(0.1, 'two lines meet in a corner when both end this close to it', 'm', 0.0, 10.0)
    normal_reach: float = parameter(0.1, 'normals are fitted to neighbours up to this far on each side', 'm', 0.0, 10.0)
    normal_noise: float = parameter(4.0, 'or this far, in multiples of the range noise, where that is more', '', 0.0, 100.0)
    normal_beams: int = parameter(2, 'and to at least this many beams on each side', 'beams', 1, 100)


_MOST = 10000


@dataclass(frozen=True)
class RotationParameters(ParameterGroup):
    """Clusters of angle differences (Eq. 9)."""

    directed: bool = parameter(True, 'lines keep the direction in which the beams pass them')
    weighted: bool = parameter(True, 'pairs weigh as much as their shorter line is long')
    sigma: float = parameter(0.0, 'neighbourhood of DBSCAN; 0: from the k-dist graph of each pair of scans', 'rad', 0.0, 3.2)
    sigma_min: float = parameter(0.005, 'least neighbourhood taken from the k-dist graph', 'rad', 0.0001, 3.2)
    sigma_max: float = parameter(0.05, 'greatest neighbourhood taken from the k-dist graph', 'rad', 0.0001, 3.2)
    min_points: int = parameter(1, 'MinPts of DBSCAN', '', 1, 1000)
    width: float = parameter(0.1, 'a wider cluster is a chain and is clustered again; 0: never', 'rad', 0.0, 6.4)
    recuts: int = parameter(1, 'times that a chain is clustered again, with half the neighbourhood each', '', 0, 10)
    focus: float = parameter(0.0, 'in a cluster\'s mean samples this far from its median weigh half; 0: distance does not matter',
                             'rad', 0.0, 3.2)
    hypotheses: int = parameter(5, 'clusters that are followed further, heaviest first', '', 1, _MOST)


@dataclass(frozen=True)
class TranslationParameters(ParameterGroup):
    """Clusters of translations (Eq. 10-15)."""

    form: str = parameter('signed', 'what a pair of lines says: signed (which way to go, from directed lines), squared (how far '
                          'only, Eq. 15: four solutions for two pairs)', '', choices=('signed', 'squared'))
    key_clusters: int = parameter(2, 'divergence: every sample of so many largest clusters is a candidate', '', 1, 1000)
    parallel: float = parameter(0.06, 'eps1 of Eq. 12: lines this far from parallel still count (one standard deviation)', 'rad',
                                0.0001, 1.6)
    crossing: float = parameter(0.35, 'eps2 of Eq. 13, as the sine of the angle between two pairs', '', 0.0001, 1.0)
    pairs: int = parameter(14, 'line pairs used for each rotation, heaviest first', '', 2, 10000)
    end_weight: float = parameter(1.0, 'weight of matched end points against line pairs; 0: lines only', '', 0.0, 100.0)
    sigma: float = parameter(0.06, 'neighbourhood of DBSCAN; 0: from the k-dist graph of each pair of scans', 'm', 0.0, 100.0)
    sigma_min: float = parameter(0.02, 'least neighbourhood taken from the k-dist graph', 'm', 0.0001, 100.0)
    sigma_max: float = parameter(0.2, 'greatest neighbourhood taken from the k-dist graph', 'm', 0.0001, 100.0)
    min_points: int = parameter(1, 'MinPts of DBSCAN', '', 1, 1000)
    width: float = parameter(0.15, 'a cluster spread wider is a chain and is clustered again; 0: never', 'm', 0.0, 100.0)
    recuts: int = parameter(1, 'times that a chain is clustered again, with half the neighbourhood each', '', 0, 10)
    shortest: int = parameter(2, 'rotations, heaviest first, whose shortest translation is a hypothesis as well: between '
                              'parallel walls no lines cross', '', 0, 1000)


@dataclass(frozen=True)
class DensityParameters(ParameterGroup):
    """Density of the reference as a table, and how scans are compared to it (Eq. 16-21)."""

    points: int = parameter(200, 'points of the current scan that are compared, evenly along the scan', '', 10, 100000)
    cell: float = parameter(0.04, 'least cell of the table', 'm', 0.005, 10.0)
    cells: int = parameter(800, 'most cells along a side of the table', '', 50, 4000)
    reach: float = parameter(0.4, 'a point has no partner farther away than this', 'm', 0.02, 2.0)
    facing: float = parameter(0.5, 'cosine of the greatest angle between the normals of partners', '', -1.0, 1.0)
    violation: float = parameter(0.7, 'weight of a point in the other scan\'s free space against one on its surface', '', 0.0, 100.0)
    violation_tolerance: float = parameter(0.15, 'a point this far in front of what the other scan saw begins to count', 'm', 0.01, 10.0)
    balance: float = parameter(1.0, 'points count more where few face the same way; large: all alike', '', 0.001, 1000.0)


@dataclass(frozen=True)
class SelectionParameters(ParameterGroup):
    """From many hypotheses to one."""

    method: str = parameter('density', 'density (clusters are sieved, refined and compared by the reference\'s density), '
                            'divergence (least K-L divergence within the key clusters, the paper)', '',
                            choices=('density', 'divergence'))
    heaviest: int = parameter(8, 'translation clusters that are followed without a prior, heaviest first', '', 1, _MOST)
    candidates: int = parameter(20, 'those that are sieved with a prior', '', 1, _MOST)
    sieve_points: int = parameter(60, 'points used by the sieve and, without a prior, by the coarse refinement, besides those that '
                                  'face where few others do', '', 5, 10000)
    sieve_tolerance: float = parameter(0.25, 'distance from the outline at which a point supports no more', 'm', 0.01, 10.0)
    refined: int = parameter(4, 'those that pass the sieve', '', 1, _MOST)
    hopeful: float = parameter(0.6, 'without a prior hypotheses with less than this share of the best one\'s support are given up', '',
                               0.0, 1.0)
    doubt: float = parameter(0.5, 'below this score, and without a prior where the result is not ok, the search is repeated with '
                             'more hypotheses', '', -1.0, 1.0)
    widen: int = parameter(30, 'so many times as many; 1: it is not', '', 1, 100)
    landmarks: int = parameter(24, 'then two small things that stand free, as far apart in both scans, tell a motion as well: the '
                               'nearest so many; 0: none', '', 0, 50)
    landmark_size: float = parameter(1.0, 'they are smaller than this', 'm', 0.0, 10.0)
    better: float = parameter(0.02, 'its result has to score so much more', '', 0.0, 2.0)
    finalists: int = parameter(2, 'hypotheses refined finely and compared,', '', 1, 1000)
    clear: float = parameter(0.4, 'unless they score lower than the best by more than this', '', 0.0, 2.0)
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

    coarse: int = parameter(3, 'iterations of the coarse refinement; 0: nor is a free direction searched', '', 0, 100)
    coarse_scale: float = parameter(0.25, 'kernel of its first iteration', 'm', 0.001, 10.0)
    fine: int = parameter(2, 'iterations of the fine refinement; none for a clear winner, which the last ones follow', '', 0, 100)
    fine_scale: float = parameter(0.1, 'kernel of its first iteration and the last coarse one', 'm', 0.001, 10.0)
    final_scale: float = parameter(0.03, 'kernel of the last fine iteration', 'm', 0.001, 10.0)
    polish: int = parameter(5, 'last iterations, with a kernel that narrows to so many times the spread of the errors:', '', 0, 100)
    polish_spread: float = parameter(1.6, 'that many times', '', 1.2, 10.0)
    window: int = parameter(4, 'iterations against the window', '', 0, 100)
    window_first_scale: float = parameter(0.05, 'kernel of the first of them', 'm', 0.001, 10.0)
    window_scale: float = parameter(0.01, 'kernel of the last of them; at least the range noise', 'm',
                                    0.001, 10.0)
    score_scale: float = parameter(0.05, 'kernel of the score', 'm', 0.001, 10.0)
    damping: float = parameter(0.003, 'damping of a step, as a share of the translational information', '', 1e-6, 1.0)

    def coarse_scales(self):
        """Kernel [m] of each coarse iteration, from wide to narrow."""
        return _geometric(self.coarse_scale, self.fine_scale, self.coarse)

    def fine_scales(self):
        """Kernel [m] of each fine iteration, from wide to narrow."""
        return _geometric(self.fine_scale, self.final_scale, self.fine)

    def window_scales(self, noise):
        """Kernel [m] of each iteration against the window, for a range noise [m]."""
        return _geometric(self.window_first_scale, max(self.window_scale, noise), self.window)

    def narrowed(self, scale, spread):
        """The next kernel [m] of the last iterations, after one of `scale` [m] that left a `spread` [m] of the errors."""
        return min(max(self.polish_spread * spread, _LEAST_KERNEL), scale)


def _geometric(first, last, count):
    return [first * (last / first) ** (i / max(count - 1, 1)) for i in range(count)]


@dataclass(frozen=True)
class FreeDirectionParameters(ParameterGroup):
    """Search along a direction that the walls leave free (corridors)."""

    ratio: float = parameter(0.05, 'searched when the information along it is below this share of that across', '', 0.0, 1.0)
    reach: float = parameter(1.0, 'searched this far to both sides', 'm', 0.0, 100.0)
    scale: float = parameter(0.05, 'kernel of the last search', 'm', 0.005, 1.0)
    facing: float = parameter(0.35, 'points whose normal has at least this component along it decide', '', 0.0, 1.0)
    min_points: int = parameter(2, 'no search with fewer such points', '', 1, 1000)
    slant: float = parameter(0.25, 'odometry: points whose normals have less than this component along it do not hold a scan there, '
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
    vague: float = parameter(0.5, 'odometry: a motion that is expected no better than this is unknown,', 'm', 0.0, 1000.0)
    vague_information: float = parameter(10.0, 'and OK asks for so many points in its weakest direction', '', 0.0, 100000.0)
    slant: float = parameter(0.15, 'points whose normals have less than this component along the weakest direction do not count '
                             'among those: where their wall lies is not known well enough', '', 0.0, 1.0)
    covariance_scale: float = parameter(0.7, 'factor on the variance of a point, for errors that neighbours share', '', 0.001,
                                        10000.0)
    few: float = parameter(8.0, 'so many points in the weakest direction have twice the variance that their number says', '', 0.0,
                           1000.0)
    match_angle: float = parameter(0.1, 'segments turned by less than this are the same wall', 'rad', 0.0, 3.2)
    match_distance: float = parameter(0.1, 'and nearer than this to its line', 'm', 0.0, 10.0)

    def prior_information(self):
        """Diagonal of the information that holds before any scan is looked at: 10 m and pi."""
        return 0.01, 0.01, 0.1


@dataclass(frozen=True)
class PriorParameters(ParameterGroup):
    """What a prior, one hypothesis among others, is worth."""

    weight: float = parameter(0.15, 'score that a hypothesis far from the prior loses: clear evidence outweighs it', '', 0.0, 2.0)
    limit: float = parameter(4.0, 'standard deviations at which it loses all of that', '', 0.1, 100.0)
    velocities: int = parameter(3, 'constant velocity: the mean of so many last velocities goes on', '', 1, 1000)
    acceleration: float = parameter(1.0, 'constant velocity: spread of the next step, times the interval squared', 'm/s^2',
                                    0.0, 1000.0)
    angular_acceleration: float = parameter(4.0, 'constant velocity: the same for the rotation', 'rad/s^2', 0.0, 1000.0)
    jitter: float = parameter(0.3, 'constant velocity: spread as a share of the step, for stamps that jitter', '', 0.0, 10.0)
    least: float = parameter(0.01, 'constant velocity: least spread', 'm', 0.0001, 10.0)
    least_angle: float = parameter(0.01, 'constant velocity: least spread of the rotation', 'rad', 0.0001, 3.2)
    point: float = parameter(0.01, 'spread of a point, when points are set against the prior; at least the range noise',
                             'm', 0.0, 10.0)
    memory: float = parameter(300.0, 'told motions: what is wrong with them time and again is learned over so long a way, a radian as '
                                     'a metre; 0: they are believed as told', 'm', 0.0, 1000000.0)
    unknown: float = parameter(0.25, 'spread of the motion when nothing is known of it', 'm', 0.001, 1000.0)
    unknown_angle: float = parameter(0.25, 'spread of the rotation when nothing is known of it', 'rad', 0.001, 6.4)

    @property
    def enough(self):
        """No hypothesis that a prior rules out scores more than this."""
        return 1.0 - self.weight


@dataclass(frozen=True)
class OdometryParameters(ParameterGroup):
    """Reference and key frames of the odometry."""

    reference: str = parameter('window', 'what scans are registered to: previous (the last scan, the paper), keyframe (the '
                               'last key frame), window (the last key frame, then aligned with the last several)', '',
                               choices=('previous', 'keyframe', 'window'))
    prior: str = parameter('constant_velocity', 'what is expected without a prior from elsewhere: none, constant_velocity',
                           '', choices=('none', 'constant_velocity'))
    window: int = parameter(40, 'key frames of the window', '', 1, 1000)
    moving_frames: int = parameter(6, 'what stands in space that one of so many latest key frames saw to be free is moving and '
                                      'left out; 0: nothing is', '', 0, 1000)
    moving_margin: float = parameter(0.2, 'so far in front of what they saw, where the motion is expected to better than that',
                                     'm', 0.0, 100.0)
    movable_size: float = parameter(1.1, 'what is smaller than this and has deeper space on both sides, or ends the scan, may move: '
                                    'people, mostly; 0: nothing may', 'm', 0.0, 100.0)
    movable_worth: float = parameter(0.03, 'a point of it counts so much', '', 0.0, 1.0)
    movable_share: float = parameter(0.33, 'where all such things hold less than this share of the motion in every direction '
                                     'they count in full', '', 0.0, 1.0)
    movable_distance: float = parameter(0.5, 'until a key frame from so far away or more saw it in the same place', 'm', 0.0,
                                        100.0)
    post_size: float = parameter(0.3, 'what is smaller than this, too small to have normals, and has deeper space or nothing on both '
                                 'sides, counts as a round post, little until it is seen as above; 0: not at all', 'm', 0.0, 10.0)
    keyframe_distance: float = parameter(0.3, 'a scan this far from the last key frame becomes one', 'm', 0.0, 100.0)
    keyframe_angle: float = parameter(0.26, 'or turned by this much', 'rad', 0.0, 6.4)
    keyframe_overlap: float = parameter(0.5, 'or with less overlap', '', 0.0, 1.0)
    retries: int = parameter(2, 'older key frames that are tried when the last one leads nowhere or leaves a direction free', '', 0, 100)
    coast: float = parameter(1.0, 'a lost sensor is taken to move on as expected this long', 's', 0.0, 1000.0)
    give_up: float = parameter(5.0, 'and then to stand, or to move as it is told from elsewhere; after this long a new '
                                'reference is started', 's', 0.0, 10000.0)
    rest: float = parameter(5.0, 'a sensor that stays this close to where it stands, in standard deviations of a scan, has not '
                            'moved; 0: every scan is taken at its word', '', 0.0, 100.0)
    deskew: bool = parameter(True, 'take out the motion within a scan, where time_increment is given')


@dataclass(frozen=True)
class ManhattanParameters(ParameterGroup):
    """Heading by the directions that most walls of a building share, modulo a right angle."""

    drift: float = parameter(0.0011, 'so much the heading drifts over a way of 1 m, and over any other with its root, a radian as a '
                                     'metre; 0: it is left as it is', 'rad', 0.0, 1.0)
    spread: float = parameter(0.012, 'walls in one place are off the directions of most by so much', 'rad', 0.0001, 1.0)
    reach: float = parameter(20.0, 'those so far away have little to do with them', 'm', 0.1, 100000.0)
    tolerance: float = parameter(0.035, 'walls this close to a direction are along it (one standard deviation)', 'rad', 0.001, 0.5)
    share: float = parameter(0.5, 'nothing is corrected where less than this share of the walls is', '', 0.0, 1.0)


@dataclass(frozen=True)
class TimeParameters(ParameterGroup):
    """Stamps."""

    jump: float = parameter(2.0, 'stamps that go back by more than this restart tracking at the last pose, and twice in a row reset the node to the origin; after a gap of more than this nothing is known of the motion', 's', 0.0, 1000000.0)


_LIMITED = ('scan', 'range'), ('scan', 'noise'), ('rotation', 'sigma'), ('translation', 'sigma')
"""Group and name of what has a least and a greatest value, each a parameter; a greatest one of 0 is none."""


@dataclass(frozen=True)
class Parameters(ParameterTree):
    """All parameters of the registration and the odometry."""

    scan: ScanParameters = dataclasses.field(default_factory=ScanParameters)
    filter: RingBandParameters = dataclasses.field(default_factory=RingBandParameters)
    segments: SegmentParameters = dataclasses.field(default_factory=SegmentParameters)
    rotation: RotationParameters = dataclasses.field(default_factory=RotationParameters)
    translation: TranslationParameters = dataclasses.field(default_factory=TranslationParameters)
    density: DensityParameters = dataclasses.field(default_factory=DensityParameters)
    selection: SelectionParameters = dataclasses.field(default_factory=SelectionParameters)
    divergence: DivergenceParameters = dataclasses.field(default_factory=DivergenceParameters)
    refinement: RefinementParameters = dataclasses.field(default_factory=RefinementParameters)
    free: FreeDirectionParameters = dataclasses.field(default_factory=FreeDirectionParameters)
    decision: DecisionParameters = dataclasses.field(default_factory=DecisionParameters)
    prior: PriorParameters = dataclasses.field(default_factory=PriorParameters)
    odometry: OdometryParameters = dataclasses.field(default_factory=OdometryParameters)
    manhattan: ManhattanParameters = dataclasses.field(default_factory=ManhattanParameters)
    time: TimeParameters = dataclasses.field(default_factory=TimeParameters)

    def __post_init__(self):
        super().__post_init__()
        for group, name in _LIMITED:
            least, greatest = (getattr(getattr(self, group), f'{name}_{end}') for end in ('min', 'max'))
            if 0.0 < greatest < least:
                raise ParameterError(f'{group}.{name}_min = {least}: expected at most {group}.{name}_max, which is {greatest}; '
                                     'set both at once, or first the one that still fits')

    @cached_property
    def widened(self):
        """The same with a search of more hypotheses, which is not repeated."""
        more = self.selection.widen
        rotation = dataclasses.replace(self.rotation, hypotheses=min(more * self.rotation.hypotheses, _MOST))
        candidates = min(more * self.selection.candidates, _MOST)
        selection = dataclasses.replace(self.selection, widen=1, refined=min(more * self.selection.refined, _MOST),
                                        candidates=candidates, heaviest=candidates)
        return dataclasses.replace(self, rotation=rotation, selection=selection)
