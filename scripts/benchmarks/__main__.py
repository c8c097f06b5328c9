# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks``: what ``scripts/bench`` runs."""
import argparse
import sys
from importlib import import_module
from pathlib import Path

from dbscan_reg_ros.command_lines import add_version
from dbscan_reg_ros.commands.command_line import add_data, positive, run
from dbscan_reg_ros.evaluation.method_names import METHODS

BENCHMARKS = {
    'pairs': 'pairs k, k+s of the Intel log without an initial guess',
    'relations': 'the Freiburg relations of the Intel log without an initial guess',
    'synthetic': 'Intel scans with noise and outliers, moved by a known motion',
    'overlap': 'any motion without a prior, by the overlap of the views; precision and recall of the status',
    'covariance': 'whether the covariances agree with the errors, in simulated worlds',
    'confidence': 'calibration of the confidence of registrations, and the fit of its model',
    'paper': 'Table 1, Table 3, Figure 4 and the example of Figures 4 to 12 beside the published numbers',
    'speed': 'features of one scan plus registration, ours and GICP in turns',
    'odometry': 'odometry on recordings and in simulated worlds: drift, honesty, the worst of a drive, silent errors',
    'sparse': 'key frames far apart: the odometry beside registrations without a guess',
    'sensors': 'odometry of each lidar with its parameter file, beside the defaults and all other files',
    'ablation': 'the odometry without one feature at a time, on the courses that should need it',
    'lidars': 'two lidars, one wrong, late or silent, or at another height; own body, cross-talk; three lidars',
    'loops': 'wrong loop closures, and the error with and without them, on Intel and ten simulated tours',
    'places': 'localisation in a map from any start: found, wrong, and what is said outside the map',
    'node': 'the running node: latency, load of a core, memory, time to start; two lidars beside one',
    'soak': 'hours of driving: memory, time, containers, equal bits in every run and in the node',
    'page': 'pages in a browser: that of the Intel log, and the live page with the latency of the node',
    'fingerprint': 'whether another commit gives the same numbers, bit for bit',
}
MODULES = {
    **{name: f'registration.{name}' for name in (
        'pairs', 'relations', 'synthetic', 'overlap', 'speed', 'covariance', 'confidence', 'loops')},
    **{name: f'odometry.{name}' for name in ('drift', 'honesty', 'worst', 'silent', 'sparse', 'ablation')},
    'paper': 'paper.paper', 'sensors': 'sensors', 'lidars': 'lidars.wrong', 'places': 'places.places',
    'node': 'node.streams', 'soak': 'node.soak', 'page': 'page.page', 'fingerprint': 'fingerprint',
}
"""Benchmark, or view of the odometry -> module of this package."""
VIEWS = {'drift': 'errors over 1 and 5 m, frozen scans, times',
         'honesty': 'errors of dbscan beside the published covariances',
         'worst': 'the largest errors of a drive, and steps and stretches that are OK and wrong',
         'silent': 'steps and metres of dbscan that are OK and wrong'}
OURS_ONLY = ('node', 'soak', 'covariance', 'confidence', 'loops', 'ablation', 'page', 'lidars', 'sensors', 'places',
             'fingerprint')
"""No other method has what they measure."""
SIMULATED = ('node', 'lidars', 'soak', 'covariance', 'overlap', 'sensors')
"""They need no recordings."""


def option(*names, **settings):
    """Return the arguments of ``add_argument``."""
    return names, settings


