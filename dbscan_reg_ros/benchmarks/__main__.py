"""``python -m dbscan_reg_ros.benchmarks``: what ``scripts/bench`` runs."""
import argparse
import importlib
import json
import sys
from pathlib import Path

BENCHMARKS = {
    'pairs': 'pairs k, k+s of the Intel log without an initial guess',
    'relations': 'the Freiburg relations of the Intel log without an initial guess',
    'synthetic': 'Intel scans with noise and outliers, moved by a known motion',
    'speed': 'features of one scan plus registration, ours and GICP in turns',
}


def parser():
    parser = argparse.ArgumentParser(
        prog='bench', description='Benchmarks: a table in the terminal; exit status 1 when dbscan misses a bound.')
    commands = parser.add_subparsers(dest='benchmark', required=True, metavar='BENCHMARK')
    for name, help in BENCHMARKS.items():
        command = commands.add_parser(name, help=help, description=help)
        command.add_argument('--data', metavar='DIR', help='folder that holds intel/ '
                             '(default: $DBSCAN_REG_DATA, else ../shared/data)')
        command.add_argument('--method', nargs='+', metavar='NAME', help='only these methods (default: all that are '
                             'installed; for speed dbscan and small_gicp)')
        command.add_argument('--json', type=Path, metavar='FILE', help='write method -> metric -> number')
        command.add_argument('--limit', type=int, metavar='N', help='at most N trials of each kind, evenly spread')
        command.add_argument('-v', '--verbose', action='store_true', help='list every failure; traceback on errors')
    return parser


def main(argv=None) -> int:
    """Run one benchmark; 1 when a bound is missed, 2 for a usage error or unreadable data."""
    args = parser().parse_args(argv)
    from ..core.errors import DbscanRegError
    try:
        return bench(args)
    except DbscanRegError as error:
        if args.verbose:
            raise
        print(f'bench: {error}', file=sys.stderr)
        return 2


def bench(args) -> int:
    from . import report
    from .intel import Intel, data_folder
    from .methods import available, method
    module = importlib.import_module(f'.{args.benchmark}', __package__)
    default = getattr(module, 'METHODS', None)
    names = args.method or default
    methods = [method(name) for name in names] if names else available()
    print(report.machine())
    metrics, outcomes = module.measure(Intel(data_folder(args.data) / 'intel'), methods, args.limit)
    if args.verbose:
        for name, results in outcomes.items():
            print(f'\n{name}\n{report.failures(results)}')
    print(report.table(metrics))
    if args.json:
        args.json.write_text(json.dumps(metrics, indent=1))
    missed = report.verdict(metrics.get('dbscan', {}), module.BOUNDS)
    for line in missed:
        print(f'missed: {line}')
    return 1 if missed else 0


if __name__ == '__main__':
    sys.exit(main())
