# SPDX-License-Identifier: Apache-2.0
"""Time of one scan's features and its registration, ours and GICP in turns on the same pairs; cost of the odometry.

A robot's computer is several times slower than the machine here and has other work: a pair may take a few milliseconds,
less than GICP, and a scan of the odometry fewer calls than it has steps to take.
"""
import numpy as np

from dbscan_reg_ros.evaluation.methods import method
from dbscan_reg_ros.recordings import open_recording

from .. import cost
from ..intel import Intel
from ..report import Report, at_most
from ..trials import Trial, run, summarise, thinned
from . import pairs, synthetic

BOUNDS = {
    'ms_p50': at_most(2.8), 'ms_p95': at_most(4.5), 'ms_p50_1141': at_most(4.0), 'ratio_gicp': at_most(0.7),
}
METHODS = ('dbscan', 'small_gicp')
PAIRS = 60
FINE_SCANS = 60


def fine_trials(folder, limit=None, seed=0) -> list:
    """Trials of 1141 beams: scans of a sensor that stood still, moved as in `synthetic`."""
    rng = np.random.default_rng(seed)
    items = []
    for scan in thinned(open_recording(folder / 'lms511' / 'static').scans(), limit or FINE_SCANS):
        truth = synthetic.random_motion(rng, 1.5, 0.5)
        current = synthetic.moved(scan, synthetic.disturbed(scan, synthetic.NOISE, 0.0, rng), truth)
        items.append(Trial('fine', str(scan.stamp), scan, current, truth))
    return items


def measure(args):
    """Return a `Report`; with ``--against`` or ``--calls`` on what a scan costs the odometry."""
    intel, report = Intel.below(args.data), Report()
    if args.against or args.calls:
        if args.against:
            cost.add_times(report, args.against, intel.folder)
        if args.calls:
            cost.add_calls(report, intel.folder)
        return report
    methods = [method(name) for name in args.method or METHODS]
    coarse = run(methods, pairs.trials(intel, args.limit or PAIRS), '180 beams')
    fine = run(methods, fine_trials(intel.folder.parent, args.limit), '1141 beams')
    metrics = {}
    for name in coarse:
        times = summarise(coarse[name])
        metrics[name] = {'ms_p50': times['ms_p50'], 'ms_p95': times['ms_p95'],
                         'ms_p50_1141': summarise(fine[name])['ms_p50']}
    for row in metrics.values():
        if 'small_gicp' in metrics:
            row['ratio_gicp'] = row['ms_p50'] / metrics['small_gicp']['ms_p50']
    report.add('speed', metrics, BOUNDS)
    return report