PROCESSES = option('--processes', type=positive, metavar='N', help='at a time (default: one for each processor)')
OPTIONS = {
    'odometry': [
        option('--view', choices=VIEWS, default='drift',
               help='; '.join(f'{name}: {summary}' for name, summary in VIEWS.items()) + ' (default: drift)'),
        option('--course', nargs='+', metavar='NAME', help='only these; a wrong name lists all'),
        option('--prior', choices=('none', 'wheel', 'imu'), default='none',
               help='source of the external prior, for drift and honesty; wheel: the odometry of the log, '
               'compared with laser only on Intel; imu: the true rotations, 1 %% too large, with noise of '
               '3 mrad'),
        option('--poses', type=Path, metavar='FILE.csv',
               help='write the poses of dbscan on the first course as index,x,y,theta,ms'),
        option('--copies', type=positive, metavar='N',
               help='drift: mean and two standard errors (+-) over N copies of each course with 2 mm of '
               'noise on the ranges, without bounds'),
        option('--seeds', type=positive, metavar='N',
               help='the first N seeds, of courses that take seeds (worst: 10)'),
        PROCESSES],
    'confidence': [
        option('--fit', action='store_true', help='fit the coefficients and print them'),
        PROCESSES],
    'sensors': [
        option('--sensor', nargs='+', metavar='NAME', help='only the lidars of these parameter files'),
        option('--seeds', type=positive, default=2, metavar='N', help='drives of each world (default: 2)'),
        option('--seconds', type=positive, default=15, metavar='S', help='length of a drive (default: 15)'),
        PROCESSES],
    'lidars': [
        option('--only', nargs='+', choices=('wrong', 'body', 'number', 'silent', 'heights'),
               help='only these tables: a wrong second or first lidar, own body and cross-talk, number of '
               'lidars, one lidar silent for a while, pairs of lidars at different heights'),
        option('--seeds', type=positive, default=5, metavar='N',
               help='drives of each kind in the last four tables; four pairs for each (default: 5)'),
        PROCESSES],
    'overlap': [
        option('--pairs', type=positive, default=500, metavar='N',
               help='of each class and world (default: 500)'),
        option('--lidar', nargs='+', choices=('180', '270', '360'), help='only these fields of view [deg]'),
        option('--world', nargs='+', help='only these; the busy ones with people and clutter',
               choices=('corridors', 'halls', 'rooms', 'busy_corridors', 'busy_halls', 'busy_rooms')),
        option('--motion', nargs='+', choices=('any', 'near'), help='only these; near: within 1.5 m and 0.6 rad'),
        option('--noise', nargs='+', choices=('low', 'high'), help='only these'),
        PROCESSES],
    'ablation': [
        option('--feature', nargs='+', metavar='NAME', help='only these; a wrong name lists all'),
        option('--course', nargs='+', metavar='NAME',
               help='on these courses instead of those named for each feature'),
        option('--copies', type=positive, metavar='N', help='of each course with 2 mm of noise on the ranges '
               '(default: 4; 2 with --quick)'),
        option('--quick', action='store_true', help='only the first 150 scans of one drive of each course, '
               'and only the courses named for a feature'),
        option('--cache', type=Path, metavar='DIR', default=Path('results/ablation'),
               help='keep the results in this folder: an interrupted run continues (default: %(default)s)'),
        PROCESSES],
    'speed': [
        option('--against', metavar='COMMIT',
               help='instead: time of a scan in the odometry, this source tree and COMMIT in turns'),
        option('--calls', action='store_true',
               help='instead: functions, calls and objects of a tracked scan in the odometry')],
    'node': [
        option('--against', metavar='COMMIT',
               help='the node of this source tree and that of COMMIT in turns, with one lidar')],
    'places': [
        option('--seeds', type=positive, default=3, metavar='N', help='simulated floors (default: 3)'),
        option('--only', nargs='+', help='only these tables',
               choices=('intel', 'vote', 'grids', 'floors', 'wings', 'carried', 'outside'))],
    'fingerprint': [
        option('--against', metavar='COMMIT', required=True,
               help='the commit that this source tree is compared with'),
        option('--quick', action='store_true',
               help='only the first 500 scans of each recording, 200 of three drives of each '
               'course, and 50 pairs'),
        option('--only', nargs='+', metavar='NAME',
               help='only these drives: the recordings and simulated courses by '
               'their names, intel_wheels, mounted, upside_down, moving, the same three after node_, and '
               'pairs'),
        option('--cache', type=Path, metavar='DIR',
               help='keep the scans, and the results of the other commit, '
               'in this folder (default: results/fingerprint)')],
    'page': [option('--only', nargs='+', choices=('report', 'live'), help='only these tables')],
    'paper': [option('--only', nargs='+', choices=('table1', 'table3', 'figure4', 'steps'), help='only these tables')],
}
"""Benchmark -> its options."""


def main(argv=None) -> int:
    """Run one benchmark; 1 when a bound is missed, 2 for bad input."""
    return run(make_parser(), bench, argv, outlasts=False)


def make_parser():
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='bench', description='Benchmarks: a table in the terminal; exit status 1 when dbscan misses a bound.')
    add_version(parser)
    commands = parser.add_subparsers(dest='benchmark', required=True, metavar='BENCHMARK')
    for name, summary in BENCHMARKS.items():
        command = commands.add_parser(name, help=summary, description=summary)
        if name not in SIMULATED:
            add_data(command)
        if name not in OURS_ONLY:
            command.add_argument('--method', nargs='+', metavar='NAME',
                                 help=f'only these methods, of {", ".join(METHODS)}')
        command.add_argument('--json', type=Path, metavar='FILE', help='write method -> metric -> number')
        command.add_argument('--limit', type=positive, metavar='N',
                             help='at most N trials of each kind, evenly spread; of each drive the first N scans')
        command.add_argument('-v', '--verbose', action='store_true',
                             help='list every trial that failed or was not OK; show the traceback of an error')
        for names, settings in OPTIONS.get(name, ()):
            command.add_argument(*names, **settings)
    return parser


def bench(args):
    """Measure, print the tables and the bounds that are missed."""
    import json

    from .report import machine
    print(machine())
    module = MODULES[getattr(args, 'view', args.benchmark)]
    report = import_module(f'.{module}', __package__).measure(args)
    print('\n\n'.join(report.tables))
    if args.json:
        args.json.write_text(json.dumps(report.measured(), indent=1) + '\n')
    for line in report.missed:
        print(f'missed: {line}')
    return 1 if report.missed else 0


if __name__ == '__main__':
    sys.exit(main())
