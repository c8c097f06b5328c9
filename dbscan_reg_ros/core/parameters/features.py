# SPDX-License-Identifier: Apache-2.0
"""Parameters of the features of a scan."""
from dataclasses import dataclass

from .schema import ParameterGroup, parameter


@dataclass(frozen=True)
class ScanParameters(ParameterGroup):
    """Which returns of a scan are used, and their range noise."""

    BASIC = 'range_min', 'range_max', 'noise_min', 'noise_max', 'direction'

    range_min: float = parameter(
        0.0, unit='m', bounds=(0.0, 1000.0),
        help='Returns nearer than this are ignored. Larger values also drop near objects; 0 keeps the limit that the '
             'sensor states.')
    range_max: float = parameter(
        0.0, unit='m', bounds=(0.0, 1000.0),
        help='Returns farther than this are ignored. Smaller values drop far walls, which constrain the heading best; '
             '0 keeps the limit that the sensor states.')
    min_returns: int = parameter(
        8, unit='beams', bounds=(3, 100000),
        help='Scans with fewer returns than this are skipped. Larger values skip more sparse scans; smaller values '
             'process scans that can hardly be registered.')
    noise_min: float = parameter(
        0.004, unit='m', bounds=(0.0001, 1.0),
        help='Lower limit of the estimated standard deviation of a range. Larger values make every threshold that '
             'depends on the noise more tolerant; smaller values trust very smooth scans more.')
    noise_max: float = parameter(
        0.05, unit='m', bounds=(0.0001, 1.0),
        help='Upper limit of the estimated standard deviation of a range. Larger values suit noisier sensors; smaller '
             'values keep clutter from being taken for noise.')
    noise_ratio_max: float = parameter(
        0.05, bounds=(0.0, 0.5),
        help='Upper limit of the range noise relative to the range, for sensors whose far returns are noisier than '
             'near ones. Larger values reduce the weight of far returns more; 0 weighs all returns alike.')
    direction: str = parameter(
        'as_sent', choices=('as_sent', 'clockwise', 'counterclockwise'),
        help='Direction in which the sensor turns, seen from above. With as_sent, the beams are measured in the order '
             'in which they are sent; drivers of several clockwise sensors send them in the reverse order, which makes '
             'the motion within a scan be corrected wrongly.')


@dataclass(frozen=True)
class RingBandParameters(ParameterGroup):
    """Ring band filter (Eq. 3-4)."""

    test: str = parameter(
        'consensus', choices=('anchor', 'consensus', 'off'),
        help='Outlier test of the ring band filter: consensus, anchor (as in the paper) or off (no filter). With '
             'consensus, an outlier lies on no line through two other beams of its ring. With anchor, the slope of an '
             'outlier, seen from the beam before the ring, differs from the median slope.')
    inner_threshold: int = parameter(
        2, unit='beams', bounds=(1, 4),
        help='Threshold T1 of Eq. 4: an outlier is removed when the inner ring of three beams holds at least this many '
             'outliers. Larger values remove fewer points; smaller values remove more.')
    outer_threshold: int = parameter(
        3, unit='beams', bounds=(1, 8),
        help='Threshold T2 of Eq. 4: an outlier is kept as a corner when the outer ring of seven beams holds at least '
             'this many outliers. Larger values smooth more corners; smaller values keep more noise as corners.')
    gross_error: float = parameter(
        0.05, unit='m', bounds=(0.0, 100.0),
        help='An outlier farther than this from the line of its neighbours is removed instead of being averaged. '
             'Larger values average more outliers; 0 averages all of them.')
    slope_tolerance: float = parameter(
        0.2, unit='rad', bounds=(0.001, 3.2),
        help='With the anchor test a slope that differs from the median of its ring by more than this is an outlier. '
             'Larger values find fewer outliers; smaller values find more, corners among them.')
    jump: float = parameter(
        0.5, unit='m', bounds=(0.01, 100.0),
        help='The anchor test skips rings in which two neighbours lie farther apart than this. Larger values also test '
             'beams beside range jumps; smaller values test fewer beams.')
    relative_tolerance: float = parameter(
        0.01, bounds=(0.0, 1.0),
        help='Tolerance of the consensus test as a fraction of the range, to which three standard deviations of the '
             'noise are added. Larger values find fewer outliers far away; smaller values find more.')


