# SPDX-License-Identifier: Apache-2.0
"""``tune FILE...``: search the parameters that suit recordings."""
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import ParameterError
from .command_line import (
    CommandError,
    add_recordings,
    add_workers,
    make_parser,
    note_unused,
    note_warnings,
    positive,
    run,
    seed,
)

SEARCHED = ('refinement.map_scale', 'refinement.map_first_scale', 'refinement.damping', 'density.max_distance',
            'density.violation_weight', 'selection.preselection_tolerance')
"""Unless parameters are named."""


def main(argv=None) -> int:
    parser = make_parser('tune', 'Search the values of chosen parameters with which the odometry errs least over 1 m. '
                         'The best are written as a file for --params-file, with the gain on recordings that were held '
                         'out. The same command again goes on where a killed one was; with one seed the result is the '
                         'same, whatever the number of processes.')
    add_recordings(parser)
    parser.add_argument('--held-out', nargs='+', default=[], metavar='FILE', help='recordings with known truth to '
                        'measure the gain on, not used by the search')
    parser.add_argument('--parameters', nargs='+', default=SEARCHED, metavar='NAME[=LOW:HIGH]', help='what to search '
                        f'(default: {" ".join(SEARCHED)}); a range not given is a fifth to five times the default')
    parser.end_list('--parameters', is_parameter)
    parser.add_argument('--params-file', metavar='YAML', help='where to start, and what the other parameters are '
                        '(default: the defaults)')
    parser.add_argument('--trials', type=positive, default=100, metavar='N', help='(default: 100)')
    parser.add_argument('--seed', type=seed, default=0, help='of the search (default: 0)')
    parser.add_argument('--search', choices=('auto', 'optuna', 'random'), default='auto',
                        help='auto: Optuna where it is installed, else random (default: auto)')
    parser.add_argument('--objective', choices=('auto', 'truth', 'consistency'), default='auto',
                        help='truth: the error over 1 m; consistency: forward and backward pass agree and closed loops '
                        'close; auto: truth where it is known (default: auto)')
    parser.add_argument('--scans', type=positive, metavar='N', help='use the first N scans of each recording')
    parser.add_argument('--live', metavar='NODE', help='set the result on the running node of this full name')
    parser.add_argument('--out', metavar='DIR', help='the search and its result are kept there '
                        '(default: results/tune/NAME, after the first recording)')
    add_workers(parser)
    return run(parser, tune, argv)


def is_parameter(word) -> bool:
    """Whether the word of a command line says what to search, perhaps with a slip in it, and no file."""
    try:
        from ..robot.parameters import NodeParameters
    except ModuleNotFoundError:
        return True
    name, names = word.partition('=')[0], [d.name for d in NodeParameters().describe()]
    groups = {known.partition('.')[0] for known in names if '.' in known}
    return name in names or name.partition('.')[0] in groups and '.' in name and not Path(word).exists()


