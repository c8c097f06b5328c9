# SPDX-License-Identifier: Apache-2.0
"""``replay FILE...``: run the same `Odometry` as the node over recordings, offline."""
import sys
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.errors import DbscanRegError, RecordingError
from ..paths import check_writable
from ..requirements import missing_line
from .command_line import (
    INCOMPLETE,
    SEVERAL,
    add_mounting,
    add_parameters,
    add_recording,
    add_workers,
    complain,
    explain,
    make_parser,
    note_unused,
    number,
    run,
    shortened,
)

RESOLUTION = 0.05
"""Side [m] of the cells of the occupancy grid, unless another is given."""
CELL = number(float, 0.001, 10.0, 'the side of a cell, 0.001 to 10 m; without a number, write the option behind the '
              'recordings')
AT_A_TIME = 50
"""Number of scans that are reported together: one by one takes longer, as the odometry evicts the code from caches."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('replay', 'Run the odometry over recordings, offline and as fast as possible. Each recording '
                         'gets a dated folder with report.html (a page with map, errors and scans to review), '
                         'trajectory.tum, map.png, metrics.json, a bag with /odom, /tf and /segments, and the '
                         'parameters used. Exit status 0: all results are written; 3: some are not, for example '
                         'because the disk is full, and standard error names them; 2: an argument or a recording '
                         'cannot be used; 130: interrupted; 1: any other failure.')
    add_recording(parser, SEVERAL, several=True)
    add_mounting(parser)
    parser.add_argument('--wheels', action='store_true', help='use the wheel odometry of the recording as the external '
                        'prior, as the node with prior.source odometry does (default: only with this value of '
                        'prior.source)')
    parser.add_argument('--imu', action='store_true', help='use the recorded yaw rates as the external prior, as the '
                        'node with prior.source imu does; with --wheels as with odometry+imu')
    add_parameters(parser)
    parser.add_argument('--out', metavar='DIR', default='results', help='write the results to DIR/NAME/DATE and link '
                        'it as DIR/NAME/latest; for several recordings, also write DIR/index.html (default: results)')
    parser.add_argument('--frame', choices=('lidar', 'base'), default='lidar', help='whose poses trajectory.tum, '
                        'closed.tum and truth.tum contain: those of the first lidar, or of the base, with the mounting '
                        'of the parameter file, else of the recording; errors and maps are those of the lidar '
                        '(default: lidar)')
    parser.add_argument('--close-loops', action='store_true', help='after the odometry, close loops: correct the '
                        'trajectory where the sensor returned to a place, and also write closed.tum and '
                        'map_closed.png')
    parser.add_argument('--map-out', metavar='FILE', type=Path, help='close loops, and write the map of key frames, in '
                        'which a robot can be localised, to FILE (.npz)')
    parser.add_argument('--map', metavar='FILE', type=Path, help='localise the drive, wherever it starts, in this map: '
                        'a file of --map-out, or the map.yaml of an occupancy grid; write in_map.tum, the poses of the '
                        'lidar in the map, with the axes of the robot; the page shows where it may be at each scan')
    parser.add_argument('--g2o', action='store_true', help='close loops, and write the pose graph of the key frames as '
                        'graph.g2o, with VERTEX_SE2 and EDGE_SE2')
    parser.add_argument('--animation', action='store_true', help='also write a moving picture of 12 s: each scan on '
                        'the growing map, then the closed map; animation.gif, its last frame animation.png, and '
                        'animation.mp4 where ffmpeg is found')
    parser.add_argument('--grid', type=CELL, nargs='?', const=RESOLUTION, metavar='M', help='also write '
                        'map.pgm and map.yaml, an occupancy grid with cells of M [m] as nav2_map_server loads it; with '
                        f'--close-loops of the corrected trajectory (default: {RESOLUTION:g})')
    add_workers(parser)
    return run(parser, replay, argv)


def replay(args):
    """Replay every recording and print its summary; return the exit status.

    The exit status is that of the first recording that failed, else `INCOMPLETE` if some results could not be written,
    else 0.
    """
    from ..replays.lidars import Lidars, parse_mountings, scan_topics
    from ..replays.odometry import GYROSCOPE, WHEELS, prior_parameters
    from ..replays.page.entries import write_replay_index
    from ..robot.parameter_files import read_parameters
    from ..robot.parameters import REPLAYED
    from .workers import workers

    if args.map_out:
        if len(args.files) > 1:
            raise DbscanRegError(f'--map-out {args.map_out}: expected one recording; {len(args.files)} are given')
        check_writable(args.map_out, DbscanRegError)
    parameters = read_parameters(args.params_file)
    if args.wheels or args.imu:
        source = '+'.join([WHEELS] * args.wheels + [GYROSCOPE] * args.imu)
        parameters = replace(parameters, prior=replace(parameters.prior, source=source))
    used = REPLAYED | prior_parameters(parameters)
    topics = scan_topics(args.topic, parameters)
    note_unused('replay', args.params_file, parameters, used | ({'scan_topics'} if topics else set()))
    place = Path.absolute if args.scheduler else Path
    args.out = place(Path(args.out))
    args.map_out, args.map = args.map_out and place(args.map_out), args.map and place(args.map)
    lidars = Lidars(topics, parse_mountings(args.mounting))
    with workers(args.processes, args.scheduler, len(args.files)) as executor:
        futures = [executor.submit(replay_one, place(_path(file, args)), lidars, parameters, args)
                   for file in args.files]
        outcomes = [_outcome(future, args.verbose) for future in futures]
    codes = [code for code, _ in outcomes]
    if entries := [entry for _, entry in outcomes if entry] if len(args.files) > 1 else []:
        write_replay_index(args.out, entries)
        print(f'index       {args.out / "index.html"}', flush=True)
    return next((code for code in codes if code not in (0, INCOMPLETE)), max(codes))


def _outcome(future, verbose):
    """Print the result of `replay_one`, a `Replayed` or an error; return its exit status and its entry of the index."""
    try:
        replayed = future.result()
    except Exception as error:  # noqa: BLE001 - the other recordings continue
        return complain('replay', error, verbose), None
    print('\n'.join(replayed.lines), flush=True)
    for fault in replayed.faults:
        print(f'replay: {fault}', file=sys.stderr)
    return replayed.code, replayed.entry


def _path(file, args):
    """Return the path of a recording; one of several that is not found must not stop the others."""
    from ..recordings import find_recording
    with suppress(RecordingError if len(args.files) > 1 else ()):
        return find_recording(file, args.data)
    return Path(file)


@dataclass(frozen=True)
class Replayed:
    """Outcome of a replay."""

    lines: list[str]
    """Lines of the summary."""
    faults: list[str]
    """One line for each part of the results that could not be written completely."""
    code: int = 0
    """Exit status."""
    entry: object = None
    """DriveEntry: entry of this replay in the index of several replays; None if its page was not written."""


def replay_one(path, lidars, parameters, options) -> Replayed:
    """Replay the recording at `path` with the arguments `options`; write its results to a new folder.

    Raises a DbscanRegError when the recording cannot be read, or fewer than two of its scans can be used.
    """
    from ..replays.lidars import lidars_of
    from ..replays.odometry import OwnBodies, describe_prior, recorded_motion, replay_odometry
    from ..replays.result_folder import Faults, point_latest, register_command
    from ..replays.results import Results
    from ..replays.trajectory import too_few
    from ..robot.parameter_files import write_parameters

    lidars = lidars.of_recording(path, parameters)
    recording = lidars.open(path, parameters)
    mounting, others = lidars_of(recording, lidars, parameters, options.frame == 'base')
    motion, broken = recorded_motion(parameters, recording), None
    bodies = OwnBodies([(recording.topic, mounting), *((each.recording.topic, each.mounting) for each in others)])
    odometry = replay_odometry(parameters, others, recording.topic, mounting, motion, bodies)
    faults = Faults(lambda error: explain(error)[1], options.verbose)
    results = Results(recording, odometry, options, faults)
    folder, trajectory = results.folder, results.trajectory
    faults.attempt('parameters.yaml', write_parameters, folder / 'parameters.yaml', parameters,
                   f'The parameters of the replay of {path.name}.')
    try:
        _follow(results)
    except Exception as error:  # noqa: BLE001 - what was found until then is written
        broken = error
    finally:
        results.write_poses('trajectory.tum', trajectory.stamps, trajectory.poses)
    if len(trajectory.poses) <= 1:
        raise broken or too_few(recording, trajectory)
    summary = results.write(register_command(folder, recording, lidars))
    faults.attempt('latest', point_latest, folder)
    prefix = f'{recording.topic}: ' if others else ''
    made = [f'map         {options.map_out}'] if options.map_out else []
    lines = [f'results     {folder}', *made, *(line for each in (recording, *(other.recording for other in others))
                                        for line in shortened(each.problems)),
             *(f'{prefix}{line}' for line in shortened(trajectory.problems)),
             *(f'{name:11} {value}' for name, value in (*describe_prior(parameters, motion), *summary))]
    return _replayed(results, lines, broken)


def _replayed(results, lines, broken) -> Replayed:
    """Return the outcome of a replay with the summary `lines`; `broken`: error that ended the replay early, or None."""
    from ..replays.bag import BAG_LIBRARIES, writes_bags

    faults = results.faults.lines
    code = INCOMPLETE if faults else 0
    if not writes_bags():
        faults.insert(0, f'bag not written: {missing_line(BAG_LIBRARIES[:1])}')
    if broken:
        code, reason = explain(broken)
        number = results.trajectory.number(len(results.trajectory.used))
        faults.insert(0, f'the results end before scan {number}: {reason}')
    return Replayed(lines, [f'{results.recording.path}: {fault}' for fault in faults], code, results.entry)


def _follow(results):
    """Run the odometry over the scans; pass each update to the trajectory, the bag and the report."""
    from ..replays.bag import odometry_bag, writes_bags
    from ..replays.lidars import prepared
    from .workers import watched

    recording, odometry, faults = results.recording, results.odometry, results.faults
    parameters, mounting = odometry.parameters, odometry.mounting
    stack, waiting = ExitStack(), deque()

    def report():
        while waiting:
            update = waiting.popleft()
            for part, add in reports.items():
                if add:
                    faults.attempt(part, add, update)

    reports = {'pairs to review': results.to_review.add, 'report.html': results.history.add,
               'map.png': lambda update: results.map_points.add(update.features.scan),
               'closed.tum': results.loops and results.loops.add, 'in_map.tum': results.in_map and results.in_map.add}
    if writes_bags():
        bag = odometry_bag(results.folder / 'bag', parameters, mounting)
        reports = {'bag': faults.attempt('bag', stack.enter_context, bag), **reports}
    try:
        scans = prepared(watched(recording.scans(), recording.name, recording.count), mounting,
                         parameters.input_of(recording.topic), recording.note)
        for update in results.trajectory.follow(scans, odometry):
            waiting.append(update)
            if len(waiting) == AT_A_TIME:
                report()
        if odometry.recordings:
            odometry.finish()
    finally:
        report()
        with faults.noted('bag'):
            stack.close()
