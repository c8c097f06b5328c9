# SPDX-License-Identifier: Apache-2.0
"""``replay FILE...``: the odometry of recordings, offline, through the same `Odometry` as the node."""
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from ..command_lines import command_line
from .command_line import add_recordings, add_workers, complain, explain, make_parser, note_unused, run, shortened


def main(argv=None) -> int:
    parser = make_parser('replay', 'Odometry of recordings, offline, as fast as it goes. Each gets a dated folder with '
                         'report.html, a page that shows it all; trajectory.tum, map.png and metrics.json; a bag with '
                         '/odom, /tf and /segments; and the parameters used.')
    add_recordings(parser)
    parser.add_argument('--params-file', metavar='YAML', help='parameters in the form of ROS 2 (default: the defaults)')
    parser.add_argument('--out', metavar='DIR', default='results', help='the results go to DIR/NAME/DATE, with a link '
                        'DIR/NAME/latest (default: results)')
    parser.add_argument('--close-loops', action='store_true', help='when all is over, bend the way until places seen again '
                        'lie on one another: closed.tum and map_closed.png as well')
    add_workers(parser)
    return run(parser, replay, argv)


def replay(args):
    """Replay every recording, and print what came of each; the exit status is that of the first that failed."""
    from ..recordings import find_recording
    from ..robot.parameter_files import read_parameters
    from ..robot.parameters import REPLAYED, NodeParameters
    from .workers import processors, workers

    parameters = read_parameters(args.params_file) if args.params_file else NodeParameters()
    note_unused('replay', args.params_file, parameters, REPLAYED)
    place = Path.absolute if args.scheduler else Path
    jobs = [Job(place(find_recording(file, args.data)), args.topic, parameters, place(Path(args.out)), args.close_loops,
                args.verbose)
            for file in args.files]
    code = 0
    with workers(min(args.processes or processors(), len(jobs)), args.scheduler) as executor:
        for future in [executor.submit(replay_one, job) for job in jobs]:
            try:
                replayed = future.result()
            except Exception as error:  # noqa: BLE001 - the other recordings go on
                failed = complain('replay', error, args.verbose)
                code = code or failed
            else:
                print('\n'.join(replayed.lines), flush=True)
                for fault in replayed.faults:
                    print(f'replay: {fault}', file=sys.stderr)
                code = code or replayed.code
    return code


@dataclass(frozen=True)
class Job:
    """What is to be replayed, `path` and `topic` of the recording; the results go below `out`; whether loops are closed, and
    whether the traceback of a fault is printed."""

    path: Path
    topic: str | None
    parameters: object
    out: Path
    close_loops: bool = False
    verbose: bool = False


@dataclass(frozen=True)
class Replayed:
    """What came of a recording: the `lines` that say how it went, one of the `faults` for each part of the results that is not
    whole, and the exit status."""

    lines: list
    faults: list
    code: int = 0


def replay_one(job) -> Replayed:
    """Replay one recording into a folder of its own.

    Raises
    ------
    DbscanRegError
        When it cannot be read, or fewer than two of its scans can be used.
    """
    from ..recordings import open_recording, write_tum
    from ..replays.faults import Faults
    from ..replays.loops import Loops
    from ..replays.pairs_to_review import PairsToReview
    from ..replays.result_folder import new_folder, point_latest
    from ..replays.results import Results
    from ..replays.sensor_mounting import mounting_of
    from ..replays.trajectory import Trajectory
    from ..robot.parameter_files import write_parameters

    mounting = mounting_of(job.parameters)
    recording = open_recording(job.path, job.topic)
    folder = new_folder(job.out / recording.name)
    faults = Faults(lambda error: explain(error)[1], job.verbose)
    results = Results(folder, recording, job.parameters, Trajectory(yaw=mounting.pose.theta), PairsToReview(),
                      Loops() if job.close_loops else None, faults)
    faults.attempt('parameters.yaml', write_parameters, folder / 'parameters.yaml', job.parameters,
                   f'The parameters of the replay of {job.path.name}.')
    trajectory, broken = results.trajectory, None
    try:
        _follow(results, mounting)
    except Exception as error:  # noqa: BLE001 - what was found until then is written
        broken = error
    finally:
        write_tum(folder / 'trajectory.tum', trajectory.stamps, trajectory.poses)
    if len(trajectory.poses) < 2:
        raise broken or _too_few(recording, trajectory)
    summary = results.write(register_command(folder, recording))
    faults.attempt('latest', point_latest, folder)
    code, reason = explain(broken) if broken else (0, '')
    lines = [f'results     {folder}', *shortened(recording.problems), *shortened(trajectory.problems),
             *(f'{name:11} {value}' for name, value in summary)]
    ends = [f'the results end before scan {len(trajectory.used)}: {reason}'] if broken else []
    return Replayed(lines, [f'{recording.path}: {line}' for line in (*ends, *faults.lines)], code)


def _follow(results, mounting):
    """Feed the scans to an `Odometry`, and what it says to the trajectory, the bag and what is reported later."""
    from ..core.odometry.pipeline import Odometry
    from ..replays.bag import odometry_bag
    from ..replays.sensor_mounting import turned
    from .workers import watched

    recording, parameters, trajectory, faults = results.recording, results.parameters, results.trajectory, results.faults
    stack = ExitStack()
    bag = odometry_bag(results.folder / 'bag', parameters, mounting)
    reports = {'bag': faults.attempt('bag', stack.enter_context, bag), 'pairs to review': results.to_review.add,
               'closed.tum': results.loops and results.loops.add}
    try:
        scans = turned(watched(recording.scans(), recording.name, recording.count), trajectory.yaw)
        for update in trajectory.follow(scans, Odometry(parameters.for_odometry())):
            for part, add in reports.items():
                if add:
                    faults.attempt(part, add, update)
    finally:
        with faults.noted('bag'):
            stack.close()


def _too_few(recording, trajectory):
    """The error of a recording of which fewer than two scans can be used."""
    from ..core.errors import DbscanRegError

    count = len(trajectory.used)
    if count == 1 and trajectory.poses:
        return DbscanRegError(f'{recording.path}: holds one scan; expected at least two, between which there is a motion')
    usable = 'only one' if trajectory.poses else 'not one'
    return DbscanRegError('; '.join([f'{recording.path}: {usable} of {count} scans could be used', *trajectory.problems[:1],
                                     *recording.watch.lines()]))


def register_command(folder, recording) -> str:
    """What shows a pair of the recording with the parameters of the replay in `folder`, once the numbers are added."""
    parameters, path = (folder / 'parameters.yaml').absolute(), recording.path.absolute()
    return command_line('register', '--params-file', parameters, '--topic', recording.topic, path)
