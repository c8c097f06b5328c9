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
    add_recordings,
    add_workers,
    cell_size,
    complain,
    explain,
    make_parser,
    note_unused,
    run,
    shortened,
)

RESOLUTION = 0.05
"""Side [m] of the cells of the occupancy grid, unless another is given."""
AT_A_TIME = 50
"""Number of scans that are reported together: one by one takes longer, as the odometry evicts the code from caches."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('replay', 'Run the odometry over recordings, offline and as fast as possible. Each recording '
                         'gets a dated folder with report.html (a page with map, errors and scans to review), '
                         'trajectory.tum, map.png, metrics.json, a bag with /odom, /tf and /segments, and the '
                         'parameters used. Exit status 0: all results are written; 3: some are not, for example '
                         'because the disk is full, and standard error names them; 2: an argument or a recording '
                         'cannot be used; 130: interrupted; 1: any other failure. With -v the summary also '
                         'names parameters whose steps are not compiled: the slower numpy reference runs these.')
    add_recordings(parser, SEVERAL)
    add_mounting(parser)
    parser.add_argument('--wheels', action='store_true', help='use the wheel odometry of the recording as the external '
                        'prior, as the node with prior.source odometry does (default: only with this value of '
                        'prior.source)')
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
                        'lidar in the map, with the axes of the robot')
    parser.add_argument('--g2o', action='store_true', help='close loops, and write the pose graph of the key frames as '
                        'graph.g2o, with VERTEX_SE2 and EDGE_SE2')
    parser.add_argument('--animation', action='store_true', help='also write a moving picture of 12 s: each scan on '
                        'the growing map, then the closed map; animation.gif, its last frame animation.png, and '
                        'animation.mp4 where ffmpeg is found')
    parser.add_argument('--grid', type=cell_size, nargs='?', const=RESOLUTION, metavar='M', help='also write '
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
    from ..replays.odometry import WHEELS, wheel_parameters
    from ..replays.page.entries import write_replay_index
    from ..robot.parameter_files import read_parameters
    from ..robot.parameters import REPLAYED, NodeParameters
    from .workers import processors, workers

    if args.map_out:
        if len(args.files) > 1:
            raise DbscanRegError(f'--map-out {args.map_out}: expected one recording; {len(args.files)} are given')
        check_writable(args.map_out, DbscanRegError)
    parameters = read_parameters(args.params_file) if args.params_file else NodeParameters()
    if args.wheels:
        parameters = replace(parameters, prior=replace(parameters.prior, source=WHEELS))
    used = REPLAYED | wheel_parameters(parameters)
    topics = scan_topics(args.topic, parameters)
    note_unused('replay', args.params_file, parameters, used | ({'scan_topics'} if topics else set()))
    place = Path.absolute if args.scheduler else Path
    lidars = Lidars(topics, parse_mountings(args.mounting))
    jobs = [Job(place(_path(file, args)), lidars, parameters, place(Path(args.out)),
                args.close_loops or args.g2o or bool(args.map_out), args.verbose, args.animation, len(args.files) > 1,
                args.grid, args.frame == 'base', args.map_out and place(args.map_out), args.g2o,
                args.map and place(args.map))
            for file in args.files]
    with workers(min(args.processes or processors(), len(jobs)), args.scheduler) as executor:
        outcomes = [_outcome(future, args.verbose) for future in [executor.submit(replay_one, job) for job in jobs]]
    codes = [code for code, _ in outcomes]
    if entries := [entry for _, entry in outcomes if entry] if len(jobs) > 1 else []:
        write_replay_index(jobs[0].out, entries)
        print(f'index       {jobs[0].out / "index.html"}', flush=True)
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
class Job:
    """One recording to replay.

    Attributes
    ----------
    path : Path
    lidars : Lidars
    parameters : NodeParameters
    out : Path
        Folder below which the results are written.
    close_loops : bool
    verbose : bool
        Print the traceback of a fault.
    animation : bool
    indexed : bool
        An index of several replays is written, to which the page links.
    grid : float or None
        Side of the cells of the occupancy grid [m]; None: no grid is written.
    base : bool
        Write the poses of the base instead of those of the lidar.
    map_out : Path or None
        File of the map of key frames; None: it is not written.
    g2o : bool
        Write the pose graph.
    map : Path or None
        Map in which the drive is localised.
    """

    path: Path
    lidars: object
    parameters: object
    out: Path
    close_loops: bool = False
    verbose: bool = False
    animation: bool = False
    indexed: bool = False
    grid: float | None = None
    base: bool = False
    map_out: Path | None = None
    g2o: bool = False
    map: Path | None = None


@dataclass(frozen=True)
class Replayed:
    """Outcome of a replay.

    Attributes
    ----------
    lines : list of str
        Lines of the summary.
    faults : list of str
        One line for each part of the results that could not be written completely.
    code : int
        Exit status.
    entry : DriveEntry or None
        Entry of this replay in the index of several replays; None if its page was not written.
    """

    lines: list
    faults: list
    code: int = 0
    entry: object = None


def replay_one(job) -> Replayed:
    """Replay one recording; write its results to a new folder.

    Raises
    ------
    DbscanRegError
        When the recording cannot be read, or fewer than two of its scans can be used.
    """
    from ..figures.plots import MapPoints
    from ..replays.faults import Faults
    from ..replays.in_map import InMap
    from ..replays.lidars import lidars_of
    from ..replays.loops import Loops
    from ..replays.odometry import describe_prior, recorded_wheels, replay_odometry
    from ..replays.own_bodies import OwnBodies
    from ..replays.page.scan_history import ScanHistory
    from ..replays.pairs_to_review import PairsToReview
    from ..replays.result_folder import new_folder, point_latest, register_command
    from ..replays.results import Results
    from ..replays.trajectory import Trajectory, too_few
    from ..robot.parameter_files import write_parameters

    in_map = InMap(job.map, job.parameters.for_odometry()) if job.map else None
    lidars = job.lidars.of_recording(job.path, job.parameters)
    recording = lidars.open(job.path, job.parameters)
    mounting, others = lidars_of(recording, lidars, job.parameters, job.base)
    folder = new_folder(job.out / recording.name)
    faults = Faults(lambda error: explain(error)[1], job.verbose)
    yaw, broken = mounting.pose.theta, None
    wheels = recorded_wheels(job.parameters, recording)
    bodies = OwnBodies([(recording.topic, mounting), *((each.recording.topic, each.mounting) for each in others)])
    odometry = replay_odometry(job.parameters, others, recording.topic, mounting, wheels, bodies)
    trajectory = Trajectory(yaw, mounting.upside_down, numbers=odometry.numbers if others else [])
    results = Results(folder, recording, job.parameters, trajectory, PairsToReview(),
                      Loops() if job.close_loops else None, faults, ScanHistory(yaw), MapPoints(recording.count, yaw),
                      job.animation, '../../index.html' if job.indexed else '', odometry if others else None,
                      grid=job.grid, bodies=bodies, on_base=mounting.pose if job.base else None, map_out=job.map_out,
                      g2o=job.g2o, mounting=mounting.aligned_pose, in_map=in_map)
    faults.attempt('parameters.yaml', write_parameters, folder / 'parameters.yaml', job.parameters,
                   f'The parameters of the replay of {job.path.name}.')
    try:
        _follow(results, mounting, odometry)
    except Exception as error:  # noqa: BLE001 - what was found until then is written
        broken = error
    finally:
        results.write_poses('trajectory.tum', trajectory.stamps, trajectory.poses)
    if len(trajectory.poses) <= 1:
        raise broken or too_few(recording, trajectory)
    summary = results.write(register_command(folder, recording, lidars))
    faults.attempt('latest', point_latest, folder)
    prefix = f'{recording.topic}: ' if others else ''
    lines = [f'results     {folder}', *(line for each in (recording, *(other.recording for other in others))
                                        for line in shortened(each.problems)),
             *(f'{prefix}{line}' for line in shortened(trajectory.problems)),
             *(f'{name:11} {value}' for name, value in (*describe_prior(job.parameters, wheels), *summary))]
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


def _follow(results, mounting, odometry):
    """Run the odometry over the scans; pass each update to the trajectory, the bag and the report."""
    from ..replays.bag import odometry_bag, writes_bags
    from ..replays.lidars import prepared
    from .workers import watched

    recording, parameters = results.recording, results.parameters
    trajectory, faults = results.trajectory, results.faults
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
        for update in trajectory.follow(scans, odometry):
            waiting.append(update)
            if len(waiting) == AT_A_TIME:
                report()
        if results.lidars:
            results.lidars.finish()
    finally:
        report()
        with faults.noted('bag'):
            stack.close()
