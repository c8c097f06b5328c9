# SPDX-License-Identifier: Apache-2.0
"""``compare A B FILE...``: two parameter sets or methods on the same recordings."""
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..evaluation.method_names import METHODS
from ..paths import config_folder, ready_made
from .command_line import (
    FAILED,
    CommandError,
    add_recordings,
    add_workers,
    make_parser,
    note_unused,
    open_all,
    run,
    seed,
)

ALL = 'all'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('compare', 'Run the odometry with A and with B over the same recordings and test whether B is '
                         'worse. Prints and draws the paired differences of the errors over 1 m with confidence '
                         'intervals (95 % for translation and rotation together). Exit status 0: B is not worse; 1: B '
                         'is worse.')
    for name in 'ab':
        parser.add_argument(name, metavar=name.upper(), help=f'a parameter file; or a parameter set: defaults, '
                            f'{", ".join(ready_made())}; or a method: {", ".join(METHODS)} (dbscan: the defaults)')
    add_recordings(parser)
    parser.add_argument('--seed', type=seed, default=0, help='seed of the bootstrap (default: 0)')
    parser.add_argument('--out', metavar='DIR', default='results', help='write the table and the picture to '
                        'DIR/compare/DATE and link it as DIR/compare/latest (default: results)')
    add_workers(parser)
    return run(parser, compare, argv)


def compare(args):
    """Run both over every recording, print and write the comparison; return 1 if B is worse, else 0."""
    from ..evaluation.comparison import known_motion, paired
    from ..recordings import find_recording
    from ..replays.result_folder import new_folder, point_latest
    from .workers import processors, workers

    competitors = _competitors((args.a, args.b))
    paths = [find_recording(file, args.data) for file in args.files]
    known = [known_motion(recording) for recording in open_all('compare', paths, args.topic)]
    if args.scheduler:
        paths = [path.absolute() for path in paths]
    with workers(min(args.processes or processors(), 2 * len(paths)), args.scheduler) as executor:
        trajectories = follow_all(executor, paths, args.topic, competitors)
    names = unique([path.name for path in paths])
    pairs = {name: paired(motion, *pair) for name, motion, pair in zip(names, known, trajectories, strict=True)}
    table = differences(pairs, args.seed)
    text = describe(table, args.a, args.b)
    print(text, flush=True)
    folder = new_folder(Path(args.out) / 'compare')
    (folder / 'table.txt').write_text(text + '\n', encoding='utf-8')
    write_differences(folder, table, args.a, args.b)
    point_latest(folder)
    print(f'results  {folder}')
    return FAILED if any(d.worse for d in table[ALL]) else 0


def _competitors(names):
    """Return the `Competitor` of each of the `names`; print which of their parameters have no effect."""
    from ..robot.parameters import METHOD

    competitors = [Competitor.named(name) for name in names]
    for name, competitor in zip(names, competitors, strict=True):
        if competitor.parameters:
            note_unused('compare', name, competitor.parameters, METHOD)
    return competitors



@dataclass(frozen=True)
class Competitor:
    """One side of the comparison: the odometry with `parameters`, or the method called `method`."""

    parameters: object = None
    method: str = ''

    @classmethod
    def named(cls, name) -> 'Competitor':
        """Return the competitor that an argument names: a method, ``defaults`` or a parameter file."""
        from ..evaluation.methods import FACTORIES, method
        from ..robot.parameter_files import read_parameters
        from ..robot.parameters import NodeParameters

        if name in ('defaults', 'dbscan'):
            return cls(NodeParameters())
        if name in FACTORIES and not Path(name).exists():
            method(name)
            return cls(method=name)
        if name in ready_made() and not Path(name).exists():
            return cls(read_parameters(config_folder() / f'{name}.yaml'))
        if not Path(name).exists():
            raise CommandError(f'{name}: no such file; expected a parameter file, a parameter set: defaults, '
                               f'{", ".join(ready_made())}; or a method: {", ".join(FACTORIES)}')
        return cls(read_parameters(name))

    def tracker(self):
        """Make a tracker with ``process(scan)`` in its initial state."""
        from ..core.odometry.pipeline import Odometry
        from ..evaluation.trackers import tracker
        return Odometry(self.parameters.for_odometry()) if self.parameters else tracker(self.method)


def follow_one(path, topic, competitor):
    """Run the competitor over the recording at `path`; return its `Trajectory`."""
    from ..recordings import open_recording
    from ..replays.trajectory import Trajectory
    from .workers import watched

    recording, trajectory = open_recording(path, topic), Trajectory()
    for _ in trajectory.follow(watched(recording.scans(), recording.name, recording.count), competitor.tracker()):
        pass
    return trajectory


def follow_all(executor, paths, topic, competitors):
    """Run every competitor over every recording; return a list of `Trajectory` for each recording."""
    futures = [[executor.submit(follow_one, path, topic, competitor) for competitor in competitors] for path in paths]
    return [[future.result() for future in row] for row in futures]


def unique(names):
    """Make names distinct: append a number to each repetition."""
    return [name if names.index(name) == place else f'{name} ({names[:place + 1].count(name)})'
            for place, name in enumerate(names)]


def differences(pairs, seed):
    """Name of the recording, or ``all`` -> `Difference` of translation and of rotation."""
    from ..evaluation.comparison import MEASURES, difference

    if not pairs:
        raise CommandError('no recording to compare on')
    groups = {name: [pair] for name, pair in pairs.items()} | {ALL: list(pairs.values())}
    return {name: [difference(group, row, seed) for row in range(len(MEASURES))] for name, group in groups.items()}


def write_differences(folder, table, a, b):
    """Write comparison.json and comparison.png."""
    import dataclasses
    import json

    from ..figures.plots import plot_differences

    content = {name: {d.unit: dataclasses.asdict(d) for d in row} for name, row in table.items()}
    (folder / 'comparison.json').write_text(json.dumps({'a': a, 'b': b, 'differences': content}, indent=1) + '\n',
                                            encoding='utf-8')
    plot_differences(folder / 'comparison.png', table, Path(a).name, Path(b).name)


def describe(table, a, b) -> str:
    """Format the comparison as a table with a concluding sentence."""
    width = max(len(name) for name in (*table, 'recording'))
    lines = [f'{"recording":{width}}  error over 1 m          A          B      B - A    interval']
    for name, row in table.items():
        for d, what in zip(row, ('translation', 'rotation'), strict=True):
            verdict = f'B {d.verdict}' if d.verdict else ''
            lines.append(f'{name:{width}}  {what:11} [{d.unit:>3}] {d.a:10.4f} {d.b:10.4f} {d.b - d.a:+10.4f}    '
                         f'{d.low:+.4f} to {d.high:+.4f}  {verdict}'.rstrip())
    verdicts = [f'{d.verdict} in {what}' for d, what in zip(table[ALL], ('translation', 'rotation'), strict=True)
                if d.verdict]
    lines.append(f'A: {a}  B: {b}  B is {" and ".join(verdicts) or "neither better nor worse"}.')
    return '\n'.join(lines)