@dataclass(frozen=True)
class SegmentParameters(ParameterGroup):
    """Line segments (Eq. 5-7) and normals."""

    BASIC = 'min_points', 'min_length'

    breakpoint_factor: float = parameter(
        8.0, bounds=(1.0, 100.0),
        help='Factor k of Eq. 5: two neighbouring points farther apart than k times the beam spacing lie on different '
             'surfaces. Larger values join surfaces across gaps; smaller values cut walls seen at a grazing angle.')
    breakpoint_noise: float = parameter(
        5.0, bounds=(0.0, 100.0),
        help='Multiple of the range noise that is added to the distance beyond which two neighbouring points lie on '
             'different surfaces (Eq. 5). Larger values keep noisy surfaces in one piece; smaller values cut them more '
             'often.')
    max_gap: int = parameter(
        8, unit='beams', bounds=(1, 1000),
        help='Two neighbouring points that are more than this many beams apart lie on different surfaces. Larger '
             'values bridge more beams without a return; smaller values cut surfaces at such gaps.')
    corners: str = parameter(
        'split', choices=('split', 'slope'),
        help='Corner detection: split (the point farthest from the chord of a surface) or slope (a jump in the slope '
             'of the ranges, as in the paper).')
    corner_thresholds: int = parameter(
        64, bounds=(2, 10000),
        help='Number of thresholds dk_th of Eq. 6 that slope corner detection tries. More thresholds find a better one '
             'and take longer; fewer are faster.')
    corner_penalty: float = parameter(
        200.0, bounds=(0.0, 1e6),
        help='Cost of each segment in slope corner detection, in units of the squared range noise. Larger values give '
             'fewer and longer segments; 0 minimises the mean fitting error only, which gives the most segments.')
    sections: int = parameter(
        0, bounds=(0, 1000),
        help='Number of equal sections of a segment; its line is fitted to the mean points of the sections (Eq. 7; the '
             'paper uses 5). Fewer sections average more points in each; 0 fits the line to all points.')
    split_distance: float = parameter(
        0.03, unit='m', bounds=(0.0, 10.0),
        help='A surface is split at its farthest point from the chord when that distance exceeds this plus '
             'three standard deviations of the noise. Larger values give fewer and longer segments; smaller '
             'values split at small bends.')
    split_levels: int = parameter(
        6, bounds=(1, 16),
        help='Number of times that all pieces of a surface are split in two, so that at most 2 to this power remain. '
             'Larger values resolve complex surfaces and take longer; smaller values leave corners undetected.')
    join_noise: float = parameter(
        2.5, bounds=(0.0, 100.0),
        help='Neighbouring pieces of a wall are joined to one line when the residual of that line is below this '
             'multiple of the range noise. Larger values give fewer and longer segments; smaller values leave walls in '
             'pieces.')
    join_gap: float = parameter(
        1.0, unit='m', bounds=(0.0, 100.0),
        help='Neighbouring pieces of a wall farther apart than this are never joined to one line. Larger values join '
             'walls across door openings; smaller values keep them apart.')
    min_points: int = parameter(
        4, unit='beams', bounds=(2, 1000),
        help='Segments with fewer points than this are dropped. Larger values keep only well-sampled lines; smaller '
             'values also keep lines far away.')
    min_length: float = parameter(
        0.15, unit='m', bounds=(0.0, 100.0),
        help='Segments shorter than this are dropped. Larger values keep only long walls; smaller values also keep '
             'short lines whose direction is uncertain.')
    max_segments: int = parameter(
        100, bounds=(2, 1000),
        help='Number of segments that are kept of a scan, the longest first. More segments give more hypotheses and '
             'take longer; fewer are faster.')
    depth_margin: float = parameter(
        0.15, unit='m', bounds=(0.0, 10.0),
        help='The end of a surface counts as a free edge when the next return is deeper by at least this. Larger '
             'values find fewer free edges and small objects; smaller values take noise for edges.')
    normal_reach: float = parameter(
        0.1, unit='m', bounds=(0.0, 10.0),
        help='Distance on each side of a point, along its surface, within which neighbours are used to fit its normal. '
             'Larger values give smoother normals and round off corners; smaller values follow details and noise.')
    normal_noise: float = parameter(
        4.0, bounds=(0.0, 100.0),
        help='Lower limit of the distance advanced.segments.normal_reach, as a multiple of the range noise. Larger '
             'values give smoother normals for noisy sensors; 0 uses advanced.segments.normal_reach alone.')
    normal_beams: int = parameter(
        2, unit='beams', bounds=(1, 100),
        help='Least number of neighbouring beams on each side of a point that are used to fit its normal. Larger '
             'values give smoother normals far away; smaller values leave far normals noisy.')
