# SPDX-License-Identifier: Apache-2.0
"""``demo [FILE]``: play scans to the real node, and write the trajectory and a map from its odometry."""
import os
import sys
from collections.abc import Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

from .command_line import ENDING, FAILED, CommandError, add_data, explain, interruptible, make_parser, run, shortened

OPENED = 'a browser is connected'
STARTING = 30
"""Longest time [s] to wait for the node to start."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('demo', 'Start the node scan_matcher in a process of its own, play a recording or a simulated '
                         'building with known truth to it over ROS, as fast as it answers, and print the error of its '
                         'odometry. Writes trajectory.tum and map.png.')
    parser.add_argument('file', metavar='FILE', nargs='?', help='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag '
                        '(default: the simulated building)')
    parser.add_argument('--topic', help='topic of the scans; required if there are several')
    add_data(parser)
    parser.add_argument('--params-file', metavar='YAML', help='parameters of the node: a '
                        'parameter file or set (default: the defaults)')
    parser.add_argument('--live', action='store_true', help='in real time, with a page that shows it in a browser: '
                        'the drive begins when the page is opened')
    parser.add_argument('--out', metavar='DIR', help='folder of the results (default: results/demo-NAME)')
    return run(parser, demo, argv)


def demo(args):
    """Play the recording to a newly started node, write the results and print the summary."""
    from ..replays.faults import Faults

    with interruptible(*ENDING):
        words = _node_words(args.params_file)
        recording = _recording(args)
        out = Path(args.out or Path('results', f'demo-{recording.name}'))
        out.mkdir(parents=True, exist_ok=True)
        answers = _play(recording, out, words, args)
        return _report(recording, answers, out, Faults(lambda error: explain(error)[1], args.verbose))


def _node_words(path) -> list:
    """Return the arguments of the node: the parameter file at `path`, if any, with the mounting none instead of tf.

    Raises
    ------
    CommandError
        When the file names several lidars.
    """
    from ..paths import parameter_file
    from ..robot.parameter_files import read_parameters

    if not path:
        return ['--ros-args', '-p', 'mounting:=none']
    parameters = read_parameters(path)
    if len(parameters.scan_topics) > 1:
        raise CommandError(f'{path} names {len(parameters.scan_topics)} scan_topics, but demo takes one '
                           'lidar: use replay --topic A --topic B')
    mounting = ['-p', 'mounting:=none'] if parameters.mounting == 'tf' else []
    return ['--ros-args', '--params-file', str(parameter_file(path)), *mounting]


def _recording(args):
    if args.file:
        from ..recordings import find_recording, open_recording
        return open_recording(find_recording(args.file, args.data), args.topic)
    print('simulating a building ...', file=sys.stderr)
    from ..simulation import demo as simulated_building
    from ..simulation.recording import SimulatedRecording
    return SimulatedRecording('building', simulated_building())


def _play(recording, out, words, args):
    """Start a node, and the live page if requested; play the recording and return the `Answers` of the node."""
    from tqdm import tqdm

    from ..node.playback.player import Player
    from .private_graph import private_graph
    from .processes import Process, package_command

    os.environ['ROS_LOG_DIR'] = str((out / 'ros_log').absolute())
    with (nullcontext(os.environ['ROS_DOMAIN_ID']) if 'ROS_DOMAIN_ID' in os.environ else private_graph() as domain,
          Process(package_command('scan_matcher', *words), out / 'scan_matcher.log') as node,
          Player() as player):
        print(f'node         process {node.pid}, ROS domain {domain}, log {node.log}', flush=True)
        _wait_for(node, player)
        with _page(out) if args.live else nullcontext():
            return player.play(tqdm(recording.scans(), recording.name, recording.count, unit=' scans', disable=None),
                               1.0 if args.live else None)


@contextmanager
def _page(out):
    """Serve the live page; enter the ``with`` block when a browser shows the page."""
    from .processes import Process, package_command

    with Process(package_command('watch'), out / 'watch.log') as page:
        for line in page.lines(OPENED):
            print(line, flush=True)
            if line.startswith('from another'):
                print('open the page: the drive begins then', flush=True)
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


def _report(recording, answers, out, faults):
    """Write trajectory and map of the answered scans, print paths and errors; return the exit status."""
    import numpy as np

    from ..figures.plots import plot_map
    from ..recordings import write_tum
    from ..recordings.poses import relative

    poses = answers.poses()
    answered = np.isfinite(poses).all(axis=1)
    stamps, poses = np.array(answers.stamps, dtype=np.int64)[answered], poses[answered]
    scans = (scan for scan, kept in zip(recording.scans(), answered, strict=True) if kept)
    write_tum(out / 'trajectory.tum', stamps, poses)
    print(f'trajectory   {out / "trajectory.tum"}')
    with faults.noted('map.png'):
        truth = recording.truth()
        plot_map(out / 'map.png', scans, poses, f'{recording.name}: {len(poses)} scans',
                 relative(truth[1][:1], truth[1]) if truth else None)
        print(f'map          {out / "map.png"}')
    for line in [*recording.notes, *shortened(recording.problems), *recording.watch.lines()]:
        print(line)
    if answers.unexpected:
        print(f'{answers.unexpected} odometry messages do not match the stamp of any scan')
    errors = faults.attempt('errors against the truth', _errors, recording, stamps, poses) or []
    for fault in faults.lines:
        print(f'demo: {fault}', file=sys.stderr)
    print(' '.join([f'scans {len(answered)} skipped {answers.lost}', *errors]))
    return FAILED if answers.lost or answers.unexpected else 0


def _errors(recording, stamps, poses) -> list:
    """Describe the errors against truth or relations in words, as far as they are known."""
    from ..evaluation.known_motion import errors_of

    errors = errors_of(recording, stamps, poses)
    if 'relations_neighbour_mean_m' in errors:
        return [f'neighbours {errors["relations_neighbour_mean_m"]:.3f} m '
                f'{errors["relations_neighbour_mean_deg"]:.2f} deg']
    if 'final_m' in errors:
        share = 100.0 * errors['final_m'] / errors['path_m']
        return [f'path {errors["path_m"]:.1f} m final error {errors["final_m"]:.3f} m ({share:.2f} %) '
                f'{errors["final_deg"]:.2f} deg']
    return []
