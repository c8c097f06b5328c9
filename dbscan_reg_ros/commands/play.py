# SPDX-License-Identifier: Apache-2.0
"""``play FILE``: publish a recording to a running node."""
import math
import signal
import sys
from collections.abc import Sequence

from ..command_lines import command_line, split_arguments
from ..endings import interruptible
from .command_line import (
    INTERRUPTED,
    SEVERAL,
    add_recording,
    is_topic,
    make_parser,
    number,
    run,
    shortened,
)

ABOVE_0 = number(float, math.nextafter(0.0, 1.0), math.nextafter(math.inf, 0.0), 'a number above 0')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    own, ros = split_arguments(sys.argv[1:] if argv is None else argv)
    parser = make_parser('play', 'Publish a recording to a running node, by default with its original timing: the '
                         'scans on the topic scan and, if recorded, /tf, /tf_static, wheel odometry on wheel_odom and '
                         'IMU data on imu. The messages keep their own stamps. Ctrl-C ends it. '
                         'ROS arguments may follow, such as --ros-args -r scan:=laser, or -r /tf:=/tf_recorded if the '
                         'recorded transforms must not reach the node.')
    add_recording(parser, SEVERAL | {'help': 'topic of the scans; required if the recording has several topics of '
                        'scans. If given more than once, each topic is published under its own name, and --lockstep '
                        'waits for the odometry of the first one'})
    more = parser.add_mutually_exclusive_group()
    more.add_argument('--topics', nargs='+', default=(), metavar='TOPIC', help='publish these recorded topics as well')
    parser.end_list('--topics', is_topic)
    more.add_argument('--all', action='store_true', help='publish every recorded topic')
    speed = parser.add_mutually_exclusive_group()
    speed.add_argument('--rate', type=ABOVE_0, default=1.0, metavar='R', help='play R times as fast as recorded '
                        '(default: 1)')
    speed.add_argument('--lockstep', action='store_true',
                       help='publish scans as fast as the node answers on odom, so that no scan of --topic is '
                            'skipped; while the first of several topics is silent, the others come in real time')
    parser.add_argument('--clock', action='store_true', help='publish /clock, for nodes with use_sim_time')
    parser.add_argument('--wait', type=ABOVE_0, default=10.0, metavar='S',
                        help='wait at most S seconds for a subscriber of the scans (default: 10)')

    def work(args):
        with interruptible(signal.SIGINT, once=True):
            play(args, ros)

    status = run(parser, work, own)
    # To be stopped is no failure of a process that launch started.
    return 0 if status == INTERRUPTED else status


def play(args, ros_arguments):
    """Play the recording and print how many scans the node answered, even if it is interrupted."""
    from tqdm import tqdm

    from ..node.playback.player import WINDOW, Player
    from ..recordings import find_recording, open_recording
    from ..recordings.playback import choose

    first, *others = args.topic or [None]
    recording = open_recording(find_recording(args.file, args.data), first)
    channels = choose(recording.channels(), (*args.topics, *others), args.all)
    with Player(ros_arguments, args.clock, recording.topic if others else 'scan') as player:
        problems = player.announce(channels)
        player.wait_for_node(args.wait, answering=args.lockstep)
        try:
            with tqdm(desc=recording.name, total=recording.count, unit=' scans', disable=None) as bar:
                player.play(counted(recording.play(channels), bar), None if args.lockstep else args.rate,
                            window=1 if others else WINDOW)
        finally:
            report(recording, player.answers, problems, len(others) > 0)


def counted(items, bar):
    """Yield the items; count the scans among the items in the progress bar."""
    for item in items:
        bar.update(item.channel is None)
        yield item


def report(recording, answers, problems, several):
    """Print the numbers of scans that were played, answered and skipped, and of damaged messages.

    With `several` lidars the scans counted as answered are those of the first one, on the topic of the `recording`.
    """
    problems = [*problems, *(f'{topic}: {count} damaged messages skipped' for topic, count in answers.damaged.items())]
    for line in [*recording.notes, *problems, *shortened(recording.problems), *recording.watch.lines()]:
        print(line, file=sys.stderr)
    if answers.stamps and not any(answers.messages):
        print(f"no scan was answered; does the node run ({command_line('scan_matcher')})? A recording without "
              "transforms needs a node with mounting 'none' (-p mounting:=none)", file=sys.stderr)
    if answers.passed:
        print('messages', *(f'{topic} {count}' for topic, count in answers.passed.items()))
    topic = f'{recording.topic}: ' if several else ''
    print(f'{topic}scans {len(answers.stamps)} answered {len(answers.stamps) - answers.lost} skipped {answers.lost}')
