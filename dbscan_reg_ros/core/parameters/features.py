# SPDX-License-Identifier: Apache-2.0
"""Parameters of the features of a scan."""
from dataclasses import dataclass

from .schema import ParameterGroup, parameter

AUTO = 'auto'
DIRECTIONS = AUTO, 'as_sent', 'clockwise', 'counterclockwise'
FIRST_BEAM, LAST_BEAM = 'first_beam', 'last_beam'


@dataclass(frozen=True)
class ScanParameters(ParameterGroup):
    """Which returns of a scan are used, and their range noise."""

    range_min: float = parameter(
        0.0, unit='m', bounds=(0.0, 1000.0),
        help='Returns with a smaller range than this are ignored. Larger values also ignore near objects; 0 uses the '
             'limit that the scan states.')
    range_max: float = parameter(
        0.0, unit='m', bounds=(0.0, 1000.0),
        help='Returns with a larger range than this are ignored. Smaller values also ignore far walls, which '
             'constrain the heading best; 0 uses the limit that the scan states.')
    min_returns: int = parameter(
        8, unit='beams', bounds=(3, 100000), case='symptom: many scans are skipped',
        help='Scans with fewer returns than this are skipped. Larger values skip more scans; smaller values also '
             'process scans that can hardly be registered.')
    noise_min: float = parameter(
        0.004, unit='m', bounds=(0.0001, 1.0),
        help='Lower limit of the estimated standard deviation of a range. Larger values make every threshold that '
             'depends on the noise more tolerant; smaller values make these thresholds stricter for scans with little '
             'noise.')
    noise_max: float = parameter(
        0.05, unit='m', bounds=(0.0001, 1.0),
        help='Upper limit of the estimated standard deviation of a range. Larger values suit sensors with more noise; '
             'with smaller values clutter increases the estimate less.')
    noise_ratio_max: float = parameter(
        0.05, bounds=(0.0, 0.5), case='course far_noise',
        help='Upper limit of the estimated ratio of range noise to range, for sensors whose far returns are noisier '
             'than near ones. With larger values errors of far returns can count less; with 0 all have the same '
             'noise.')
    direction: str = parameter(
        AUTO, bounds=DIRECTIONS,
        help='Direction in which the sensor turns, seen from above. With as_sent, the beams are measured in the order '
             'in which they are sent. Some drivers of clockwise sensors send the beams in the reverse order. With '
             'auto, the first rotations show it; until then, the motion during a scan is corrected wrongly.')
    revolution: float = parameter(
        0.0, unit='s', bounds=(0.0, 10.0),
        help='Time in which the sensor turns once. 0 uses the time_increment of the scans; where that is 0, the first '
             'rotations show whether the sensor turns once from one scan to the next. Larger values correct more '
             'motion during a scan.')
    stamp: str = parameter(
        FIRST_BEAM, bounds=(FIRST_BEAM, LAST_BEAM),
        help='Beam at whose time the stamp of a scan is: first_beam, as ROS defines it, or last_beam.')


@dataclass(frozen=True)
class RingBandParameters(ParameterGroup):
    """Ring band filter (Eq. 3-4)."""

    test: str = parameter(
        'consensus', bounds=('consensus', 'off'), case='courses far_noise, lidars',
        help='Outlier test of the ring band filter: consensus or off (no filter). With consensus, a beam is an outlier '
             'if it lies on no line through two other beams of its ring.')
    gross_error: float = parameter(
        0.05, unit='m', bounds=(0.0, 100.0), case='sensor with returns between two surfaces',
        help='An outlier farther than this from the line of its neighbours is removed instead of being averaged. '
             'Larger values average more outliers; 0 averages all of them.')


@dataclass(frozen=True)
class SegmentParameters(ParameterGroup):
    """Line segments (Eq. 5, 7) and normals."""

    breakpoint_factor: float = parameter(
        8.0, bounds=(1.0, 100.0), case='sensor with coarse bearings, along corridors',
        help='Factor k of Eq. 5: two neighbouring points lie on different surfaces if they are farther apart than k '
             'times the distance between two beams at their range. Larger values join surfaces across gaps; smaller '
             'values cut walls seen at a grazing angle.')
    breakpoint_noise: float = parameter(
        5.0, bounds=(0.0, 100.0), case='sensor with noisy ranges',
        help='Multiple of the range noise that is added to the distance beyond which two neighbouring points lie on '
             'different surfaces (Eq. 5). Larger values keep noisy surfaces in one piece; smaller values cut them more '
             'often.')
    max_gap: int = parameter(
        8, unit='beams', bounds=(1, 1000), case='sensor that drops beams',
        help='Two neighbouring points that are more than this many beams apart lie on different surfaces. Larger '
             'values bridge more beams without a return; smaller values cut surfaces at such gaps.')
    min_points: int = parameter(
        4, unit='beams', bounds=(2, 1000), case='sensor with few beams',
        help='Segments with fewer points than this are dropped. Larger values keep only well-sampled lines; smaller '
             'values also keep lines far away.')
    min_length: float = parameter(
        0.15, unit='m', bounds=(0.0, 100.0), case='building with much furniture',
        help='Segments shorter than this are dropped. Larger values keep only long walls; smaller values also keep '
             'short lines whose direction is uncertain.')
