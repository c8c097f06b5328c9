# SPDX-License-Identifier: Apache-2.0
"""``demo [FILE]``: play scans to the real node, and write the trajectory and a map from its odometry."""
import os
import sys
from collections.abc import Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

from ..endings import ENDING, interruptible
from .command_line import (
    FAILED,
    SEVERAL,
    CommandError,
    add_data,
    add_parameters,
    explain,
    make_parser,
    run,
    shortened,
)

WITHOUT_DATA = 'none', 'constant_velocity'
"""Values of ``prior.source`` that need no messages."""
STARTING = 30
"""Longest time [s] to wait for the node to start."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('demo', 'Start the node scan_matcher in a process of its own, play a recording to it over '
                                 'ROS, or a simulated drive with known truth, as fast as the node answers. Prints the '
                                 'error of the odometry. Writes trajectory.tum and map.png.')
    parser.add_argument('file', metavar='FILE', nargs='?', help='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag '
                        '(default: the simulated building)')
    parser.add_argument('--topic', **SEVERAL)
    add_data(parser)
    add_parameters(parser)
    parser.add_argument('--live', action='store_true', help='play in real time and show the drive on a page in a '
                        'browser; the drive begins when the page is opened')
    parser.add_argument('--out', metavar='DIR', help='folder of the results (default: results/demo-NAME)')
    return run(parser, demo, argv)


def demo(args):
    """Play the recording to a newly started node, write the results and print the summary."""
    from ..replays.lidars import given_mountings, mounting_in, scan_topics
    from ..replays.result_folder import Faults
    from ..robot.parameter_files import read_parameters

    with interruptible(*ENDING):
        parameters = read_parameters(args.params_file)
        topics = scan_topics(args.topic, parameters)
        recording = _recording(args, topics)
        mountings = given_mountings(parameters, topics)
        mounting = mounting_in(recording, mountings, parameters.base_frame, option='') if topics[1:] else None
        out = Path(args.out or Path('results', f'demo-{recording.name}'))
        out.mkdir(parents=True, exist_ok=True)
        answers = _play(recording, out, _node_words(args.params_file, parameters, topics), args, topics)
        faults = Faults(lambda error: explain(error)[1], args.verbose)
        return _report(recording, answers, mounting, out, faults)


def _node_words(paths, parameters, topics) -> list:
    """Return the arguments of the node: its parameter files, and arguments for the topics of the lidars."""
    from ..paths import parameter_file

    words = [word for path in paths for word in ('--params-file', str(parameter_file(path)))]
    if parameters.prior.source not in WITHOUT_DATA:
        print(f'demo: prior.source {parameters.prior.source!r} has no effect in demo, which plays scans and static '
              'transforms only; play FILE with a node of its own plays the others, too', file=sys.stderr)
        words += ['-p', 'prior.source:=constant_velocity']
    if topics[1:]:
        words += ['-p', f'scan_topics:=[{", ".join(topics)}]']
    elif parameters.mounting == 'tf':
        words += ['-p', 'mounting:=none']
    return ['--ros-args', *words]


def _recording(args, topics):
    """Open the recording; raise CommandError if the scans of several lidars, on `topics`, cannot be played from it."""
    if args.file:
        from ..recordings import find_recording, open_recording
        from ..recordings.opening import is_bag

        path = find_recording(args.file, args.data)
        if topics[1:] and not is_bag(path):
            raise CommandError(f'{path}: expected a bag for several lidars, with their transforms; for '
                               'a log, use replay --topic A --topic B --mounting A X Y DEG --mounting B X Y DEG')
        return open_recording(path, topics[0] if topics else None)
    if topics[1:]:
        raise CommandError(f'the simulated building has one lidar, not {len(topics)}; give a bag with the topics '
                           f'{", ".join(topics)}')
    print('simulating a building ...', file=sys.stderr)
    from ..simulation import demo as simulated_building
    from ..simulation.recording import SimulatedRecording
    return SimulatedRecording('building', simulated_building())


def _play(recording, out, words, args, topics):
    """Start a node, and the live page if requested; play the recording and return the `Answers` of the node."""
    from tqdm import tqdm

    from ..node.playback.player import WINDOW, Player
    from ..private_graph import private_graph
    from .play import counted
    from .processes import Process, package_command

    os.environ['ROS_LOG_DIR'] = str((out / 'ros_log').absolute())
    with (nullcontext(os.environ['ROS_DOMAIN_ID']) if 'ROS_DOMAIN_ID' in os.environ else private_graph() as domain,
          Process(package_command('scan_matcher', *words), out / 'scan_matcher.log') as node,
          Player(topic=recording.topic if topics[1:] else 'scan') as player):
        print(f'node         process {node.pid}, ROS domain {domain}, log {node.log}', flush=True)
        _wait_for(node, player)
        channels = _channels(recording, topics[1:])
        player.announce(channels)
        with (_page(out, node) if args.live else nullcontext(),
              tqdm(desc=recording.name, total=recording.count, unit=' scans', disable=None) as bar):
            return player.play(counted(recording.play(channels), bar), 1.0 if args.live else None,
                               window=1 if channels else WINDOW)


def _channels(recording, others) -> list:
    """Return the channels to play besides the scans: with several lidars the `others`, and the transforms.

    Raises a RecordingError when the recording has no scans of one of the `others`.
    """
    from ..recordings.playback import choose

    return [channel for channel in choose(recording.channels(), others)
            if channel.recorded in others or channel.input in ('/tf_static', '/tf')] if others else []


@contextmanager
def _page(out, node):
    """Serve the live page; enter the ``with`` block when a browser shows the page, and the page has found the `node`.

    Raises a ProcessEnded when the process of the `node` has ended before.
    """
    from .processes import Process, package_command
    from .watch import FOUND

    with Process(package_command('watch'), out / 'watch.log') as page:
        for line in page.lines(others=[node]):
            print(line, flush=True)
            if line.startswith('from another'):
                print('open the page: the drive begins then', flush=True)
            if line.startswith(FOUND):
                break
        yield


def _wait_for(node, player):
    """Wait until the node subscribes to the scans; raise an error as soon as its process has ended."""
    from ..node.playback.player import PlayerError

    for seconds_left in reversed(range(STARTING)):
        try:
            return player.wait_for_node(1.0)
        except PlayerError as error:
            if not node.running():
                said = node.output().strip().splitlines() or ['nothing']
                raise PlayerError(f'the node ended at once; its last output: {said[-1]}') from error
            if not seconds_left:
                raise


def _report(recording, answers, mounting, out, faults):
    """Write trajectory and map of the answered scans, print paths and errors; return the exit status.

    With several lidars, the odometry messages contain poses of the base, on which the first lidar has this `mounting`;
    some messages have the stamps of scans of other lidars.
    """
    import numpy as np

    from ..core.geometry.se2 import SE2
    from ..evaluation.known_motion import NOTHING_KNOWN, KnownMotion
    from ..evaluation.metrics import begun_like
    from ..figures.plots import plot_map
    from ..recordings import write_tum
    from ..replays.lidars import turned

    poses = answers.poses()
    answered = np.isfinite(poses).all(axis=1)
    stamps, poses = np.array(answers.stamps, dtype=np.int64)[answered], poses[answered]
    scans = (scan for scan, kept in zip(recording.scans(), answered, strict=True) if kept)
    unexpected = answers.unexpected
    if mounting:
        unexpected, scans = 0, turned(scans, 0.0, mounting.upside_down)
        poses = np.array([(SE2.from_array(pose) @ mounting.pose).as_array() for pose in poses]).reshape(-1, 3)
    write_tum(out / 'trajectory.tum', stamps, poses)
    print(f'trajectory   {out / "trajectory.tum"}')
    known = faults.attempt('errors against the truth', KnownMotion.of, recording) or NOTHING_KNOWN
    with faults.noted('map.png'):
        truth = known.true_poses(stamps).poses
        plot_map(out / 'map.png', scans, poses, f'{recording.name}: {len(poses)} scans', begun_like(truth, poses))
        print(f'map          {out / "map.png"}')
    for line in [*recording.notes, *shortened(recording.problems), *recording.watch.lines()]:
        print(line)
    if unexpected:
        print(f'{unexpected} odometry messages do not match the stamp of any scan')
    errors = faults.attempt('errors against the truth', _errors, known, stamps, poses) or []
    for fault in faults.lines:
        print(f'demo: {fault}', file=sys.stderr)
    print(' '.join([f'scans {len(answered)} skipped {answers.lost}', *errors]))
    return FAILED if answers.lost or unexpected else 0


def _errors(known, stamps, poses) -> list:
    """Return a line with the errors against the relations or the true poses; an empty list if both are unknown."""
    errors = known.measures(stamps, poses)
    if 'relations_neighbour_mean_m' in errors:
        return [f'neighbours {errors["relations_neighbour_mean_m"]:.3f} m '
                f'{errors["relations_neighbour_mean_deg"]:.2f} deg']
    if 'final_m' in errors:
        share = 100.0 * errors['final_m'] / errors['path_m']
        return [f'path {errors["path_m"]:.1f} m final error {errors["final_m"]:.3f} m ({share:.2f} %) '
                f'{errors["final_deg"]:.2f} deg']
    return []
