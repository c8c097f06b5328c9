# SPDX-License-Identifier: Apache-2.0
"""Parameters of the features of a scan."""


from dataclasses import dataclass

from .schema import ParameterGroup, parameter


@dataclass(frozen=True)
class ScanParameters(ParameterGroup):
    """Which returns of a scan are used, and how good they are."""

    range_min: float = parameter(0.0, "returns nearer than this are ignored; 0: the sensor's own limit", 'm', 0.0, 1000.0)
    range_max: float = parameter(0.0, "returns farther than this are ignored; 0: the sensor's own limit", 'm', 0.0, 1000.0)
    min_returns: int = parameter(8, 'a scan with fewer returns is skipped', 'beams', 3, 100000)
    noise_min: float = parameter(0.004, 'least range noise assumed, whatever the scan says', 'm', 0.0001, 1.0)
    noise_max: float = parameter(0.05, 'greatest range noise assumed', 'm', 0.0001, 1.0)
    noise_ratio_max: float = parameter(0.05, 'greatest range noise assumed as a share of the range: far returns that are noisier '
                                       'than near ones count less; 0: all count the same', '', 0.0, 0.5)


@dataclass(frozen=True)
class RingBandParameters(ParameterGroup):
    """Ring band filter (Eq. 3-4)."""

    test: str = parameter('consensus', 'what makes a beam an outlier: anchor (slopes from the beam before the ring, the '
                          'paper), consensus (on no line through two others of its ring), off', '',
                          choices=('anchor', 'consensus', 'off'))
    inner_threshold: int = parameter(2, 'T1: this many outliers in the inner ring remove the candidate', 'beams', 1, 4)
    outer_threshold: int = parameter(3, 'T2: this many outliers in the outer ring make it a corner', 'beams', 1, 8)
    gross_error: float = parameter(0.05, 'an outlier farther than this from its neighbours\' line is removed, never averaged; '
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
    max_segments: int = parameter(100, 'so many segments of a scan are kept, the longest', '', 2, 1000)
    depth_margin: float = parameter(0.15, 'an end is free when the next return lies this much deeper', 'm', 0.0, 10.0)
    corner_reach: float = parameter(0.1, 'two lines meet in a corner when both end this close to it', 'm', 0.0, 10.0)
    normal_reach: float = parameter(0.1, 'normals are fitted to neighbours up to this far on each side', 'm', 0.0, 10.0)
    normal_noise: float = parameter(4.0, 'or this far, in multiples of the range noise, where that is more', '', 0.0, 100.0)
    normal_beams: int = parameter(2, 'and to at least this many beams on each side', 'beams', 1, 100)
