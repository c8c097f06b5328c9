# SPDX-License-Identifier: Apache-2.0
"""``convert SOURCE TARGET``: convert between CARMEN logs, ROS 1 bags and ROS 2 bags."""
from collections.abc import Sequence

from .command_line import CommandError, add_data, is_topic, make_parser, run, shortened


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('convert', 'Write a recording in another format. Messages keep their order and their stamps '
                         'to the nanosecond; the record times of a bag increase, so that ros2 bag play works. A CARMEN '
                         'log holds only scans and poses. Files with true poses or relations beside SOURCE are not '
                         'copied.')
    parser.add_argument('source', metavar='SOURCE', help='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag; '
                        'also searched for below the data folder')
    parser.add_argument('target', metavar='TARGET', help='NAME.log or NAME.log.gz: CARMEN log; NAME.bag: ROS 1 bag; '
                        'any other name: folder of a ROS 2 bag')
    parser.add_argument('--topic',
                        help='topic of the scans; required if the recording has several topics of scans and a log is '
                             'read or written')
    parser.add_argument('--topics', nargs='+', default=(), metavar='TOPIC', help='topics of the bag to keep '
                        '(default: all)')
    parser.add_argument('--start', type=float, default=0.0, metavar='S', help='keep messages from S seconds after the '
                        'first one, and all static transforms')
    parser.add_argument('--end', type=float, default=float('inf'), metavar='S', help='keep messages up to S seconds '
                        'after the first one')
    parser.add_argument('--without', nargs=3, action='append', default=[], metavar=('TOPIC', 'FROM', 'TO'),
                        help='leave out the messages of a topic of a bag between these times [s] after the first '
                        'message, as if a lidar failed and came back; TO may be inf; may be repeated')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap',
                        help='storage of a ROS 2 bag (default: mcap)')
    parser.end_list('--topics', is_topic)
    add_data(parser)
    return run(parser, convert, argv)


def convert(args):
    """Convert the recording; print the counts of messages, assumptions and skipped parts."""
    from tqdm import tqdm

    from ..recordings import find_recording
    from ..recordings.conversion import Kept, convert

    kept = Kept(args.topic, args.topics, args.start, args.end, [_gap(*words) for words in args.without])
    source = find_recording(args.source, args.data)
    counts, remarks = convert(
        source, args.target, kept, storage=args.storage,
        progress=lambda items, total: tqdm(items, source.name, total, disable=None))
    for remark in shortened(remarks):
        print(remark)
    print(f'{args.target}  ' + (', '.join(f'{count} {name}' for name, count in counts.items()) or 'no message'))


def _gap(topic, start, end):
    """Return the `Gap` that three words of the command line define."""
    from ..recordings.conversion import Gap

    try:
        gap = Gap(topic, float(start), float(end))
        if not 0.0 <= gap.start < gap.end:
            raise ValueError
    except ValueError:
        raise CommandError(f'--without {topic} {start} {end}: expected TOPIC FROM TO, in s, with FROM before '
                           'TO') from None
    return gap
