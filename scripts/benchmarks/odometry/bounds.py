# SPDX-License-Identifier: Apache-2.0
"""Bounds of all courses of the odometry, by views (`drift`, `honesty`, `worst`, `silent`) and of `sparse`.

They are what the odometry reached when they were set, with room for chance: a change that loses accuracy, calls noise
OK or takes longer misses one of them. A course that is not named has no bounds in that view.
"""
import numpy as np

from ..report import Bound, at_least, at_most
from . import moving_courses

HARDER = ('dropped', 'noise', 'person')
"""Courses that only ours has to drive unless methods are named."""
HARDER_FACTOR = 1.25

INTEL = {
    'relations_neighbour_mean_m': 0.016, 'relations_neighbour_mean_deg': 0.20,
    'relations_all_mean_m': 0.070, 'relations_all_mean_deg': 0.35,
    'rpe_1m_mean_m': 0.015, 'rpe_1m_median_m': 0.008, 'rpe_5m_mean_m': 0.030, 'rpe_5m_median_m': 0.025,
    'frozen': 0.003, 'ate_m': 0.10, 'ms_p50': 4.0, 'ms_p99': 12.0, 'ms_growth': 1.1,
}
SIMULATED = {'rpe_5m_mean_m': 0.05, 'rpe_5m_mean_deg': 0.5}
WITHIN = at_least(0.9)
DRIFT = {
    'intel': {name: at_most(limit) for name, limit in INTEL.items()},
    **{course: {name: at_most(HARDER_FACTOR * limit) for name, limit in INTEL.items()} for course in HARDER},
    **{course: {name: at_most(limit) for name, limit in SIMULATED.items()} | {'within': WITHIN}
       for course in ('rooms', 'corridors', 'halls', 'scanners')},
    'lms511': {'drift_m': at_most(0.001), 'drift_deg': at_most(0.02)},
    'chairs': {'rpe_5m_mean_m': at_most(0.05), 'within': WITHIN},
    'featureless': {'named': at_least(0.95), 'across_m': at_most(0.02), 'within': WITHIN},
}
DRIFT['noise']['disturbed_ok'] = at_most(0.0)
DRIFT['ahead'] = {'driven_off_m': at_most(0.3)}
"""Course -> bounds on the measures of `drift.judge`."""

KNOWN = at_least(0.97)
HONESTY: dict[str, Bound] = {
    'silent_count': at_most(0), 'wrong_count': at_most(0), 'fast_count': at_most(0), 'steps_within': KNOWN,
    '1s_within': KNOWN, '5s_within': KNOWN}
"""Bounds on the measures of `honesty.figures`, the same for all courses."""

WORST = {
    **{name: {'silent_count': at_most(0), 'stretches_count': at_most(0)}
       for name in ('passers', *moving_courses.COURSES)},
    'spin': {'rate_rms_deg': at_most(np.degrees(0.03)), 'rate_within': at_least(0.97)}}
"""Course -> bounds on the measures of `worst.figures`."""
SILENT = {'step_silent_count': at_most(0), '1m_silent_count': at_most(0)}
"""Bounds on the measures of `silent.silent`, the same for all courses."""
SPARSE = {f'intel_{distance}m': {'odometry': at_least(share), 'failed_ok_count': at_most(0)}
          for distance, share in ((0.8, 0.995), (1.2, 0.995), (1.6, 0.99), (2.0, 0.97), (2.4, 0.93))}
"""Course -> bounds on the measures of `sparse.compared`."""


def no_worse(laser_only) -> dict[str, Bound]:
    """With the wheels no measure may be worse than without; the steps' 95th percentile must be better."""
    bounds = {name: at_most(laser_only[name]) for name in INTEL if name in laser_only and not name.startswith('ms')}
    return bounds | {'step_p95_m': at_most(np.nextafter(laser_only['step_p95_m'], 0.0))}
