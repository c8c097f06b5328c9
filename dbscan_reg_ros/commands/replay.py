"""``replay FILE...``: the odometry of recordings, offline, through the same `Odometry` as the node."""
from dataclasses import dataclass
from pathlib import Path

from .command_line import add_recordings, add_workers, complain, make_parser, note_unused, run, shortened


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
    from ..node.parameters import REPLAYED, NodeParameters
    from ..parameter_files import read_parameters
    from ..recordings import find_recording
    from .workers import processors, workers

    parameters = read_parameters(args.params_file) if args.params_file else NodeParameters()
    note_unused('replay', args.params_file, parameters, REPLAYED)
    place = Path.absolute if args.scheduler else Path
    jobs = [Job(place(find_recording(file, args.data)), args.topic, parameters, place(Path(args.out)), args.close_loops)
            for file in args.files]
    code = 0
    with workers(min(args.processes or processors(), len(jobs)), args.scheduler) as executor:
        for future in [executor.submit(replay_one, job) for job in jobs]:
            try:
                lines = future.result()
            except Exception as error:  # noqa: BLE001 - the other recordings go on
                failed = complain('replay', error, args.verbose)
                code = code or failed
            else:
                print('\n'.join(lines), flush=True)
    return code


@dataclass(frozen=True)
class Job:
    """What is to be replayed, `path` and `topic` of the recording; the results go below `out`; whether loops are closed."""

    path: Path
    topic: str | None
    parameters: object
    out: Path
    close_loops: bool = False


def replay_one(job) -> list:
    """Replay one recording into a folder of its own; lines that say how it went."""
    from ..core.errors import DbscanRegError
    from ..core.odometry import Odometry
    from ..parameter_files import write_parameters
    from ..recordings import open_recording, write_tum
    from ..replays.bag import odometry_bag
    from ..replays.folder import new_folder, point_latest
    from ..replays.loops import Loops
    from ..replays.mounted import mounting_of, turned
    from ..replays.spots import Spots
    from ..replays.track import Track
    from .workers import watched

    mounting = mounting_of(job.parameters)
    recording = open_recording(job.path, job.topic)
    folder = new_folder(job.out / recording.name)
    write_parameters(folder / 'parameters.yaml', job.parameters, f'The parameters of the replay of {job.path.name}.')
    track, spots, loops = Track(yaw=mounting.pose.theta), Spots(), Loops() if job.close_loops else None
    try:
        with odometry_bag(folder / 'bag', job.parameters, mounting) as add_to_bag:
            scans = turned(watched(recording.scans(), recording.name, recording.count), track.yaw)
            for update in track.follow(scans, Odometry(job.parameters.for_odometry())):
                add_to_bag(update)
                spots.add(update)
                if loops:
                    loops.add(update)
    finally:
        write_tum(folder / 'trajectory.tum', track.stamps, track.poses)
    if not track.poses:
        raise DbscanRegError(f'{recording.path}: not one of {len(track.used)} scans could be used; '
                             + '; '.join([track.problems[0], *recording.watch.lines()]))
    lines = [f'results     {folder}', *write_results(folder, recording, track, spots, job.parameters, loops)]
    point_latest(folder)
    return lines


def write_results(folder, recording, track, spots, parameters, loops=None) -> list:
    """Write what shows how good a finished track is; the same in a few lines."""
    import numpy as np

    from ..plots import density_map, draw_map
    from ..recordings import KnownMotion, interpolate, write_tum
    from ..recordings.metrics import align
    from ..replays.report import write_report
    from ..replays.summary import summarise, write_metrics

    known, poses = KnownMotion.of(recording), track.pose_array()
    measures = track.measures() | known.measures(track.stamps, poses)
    way, there = None, np.zeros(len(poses), dtype=bool)
    if known.truth:
        way = interpolate(*known.truth, track.stamps)
        there = np.isfinite(way).all(axis=1)
        write_tum(folder / 'truth.tum', np.array(track.stamps, dtype=np.int64)[there], way[there])

    def draw(file, poses, title):
        density = density_map(track.usable(recording.scans()), poses)
        draw_map(folder / file, density, poses, title, align(way[there], poses[there]) if there.sum() > 1 else None)
        return density

    if loops:
        closed, pairs = loops.close(poses, parameters.for_odometry(), track.yaw)
        measures |= {'loops': len(pairs)} | {f'closed_{name}': value for name, value in known.measures(track.stamps, closed).items()}
        write_tum(folder / 'closed.tum', track.stamps, closed)
        draw('map_closed.png', closed, f'{recording.name}: {len(poses)} scans, {len(pairs)} places seen again')
    write_metrics(folder / 'metrics.json', recording, measures)
    title = f'{recording.name}: {len(poses)} scans'
    density = draw('map.png', poses, title)
    summary = [*(('note', note) for note in recording.notes), *(('warning', line) for line in recording.watch.lines()),
               *summarise(measures)]
    write_report(folder / 'report.html', title, [('recording', str(recording.path)), *summary], known, track, density,
                 spots.found(), parameters, register_command(folder, recording))
    return [*shortened(recording.problems), *shortened(track.problems), *(f'{name:11} {value}' for name, value in summary)]


def register_command(folder, recording) -> str:
    """What shows a pair of the recording with the parameters of the replay in `folder`, once the numbers are added."""
    import shlex
    parameters, path = (folder / 'parameters.yaml').absolute(), recording.path.absolute()
    return shlex.join(['python', '-m', 'dbscan_reg_ros', 'register', '--params-file', str(parameters),
                       '--topic', recording.topic, str(path)])
