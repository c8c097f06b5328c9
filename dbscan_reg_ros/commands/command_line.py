# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments, errors and exit statuses shared by all commands."""
import argparse
import itertools
import math
import os
import signal
import sys
import traceback
from concurrent.futures import BrokenExecutor
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

from ..allocation import keep_freed_memory
from ..command_lines import add_version, started_as
from ..core.errors import BuildError, DbscanRegError
from ..endings import discard, lasting_output
from ..paths import check_writable, ready_made
from ..requirements import ROS, MissingPackages, check_packages, is_there, missing_line

FAILED, BAD_INPUT, INCOMPLETE, INTERRUPTED = 1, 2, 3, 130
MOST_SHOWN = 5
BAGS = '.bag', '.mcap', '.db3'
LOGS = '.log', '.log.gz'
"""Endings of the file names of bags and of CARMEN logs."""


SEVERAL: dict[str, Any] = {
    'action': 'append', 'help': 'topic of the scans; required if there are several topics of scans. If given more than '
    'once, the poses are those of the lidar of the first topic; the other lidars are used as well'}
"""Settings of ``--topic`` in commands that take several lidars."""


class CommandError(DbscanRegError):
    """An argument of a command is invalid."""


class CommandParser(argparse.ArgumentParser):
    """Parser that accepts options between positional arguments, and options with a list before positional arguments."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._lists = {}

    def end_list(self, option, belongs):
        """End the values of `option` at the second or a later word for which ``belongs(word)`` is false."""
        self._lists[option] = belongs

    def parse_args(self, args=None, namespace=None):
        """Parse options and positional arguments in any order."""
        args = list(sys.argv[1:] if args is None else args)
        return self.parse_intermixed_args(self._ended_lists(args), namespace)

    def _ended_lists(self, args):
        """Reorder the arguments: move words that do not belong to the list of an option in front of this option."""
        ordered = []
        while args:
            option = args.pop(0)
            words = list(itertools.takewhile(lambda word: not word.startswith('-'), args))
            belongs = self._lists.get(option)
            if option == '--' or not belongs:
                ordered.append(option)
                continue
            count = 1 + sum(1 for _ in itertools.takewhile(belongs, words[1:]))
            ordered += [*words[count:], option, *words[:count]]
            del args[:len(words)]
        return ordered


def number(kind, low, high, expected):
    """Return a function that reads an argument: a number of this `kind`, int or float, from `low` to `high`."""
    def read(text):
        with suppress(ValueError):
            if low <= kind(text) <= high:
                return kind(text)
        raise argparse.ArgumentTypeError(f'{text!r}: expected {expected}')
    return read


positive = number(int, 1, math.inf, 'a whole number above 0')
seed = number(int, 0, 2**32 - 1, f'a whole number from 0 to {2**32 - 1}')


def make_parser(command, description, verbose='show the traceback of an error') -> CommandParser:
    """Make a parser with the options that every command takes."""
    parser = CommandParser(prog=command, description=description,
                           formatter_class=lambda prog: argparse.HelpFormatter(started_as(prog)))
    parser.add_argument('-v', '--verbose', action='store_true', help=verbose)
    add_version(parser)
    return parser


def add_recording(parser, topic, several=False):
    """Add the arguments that name a recording, or `several`, and the topic, with its argparse settings."""
    name, count = ('files', '+') if several else ('file', None)
    parser.add_argument(name, metavar='FILE', nargs=count, help='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag; '
                        'also searched for below the data folder')
    parser.add_argument('--topic', **topic)
    add_data(parser)


def add_mounting(parser):
    """Add the argument that gives the mountings of lidars."""
    parser.add_argument('--mounting', action='append', nargs='+', metavar='WORD', help='TOPIC X Y DEG [upside_down]: '
                        'pose of the lidar of a topic on the base [m, m, deg]; may be repeated (default: laser_pose '
                        'of the lidar in the parameter file; else, with several topics, that of the recording: '
                        'constant transforms of a bag, or the poses of laser and robot in a log)')


def add_parameters(parser, use='', otherwise=''):
    """Add the argument ``--params-file``; `use` follows what the file is, `otherwise` what its default is."""
    parser.add_argument('--params-file', metavar='YAML', action='append', default=[], help='parameter file as for '
                        f'ROS 2 nodes, or the name of a ready-made parameter set: {", ".join(ready_made())}{use}; if '
                        f'given more than once, a later file takes precedence (default: the default values{otherwise})')


def add_pictures(parser):
    """Add the arguments that choose the format and the size of pictures."""
    parser.add_argument('--format', choices=('png', 'pdf', 'svg'), default='png', help='format of the pictures; those '
                        'in pdf and svg are for papers: without titles and captions (default: png)')
    parser.add_argument('--size', type=number(float, 2.0, 50.0, '2 to 50 inches'), nargs=2,
                        metavar=('WIDTH', 'HEIGHT'), help='size of each picture [inch]')


def add_workers(parser):
    """Add the arguments that choose the number of local processes or a Dask cluster."""
    parser.add_argument('--processes', type=positive, metavar='N',
                        help='number of parallel processes (default: one per processor)')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='run on the Dask cluster of this scheduler instead '
                        'of local processes, e.g. tcp://10.0.0.1:8786; its workers must have access to the same files')


def shortened(problems) -> list:
    """Return the first `MOST_SHOWN` lines, followed by a line with the number of omitted lines."""
    more = len(problems) - MOST_SHOWN
    return [*problems[:MOST_SHOWN], f'and {more} more'] if more > 0 else list(problems)


def note_unused(command, paths, parameters, used):
    """Print which parameters that the files at `paths` set have no effect in `command`; those `used` have one."""
    if names := parameters.unused(used):
        print(f'{command}: {", ".join(paths)}: these parameters have no effect in {command}: {", ".join(names)}',
              file=sys.stderr)


def note_warnings(command, recording, most=None):
    """Print assumptions and damaged parts of a recording, and warnings about its scans (the first `most`, if given)."""
    warnings = recording.look_through(most).lines()
    for line in [*recording.notes, *shortened(recording.problems), *warnings]:
        print(f'{command}: {recording.path}: {line}', file=sys.stderr)


def open_all(paths, lidars, parameters) -> list:
    """Open the recordings at `paths`, each with the first of its `lidars`."""
    return [lidars.of_recording(path, parameters).open(path, parameters) for path in paths]


def add_data(parser):
    """Add the argument that names the folder of public recordings."""
    parser.add_argument('--data', metavar='DIR', help='folder that holds intel/ and the other recordings '
                        '(default: $DBSCAN_REG_DATA, else ../shared/data beside the project)')


def run(parser, work, argv=None, outlasts=True) -> int:
    """Parse `argv`, run `work(args)`; report an error in one line and as an exit status.

    With `outlasts`, the work goes on to its end although the reader of its output has ended; otherwise it ends then.

    Returns
    -------
    int
        Result of `work`, or 0 if it is None; 2 for bad input, 130 after Ctrl-C, 1 for any other failure.
        `work` returns 3 if it ran to its end but could not write all of its results.
    """
    args = parser.parse_args(argv)
    keep_freed_memory()
    try:
        # A signal that came while modules were imported is handled now.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
        check_packages(parser.prog, asked_for(args))
        check_outputs(args)
        with lasting_output() if outlasts else nullcontext():
            code = work(args) or 0
        print(end='', flush=True)
        return code
    except BrokenPipeError:
        # The reader of the output has ended, as `head` does.
        discard(sys.stdout)
        return FAILED
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - any error becomes one line
        return complain(parser.prog, error, args.verbose)


def asked_for(args):
    """Yield the names of modules that a command needs only with certain arguments."""
    given = vars(args)
    if given.get('scheduler'):
        yield 'distributed'
    if given.get('search') == 'optuna':
        yield 'optuna'
    if given.get('no_figures') is False:
        yield 'matplotlib'
    methods = given.get('method') or ()
    if 'paper' in (given.get('a'), given.get('b'), *([methods] if isinstance(methods, str) else methods)):
        yield 'sklearn'
    if given.get('live'):
        yield ROS
    bags = list(_bags(given))
    if bags and (any(bag.suffix == '.bag' for bag in bags) or not is_there('rosbag2_py')):
        yield 'rosbags'


def _bags(given):
    """Yield the paths of the bags among the `given` arguments, name -> value."""
    files = [given.get('file'), given.get('source'), *given.get('files', ()), *given.get('held_out', ())]
    for file in map(Path, filter(None, files)):
        if file.is_dir() or file.suffix in BAGS:
            yield file
    target = given.get('target')
    if target and not target.endswith(LOGS):
        yield Path(target)


def check_outputs(args):
    """Raise CommandError where an output named by the arguments cannot be written."""
    given = vars(args)
    if 'out' in given and not isinstance(given['out'], Path):
        folder = given['out'] or 'results'
        check_writable(folder, CommandError)
        if os.path.isfile(folder):
            raise CommandError(f'{folder}: expected a folder, but a file has this name; choose another folder')
    files = [given[name] for name in ('out', 'json', 'poses') if isinstance(given.get(name), Path)]
    for file in files:
        if file.is_dir() or not file.parent.is_dir():
            raise CommandError(f'{file}: expected the name of a file in an existing folder')
        check_writable(file, CommandError)


def is_topic(word) -> bool:
    """Whether a word of the command line is the name of a topic instead of a path."""
    path = Path(word)
    return word.startswith('/') and not path.exists() and (path.parent == Path('/') or not path.parent.exists())


def complain(command, error, verbose=False) -> int:
    """Print the line that explains `error`, and its traceback if `verbose`; return the exit status."""
    if verbose:
        traceback.print_exception(error)
    code, message = explain(error)
    print(f'{command}: {message}', file=sys.stderr)
    return code


def explain(error):
    """Return the exit status and a one-line message for an error, without the name of the Python exception."""
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, 'interrupted'
    if isinstance(error, (MissingPackages, BuildError)):
        return FAILED, str(error)
    if isinstance(error, DbscanRegError):
        return BAD_INPUT, str(error)
    if isinstance(error, ModuleNotFoundError) and error.name:
        return FAILED, missing_line([error.name.partition('.')[0]])
    if isinstance(error, BrokenExecutor):
        return FAILED, 'a worker process was killed, possibly for lack of memory: use fewer --processes'
    if isinstance(error, OSError) and error.strerror:
        return FAILED, f'{error.filename}: {error.strerror}' if error.filename else error.strerror
    return FAILED, f'internal error: {error} (-v shows where)'
