# SPDX-License-Identifier: Apache-2.0
"""``tune FILE...``: search for parameter values that minimise the odometry error on recordings."""
import signal
from collections import defaultdict
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

from ..core.errors import ParameterError
from ..endings import interruptible
from ..requirements import is_there
from .command_line import (
    SEVERAL,
    CommandError,
    add_mounting,
    add_parameters,
    add_recording,
    add_workers,
    make_parser,
    note_unused,
    note_warnings,
    open_all,
    positive,
    run,
    seed,
)

SEARCHED = ('advanced.refinement.map_scale', 'advanced.refinement.map_first_scale', 'advanced.refinement.damping',
            'advanced.density.max_distance', 'advanced.density.violation_weight',
            'advanced.selection.preselection_tolerance')
"""Names of the parameters that are searched by default."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('tune', 'Search the parameter values with the smallest odometry error over 1 m. Writes the '
                         'best values as a parameter file and reports how much the error decreases on held-out '
                         'recordings. Running the '
                         'same command again continues an interrupted search. The result depends on the seed, not on '
                         'the number of processes.')
    add_recording(parser, SEVERAL, several=True)
    add_mounting(parser)
    parser.add_argument('--held-out', nargs='+', default=[], metavar='FILE', help='recordings with known truth that '
                        'the search does not use; the decrease of the error is measured on them')
    parser.add_argument('--parameters', nargs='+', default=SEARCHED, metavar='NAME[=LOW:HIGH]', help='parameters to '
                        'search, each with an optional range; without a range, values from a fifth to five times the '
                        f'default are tried (default: {" ".join(SEARCHED)})')
    parser.end_list('--parameters', is_parameter)
    add_parameters(parser, '; it holds the first values of the search, and the values of all parameters that are not '
                   'searched')
    parser.add_argument('--trials', type=positive, default=100, metavar='N', help='number of trials (default: 100)')
    parser.add_argument('--seed', type=seed, default=0, help='seed of the search (default: 0)')
    parser.add_argument('--search', choices=('auto', 'optuna', 'random'), default='auto',
                        help='search strategy; auto is optuna if Optuna is installed, else random (default: auto)')
    parser.add_argument('--objective', choices=('auto', 'truth', 'consistency'), default='auto',
                        help='cost to minimise. truth: the error over 1 m; consistency: the disagreement of a forward '
                        'and a backward pass and the gaps at loops; auto: truth if it is known (default: auto)')
    parser.add_argument('--scans', type=positive, metavar='N', help='use only the first N scans of each recording')
    parser.add_argument('--live', metavar='NODE', help='also set the result on the running node with this full name')
    parser.add_argument('--out', metavar='DIR', help='folder of the search and its result '
                        '(default: results/tune/NAME, named after the first recording)')
    add_workers(parser)
    return run(parser, tune, argv)


def is_parameter(word) -> bool:
    """Whether a word of the command line names a parameter, possibly misspelt, instead of a file."""
    try:
        from ..robot.parameters import NodeParameters
    except ModuleNotFoundError:
        return True
    name, names = word.partition('=')[0], [d.name for d in NodeParameters().describe()]
    groups = {group for known in names for group in known.split('.')[:-1]}
    return name in names or (name.partition('.')[0] in groups and '.' in name and not Path(word).exists())


def tune(args):
    """Search, write the best parameters and print how much they decrease the error."""
    from ..evaluation.comparison import known_motion
    from ..replays.lidars import Lidars, parse_mountings, scan_topics
    from ..replays.odometry import prior_parameters
    from ..robot.parameter_files import read_parameters, write_parameters
    from ..robot.parameters import REPLAYED
    from ..tuning.objective import HOPELESS
    from ..tuning.space import read_axis
    from ..tuning.study import Study
    from .competitors import Competitor, follow_all
    from .workers import workers

    start = read_parameters(args.params_file)
    lidars = Lidars(scan_topics(args.topic, start), parse_mountings(args.mounting))
    used = REPLAYED | prior_parameters(start) | ({'scan_topics'} if lidars.topics else set())
    note_unused('tune', args.params_file, start, used)
    axes = [read_axis(text, start) for text in args.parameters]
    searched, held_out = _recordings(args, lidars, start)
    known = [known_motion(recording) for recording in held_out]
    paths = [recording.path for recording in searched]
    task = Task(paths, [lidars.of_recording(path, start) for path in paths], args.objective, args.scans)
    settings = _settings(args, task, start, axes) | _given(lidars)
    search = settings['search']
    folder = Path(args.out or Path('results', 'tune', searched[0].name))
    study = Study(folder, settings, axes)
    print(f'search      {search}, {study.known} of {args.trials} trials known, stored in {folder}', flush=True)
    with workers(args.processes, args.scheduler) as executor:
        with progress(args.trials) as watch, said_when_interrupted(study, args.trials, folder):
            cost, values = study.run(args.trials, lambda trials: evaluated(executor, trials, start, task), watch)
        first = study.cost_of_start
        if cost >= HOPELESS:
            raise CommandError('no error could be computed: the drive is shorter than 1 m, or none of its scans could '
                               'be registered; expected a longer drive, or more of its scans (--scans)')
        best = start.replace(values)
        names = ', '.join(map(attrgetter('name'), searched))
        head = [f'Tuned on {names}: {first:.5f} m before, {cost:.5f} m after, over 1 m '
                f'({args.trials} trials, {search}, seed {args.seed}).']
        write_parameters(folder / 'best.yaml', best, head[0])
        competitors = Competitor('start', start), Competitor('best', best)
        trajectories = follow_all(executor, [recording.path for recording in held_out], lidars, competitors)
        head += gain(trajectories, known, args.seed)
    write_parameters(folder / 'best.yaml', best, '\n'.join(head))
    print('\n'.join([*head, *_changes(settings['start'], values)]))
    print(f'parameters  {folder / "best.yaml"}')
    if args.live:
        _set_live(args.live, values)


def _set_live(node, values):
    """Set the parameters, name -> value, on the running `node`."""
    from ..node.interfaces.remote_parameters import write_remote

    with interruptible(signal.SIGINT):
        write_remote(node, values, 10.0)
    print(f'live        set on {node}')


def _recordings(args, lidars, start):
    """Open the recordings used in the search and the held-out recordings; print the warnings about their scans.

    Raises a RecordingError or MountingError when a recording cannot be read, or one of its lidars has no scans or no
    known mounting.
    """
    from ..recordings import find_recording
    from ..replays.lidars import lidars_of

    paths, held_out = ([find_recording(file, args.data).absolute() for file in files]
                       for files in (args.files, args.held_out))
    if both := set(paths) & set(held_out):
        raise CommandError(f'{next(iter(both))}: is used in the search, so it cannot be held out')
    recordings = open_all((*paths, *held_out), lidars, start)
    for recording in recordings:
        note_warnings('tune', recording, args.scans)
    for recording in recordings:
        lidars_of(recording, lidars.of_recording(recording.path, start), start)
    return recordings[:len(paths)], recordings[len(paths):]


def _settings(args, task, start, axes):
    """Return the settings that determine the result of the search, for `Study`."""
    search = args.search if args.search != 'auto' else 'optuna' if is_there('optuna') else 'random'
    values = start.flatten()
    return {'files': [str(path) for path in task.paths],
            'scans': task.limit, 'seed': args.seed, 'objective': task.objective, 'search': search,
            'axes': [repr(axis) for axis in axes], 'start': {axis.name: values[axis.name] for axis in axes},
            'parameters': values}


def _given(lidars):
    """Return the settings that are the lidars given by the user."""
    mountings = {topic: repr(mounting) for topic, mounting in lidars.mountings.items()}
    return {'topics': lidars.topics, 'mountings': mountings}


def _changes(before, after):
    """Return a line for each parameter whose value differs between `before` and `after` the search."""
    changed = [f'{name}: {before[name]} -> {value}' for name, value in after.items() if value != before[name]]
    return changed or ['No other values had a lower cost: the best values are the initial ones.']


@dataclass(frozen=True)
class Task:
    """Arguments of `cost_of`: files of the recordings, the `Lidars` of each, objective, number of scans."""

    paths: list
    lidars: list
    objective: str
    limit: int | None

    def jobs(self, parameters):
        """Return the arguments of `cost_of` for each recording."""
        return [(path, lidars, parameters, self.objective, self.limit)
                for path, lidars in zip(self.paths, self.lidars, strict=True)]


def evaluated(executor, trials, start, task):
    """Yield (number, mean cost over the recordings) of the `trials` (number -> values) as they finish."""
    from ..tuning.objective import HOPELESS, cost_of
    from .workers import as_done

    jobs, count = [], len(task.paths)
    for number, values in trials.items():
        if parameters := candidate(start, values):
            jobs += [(number, job) for job in task.jobs(parameters)]
        else:
            yield number, HOPELESS
    costs = defaultdict(dict)
    for index, cost in as_done(executor, cost_of, [job for _, job in jobs]):
        number = jobs[index][0]
        costs[number][index] = cost
        if len(costs[number]) == count:
            yield number, sum(cost for _, cost in sorted(costs[number].items())) / count


def candidate(start, values):
    """Return the parameters `start` changed by `values` (name -> value); None if the values contradict each other."""
    try:
        return start.replace(values)
    except ParameterError:
        return None


@contextmanager
def progress(total):
    """Show a progress bar; provide ``watch(done, best)``, which updates it."""
    from tqdm import tqdm

    with tqdm(total=total, desc='tune', unit=' trials', disable=None) as shown:
        def watch(done, best):
            shown.set_postfix_str(f'best {best:.5f} m', refresh=False)
            shown.update(done - shown.n)
        yield watch


@contextmanager
def said_when_interrupted(study, total, folder):
    """Print how many trials are kept when the search is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        print(f'kept        {study.known} of {total} trials in {folder}; the same command continues from there',
              flush=True)
        raise



def gain(trajectories, known, seed):
    """Describe the change of the error on held-out recordings; `trajectories` has a pair (before, after) for each."""
    from ..evaluation.comparison import difference, paired

    if not trajectories:
        return ['No recording was held out: the improvement on other recordings is unknown, and probably smaller.']
    pairs = [paired(motion, *pair) for motion, pair in zip(known, trajectories, strict=True)]
    d = difference(pairs, 0, seed, confidence=0.95)
    shares = [100.0 * (1.0 - each.b / each.a) for each in (difference([pair], 0, seed) for pair in pairs)]
    lines = [f'Held out ({len(pairs)}): {d.a:.5f} m before, {d.b:.5f} m after, over 1 m; gain {d.a - d.b:+.5f} m, '
             f'95 % between {-d.high:+.5f} and {-d.low:+.5f} m; by recording '
             + ', '.join(f'{share:+.1f} %' for share in shares) + '.']
    if not (d.worse or d.better):
        lines.append('The improvement is not statistically significant (the 95 % interval contains zero).')
    elif d.worse:
        lines.append('On the held-out recordings the best values are worse than the initial values: do not use them.')
    return lines
