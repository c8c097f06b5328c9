# SPDX-License-Identifier: Apache-2.0
"""``register RECORDING REF CUR``, ``register SNAPSHOT [N]``: register two scans and draw each step."""
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..core.parameters.schema import ADVANCED
from .command_line import (
    SEVERAL,
    CommandError,
    add_data,
    add_mounting,
    add_parameters,
    add_pictures,
    make_parser,
    note_unused,
    note_warnings,
    run,
)

OF_A_DRIVE = 'odometry.', 'prior.', 'time.'
"""Prefixes, after `ADVANCED`, of parameters that have no effect on the registration of a single pair."""
PAIR = 2
"""Numbers of scans of a recording: reference and current."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('register', 'Register one scan to another without an initial guess, or show a registration '
                         'from a snapshot of the node. Prints the motion, its covariance and status, and the '
                         'hypotheses; draws the result of each step of the method as a picture of its own and, in '
                         'png, all of them on sheet.png. The beams of a scan count as measured at one instant: the '
                         'motion during a scan is not removed.', verbose='print the covariance as well; show the '
                         'traceback of an error')
    parser.add_argument('file', metavar='FILE', help='CARMEN log (plain or gzip), ROS 1 bag, ROS 2 bag, or a snapshot '
                        '(.npz) of the node; also searched for below the data folder')
    parser.add_argument('numbers', metavar='N', nargs='*', type=int, help='for a recording: the numbers of the '
                        'reference scan and of the current scan, from 0; for a snapshot: the number of the scan '
                        '(default: the last)')
    parser.add_argument('--topic', **SEVERAL | {
        'help': 'topic of the scans; required if there are several topics of scans. If given more than once, the scans '
        'of all these lidars are counted together in the order of their stamps, as in replay, and the motion is that '
        'of the lidar of the first topic'})
    add_mounting(parser)
    add_data(parser)
    add_parameters(parser, otherwise='; for a snapshot, the parameters stored in it; with other parameters, its scans '
                   'are registered again, without a prior')
    parser.add_argument('--method', choices=('dbscan', 'paper'), default='dbscan', help='dbscan: this package; paper: '
                        'the literal method of the paper, which has no parameters and no check of its result '
                        '(default: dbscan)')
    parser.add_argument('--truth', metavar='FILE', help='the true poses of the (first) sensor, from which the error '
                        'is computed: TUM, or the columns index,x,y,theta (default: the true poses in the recording or '
                        'in a file beside it, if any)')
    parser.add_argument('--figure4', action='store_true', help='the example of the paper, Figure 4: register scan N '
                        'of a recording (default: 0) to its own points moved by x -1.5 m, y 0.8 m, theta 0.3 rad')
    parser.add_argument('--no-figures', action='store_true', help='draw nothing, which takes most of the time')
    add_pictures(parser)
    parser.add_argument('--out', metavar='DIR', default='results', help='write the pictures to DIR/NAME_N_N/DATE and '
                        'link it as DIR/NAME_N_N/latest (default: results)')
    return run(parser, register, argv)


class Pair(NamedTuple):
    """Two scans to register.

    `registration` is a stored result and `truth` the true transform, each None if unknown; `timing` is None if unknown.
    `lidars` are the `LidarsOfPair`, and `limits` the `ScanParameters` of both scans, each None for a single lidar.
    """

    name: str
    reference: object
    current: object
    parameters: object
    registration: object = None
    truth: object = None
    timing: object = None
    lidars: object = None
    limits: object = None


def register(args):
    """Register the pair, print the result and draw each step."""
    from ..figures.sheet import SIZE, draw_figures
    from ..figures.texts import Timing, describe, fixed, status_text
    from ..recordings import find_recording
    from ..replays.lidars import scan_topics
    from ..replays.result_folder import new_folder, point_latest
    from ..robot.parameter_files import read_parameters

    path, parameters = find_recording(args.file, args.data), read_parameters(args.params_file)
    args.topic = scan_topics(args.topic, parameters)
    if args.method == 'paper':
        _check_paper(args, path)
    note_unused('register', args.params_file, parameters, _used(len(args.topic) > 1))
    if args.truth and (args.figure4 or path.suffix == '.npz'):
        raise CommandError(f'--truth {args.truth}: expected two scans of a recording')
    if args.figure4:
        pair = _moved(path, args, parameters)
    elif path.suffix == '.npz':
        pair = _of_snapshot(path, args.numbers, parameters if args.params_file else None)
    else:
        pair = _of_recording(path, args, parameters)
    steps = _steps(pair, args.method)
    print('\n'.join(describe(steps, pair.timing or Timing(), args.verbose, pair.lidars)), flush=True)
    if args.no_figures:
        return
    folder = new_folder(Path(args.out) / pair.name)
    transform = steps.registration.transform
    title = (f'{_title(pair)}: x {fixed(transform.x, 3)} m, y {fixed(transform.y, 3)} m, theta '
             f'{fixed(math.degrees(transform.theta), 2)} deg, {status_text(steps.registration)}')
    draw_figures(folder, steps, title, args.size or SIZE, args.format)
    point_latest(folder)
    print(f'figures     {folder}')


def _check_paper(args, path):
    """Raise CommandError for what the method of the paper does not know."""
    if args.params_file:
        raise CommandError(f'--method paper --params-file {args.params_file[-1]}: expected no parameters; the open '
                           'values of the paper are constants in core/paper')
    if path.suffix == '.npz':
        raise CommandError(f'{path}: a snapshot holds registrations of the node; --method paper expects a recording')


def _steps(pair, method):
    """Return the `Steps` that register a `Pair` with a `method`."""
    from ..figures.steps import ScanSteps, Steps

    if method == 'paper':
        return Steps.of_paper(pair.reference, pair.current, pair.truth)
    each = [pair.parameters] * PAIR
    if pair.limits:
        each = [replace(pair.parameters, scan=limits) for limits in pair.limits]
    return Steps.between(*map(ScanSteps.of, (pair.reference, pair.current), each), pair.parameters, pair.registration,
                         pair.truth)


def _title(pair):
    """Return the title of the pictures of a `Pair`, with the topics of several lidars."""
    lidars = pair.lidars
    return f'{pair.name}: {lidars.current.topic} in the frame of {lidars.reference.topic}' if lidars else pair.name


def _used(several):
    """Return the names of the parameters that have an effect on a pair of one lidar, or of `several`."""
    from ..robot.parameters import CLOUDS, METHOD, REPLAYED

    names = REPLAYED - {'odom_frame'} | {'scan_topics'} if several else METHOD | CLOUDS
    return [name for name in names if not name.removeprefix(ADVANCED).startswith(OF_A_DRIVE)]


def _moved(path, args, parameters):
    """Return a `Pair` of a scan and the same scan moved by the motion of the example in the paper."""
    from ..core.paper.pipeline import PAPER_MOTION, moved

    numbers = args.numbers
    if len(numbers) > 1 or min(numbers, default=0) < 0:
        raise CommandError(f'{path}: expected the number of one scan, from 0; got {numbers}')
    if len(args.topic) > 1:
        raise CommandError(f'--figure4: expected the topic of one lidar; got {", ".join(args.topic)}')
    number = numbers[0] if numbers else 0
    (lidar,), found = _scans(path, args, [number], parameters)
    scan = found.scans[number].scan
    return Pair(f'{lidar.recording.name}_{number}_moved', moved(scan), scan, parameters, truth=PAPER_MOTION)


def _of_recording(path, args, parameters):
    from ..figures.texts import Timing

    numbers = args.numbers
    if len(numbers) != PAIR or min(numbers) < 0:
        raise CommandError(f'{path}: expected the numbers of two scans, REF and CUR, from 0; got {numbers}')
    lidars, found = _scans(path, args, numbers, parameters)
    chosen = [found.scans[number] for number in numbers]
    reference, current = (each.scan for each in chosen)
    recording, several = lidars[0].recording, _lidars_of_pair(lidars, numbers, chosen)
    truth = _true_motion(recording, reference.stamp, current.stamp, args.truth)
    duration = max(reference.duration, current.duration)
    timing = Timing(1e-9 * (current.stamp - reference.stamp), duration,
                    _motion_of_lidars(lidars, found, duration, parameters) if duration else None)
    name = '_'.join((recording.name, *map(str, numbers)))
    if not several:
        return Pair(name, reference, current, parameters, truth=truth, timing=timing)
    return Pair(name, reference, current, parameters, truth=truth and several.transform_of(truth), timing=timing,
                lidars=several, limits=[lidars[each.lidar].limits for each in chosen])


def _lidars_of_pair(lidars, numbers, chosen):
    """Return the `LidarsOfPair` of the `chosen` scans with these `numbers`; None for a single lidar."""
    from ..figures.texts import LidarOfScan, LidarsOfPair

    if len(lidars) == 1:
        return None
    first = lidars[0].mounting.pose.inverse()
    return LidarsOfPair(lidars[0].recording.topic, *(
        LidarOfScan(number, lidars[each.lidar].recording.topic, first @ lidars[each.lidar].mounting.pose)
        for number, each in zip(numbers, chosen, strict=True)))


def _motion_of_lidars(lidars, found, duration, parameters):
    """Return the largest motion [m], [rad] of a lidar during its scan, as `_motion_during_scan`."""
    motions = []
    for number, lidar in enumerate(lidars):
        own = [each.own for each in found.scans.values() if each.lidar == number]
        limited = replace(parameters, scan=lidar.limits) if lidar.limits else parameters
        if own:
            motions.append(_motion_during_scan(found.around[number], own, duration, limited))
    return tuple(map(max, *motions)) if len(motions) > 1 and all(motions) else motions[0]


def _motion_during_scan(scans, numbers, duration, parameters):
    """Return the largest motion [m], [rad] during one of the scans, by their neighbours; None if unknown."""
    rates = {first: _rates(scans.get(first), scans.get(first + 1), parameters)
             for first in sorted({number - step for number in numbers for step in (0, 1)})}
    if not all(rates[number - 1] or rates[number] for number in numbers):
        return None
    speeds, turn_rates = zip(*filter(None, rates.values()), strict=True)
    return duration * max(speeds), duration * max(turn_rates)


def _rates(first, second, parameters):
    """Return the speed [m/s] and the turn rate [rad/s] from one scan to the next; None if unknown."""
    from ..core.errors import ScanError
    from ..core.parameters.tree import Parameters
    from ..core.registration.pipeline import register as register_scans
    from ..core.registration.records import Status

    if first is None or second is None or first.stamp == second.stamp:
        return None
    try:
        found = register_scans(first, second, replace(Parameters(), scan=parameters.scan))
    except ScanError:
        return None
    interval, motion = 1e-9 * abs(second.stamp - first.stamp), found.transform
    return ((math.hypot(motion.x, motion.y) / interval, abs(motion.theta) / interval)
            if found.status is Status.OK else None)


def _true_motion(recording, first, second, truth):
    """Return the true motion between two stamps [ns] from the file `truth`, or from the recording; None if unknown."""
    from ..evaluation.known_motion import KnownMotion
    from ..recordings.truth import read_truth

    if not truth:
        return KnownMotion.of(recording).between(first, second)
    motion = KnownMotion(read_truth(truth, recording), None, None).between(first, second)
    if motion is None:
        raise CommandError(f'{truth}: has no pose at the stamps of both scans, {1e-9 * first:.3f} and '
                           f'{1e-9 * second:.3f} s')
    return motion


def _scans(path, args, numbers, parameters):
    """Return the lidars of a recording, each a `RecordedLidar`, and the scans `Found` by their numbers."""
    from ..replays.lidars import Lidars, all_lidars, find_scans, parse_mountings

    if args.mounting and len(args.topic) <= 1:
        raise CommandError(f'--mounting {" ".join(args.mounting[0])}: expected --topic of several lidars; the motion '
                           'of a single lidar is that of its own frame')
    lidars = all_lidars(path, Lidars(args.topic, parse_mountings(args.mounting)), parameters)
    found = find_scans([each.measured(parameters) for each in lidars], numbers)
    if missing := [number for number in numbers if number >= found.read]:
        raise CommandError(f'{path}: no scan {max(missing)}; the recording contains {found.read} scans, numbered '
                           'from 0')
    for each in lidars:
        note_warnings('register', each.recording, max(numbers) + 1 if len(lidars) == 1 else each.recording.watch.seen)
    return lidars, found


def _of_snapshot(path, numbers, parameters):
    from ..figures.texts import Timing
    from ..recordings.snapshots import read_snapshot
    from ..robot.parameters import NodeParameters

    if len(numbers) > 1:
        raise CommandError(f'{path}: expected the number of one scan of the snapshot; got {numbers}')
    snapshot = read_snapshot(path)
    registered = [number for number, update in enumerate(snapshot.updates) if update.registration and update.reference]
    number = numbers[0] if numbers else max(registered, default=-1)
    if number not in registered:
        numbers = ', '.join(map(str, registered)) or 'none'
        raise CommandError(f'{path}: scan {number} was not registered; the registered scans of the snapshot: {numbers}')
    update = snapshot.updates[number]
    own = NodeParameters().replace(snapshot.parameters)
    timing = Timing(1e-9 * (update.scan.stamp - update.reference.stamp))
    return Pair(f'{path.stem}_{number}', update.reference, update.scan, parameters or own,
                None if parameters else update.registration, timing=timing)