def tune(args):
    """Search, write the best and print what it is worth."""
    from ..evaluation.comparison import known_motion
    from ..recordings import find_recording, open_recording
    from ..robot.parameter_files import read_parameters, write_parameters
    from ..robot.parameters import METHOD, NodeParameters
    from ..tuning.objective import HOPELESS
    from ..tuning.searches import has_optuna
    from ..tuning.space import read_axis
    from ..tuning.study import Study
    from .workers import processors, workers

    start = read_parameters(args.params_file) if args.params_file else NodeParameters()
    note_unused('tune', args.params_file, start, METHOD)
    axes = [read_axis(text, start) for text in args.parameters]
    paths, held_out = ([find_recording(file, args.data).absolute() for file in files]
                       for files in (args.files, args.held_out))
    if set(paths) & set(held_out):
        raise CommandError(f'{next(iter(set(paths) & set(held_out)))}: is searched on, so it cannot be held out')
    recordings = [open_recording(path, args.topic) for path in (*paths, *held_out)]
    names = [recording.name for recording in recordings]
    for recording in recordings:
        note_warnings('tune', recording, args.scans)
    known = [known_motion(recording) for recording in recordings[len(paths):]]
    search = args.search if args.search != 'auto' else 'optuna' if has_optuna() else 'random'
    start_values = {axis.name: start.flatten()[axis.name] for axis in axes}
    settings = {'files': [str(path) for path in paths], 'topic': args.topic, 'scans': args.scans, 'seed': args.seed,
                'objective': args.objective, 'search': search, 'axes': [repr(axis) for axis in axes],
                'start': start_values, 'parameters': start.flatten()}
    folder = Path(args.out or Path('results', 'tune', names[0]))
    study = Study(folder, settings, axes)
    print(f'search      {search}, {study.known} of {args.trials} trials known, kept in {folder}', flush=True)
    jobs = (paths, args.topic, args.objective, args.scans)
    with workers(args.processes or processors(), args.scheduler) as executor:
        with progress(args.trials) as watch, said_when_interrupted(study, args.trials, folder):
            cost, values = study.run(args.trials, lambda trials: evaluated(executor, trials, start, *jobs), watch)
        first = study.cost_of_start
        if cost >= HOPELESS:
            raise CommandError('nothing could be judged: the drive is shorter than 1 m, or none of its scans was found; expected '
                               'a longer drive, or more of it (--scans)')
        best = start.replace(values)
        head = [f'Tuned on {", ".join(names[:len(paths)])}: {first:.5f} m before, {cost:.5f} m after, over 1 m '
                f'({args.trials} trials, {search}, seed {args.seed}).']
        write_parameters(folder / 'best.yaml', best, head[0])
        head += gain(executor, held_out, known, args.topic, start, best, args.seed)
    write_parameters(folder / 'best.yaml', best, '\n'.join(head))
    print('\n'.join(head))
    changed = [f'{name}: {start_values[name]} -> {value}' for name, value in values.items() if value != start_values[name]]
    print('\n'.join(changed or ['No other values were better: the best are those of the start.']))
    print(f'parameters  {folder / "best.yaml"}')
    if args.live:
        from ..node.interfaces.remote_parameters import write_remote
        write_remote(args.live, values, 10.0)
        print(f'live        set on {args.live}')


def evaluated(executor, trials, start, paths, topic, objective, limit):
    """(number, cost) of the `trials`, number -> values, as they are done: the mean over the recordings."""
    from ..tuning.objective import HOPELESS, cost_of
    from .workers import as_done

    candidates = {number: made for number, values in trials.items() if (made := candidate(start, values))}
    asked = [(path, topic, made, objective, limit) for made in candidates.values() for path in paths]
    yield from ((number, HOPELESS) for number in trials if number not in candidates)
    numbers, costs = [number for number in candidates for _ in paths], defaultdict(dict)
    for job, cost in as_done(executor, cost_of, asked):
        known = costs[numbers[job]]
        known[job] = cost
        if len(known) == len(paths):
            yield numbers[job], sum(known[job] for job in sorted(known)) / len(paths)


def candidate(start, values):
    """The parameters `start` with some `values` changed, or None where these contradict each other."""
    try:
        return start.replace(values)
    except ParameterError:
        return None


@contextmanager
def progress(total):
    """A bar with the best so far: gives ``watch(done, best)``."""
    from tqdm import tqdm

    with tqdm(total=total, desc='tune', unit=' trials', disable=None) as shown:
        def watch(done, best):
            shown.set_postfix_str(f'best {best:.5f} m', refresh=False)
            shown.update(done - shown.n)
        yield watch


@contextmanager
def said_when_interrupted(study, total, folder):
    """Print what is kept of a search that is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        print(f'kept        {study.known} of {total} trials, in {folder}: the same command goes on from there', flush=True)
        raise


def gain(executor, paths, known, topic, start, best, seed):
    """Lines that say what `best` is worth against `start` on recordings that the search has not seen."""
    from ..evaluation.comparison import difference, paired
    from .compare import Competitor, track_one

    if not paths:
        return ['No recording was held out: the gain on others is not known, and likely smaller.']
    futures = [[executor.submit(track_one, path, topic, Competitor(parameters)) for parameters in (start, best)]
               for path in paths]
    pairs = [paired(motion, *(future.result() for future in pair)) for motion, pair in zip(known, futures, strict=True)]
    d = difference(pairs, 0, seed, confidence=0.95)
    shares = [100.0 * (1.0 - each.b / each.a) for each in (difference([pair], 0, seed) for pair in pairs)]
    lines = [f'Held out ({len(paths)}): {d.a:.5f} m before, {d.b:.5f} m after, over 1 m; gain {d.a - d.b:+.5f} m, '
             f'95 % between {-d.high:+.5f} and {-d.low:+.5f} m; by recording '
             + ', '.join(f'{share:+.1f} %' for share in shares) + '.']
    if not (d.worse or d.better):
        lines.append('The gain is within the noise.')
    elif d.worse:
        lines.append('On the held-out recordings the result is worse than the start: do not use it.')
    return lines
