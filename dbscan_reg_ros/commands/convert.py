# SPDX-License-Identifier: Apache-2.0
"""``convert SOURCE TARGET``: CARMEN logs, ROS 1 bags and ROS 2 bags into one another."""
from .command_line import add_data, is_topic, make_parser, run, shortened


def main(argv=None) -> int:
    parser = make_parser('convert', 'Write a recording in another format. Messages keep their order and their stamps to '
                         'the nanosecond; the record times of a bag increase, so that ros2 bag play works. A CARMEN log '
                         'has room for scans and poses only.')
    parser.add_argument('source', metavar='SOURCE', help='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag; '
                        'looked for below the data folder as well')
    parser.add_argument('target', metavar='TARGET', help='NAME.log or NAME.log.gz: CARMEN log; NAME.bag: ROS 1 bag; '
                        'any other name: folder of a ROS 2 bag')
    parser.add_argument('--topic', help='topic of the scans, where a log is read or written and there are several')
    parser.add_argument('--topics', nargs='+', default=(), metavar='TOPIC', help='topics of the bag to keep '
                        '(default: all)')
    parser.add_argument('--start', type=float, default=0.0, metavar='S', help='keep what comes from S seconds after the '
                        'first message on')
    parser.add_argument('--end', type=float, default=float('inf'), metavar='S', help='keep what comes up to S seconds '
                        'after the first message')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap', help='of a ROS 2 bag (default: mcap)')
    parser.end_list('--topics', is_topic)
    add_data(parser)
    return run(parser, convert, argv)


def convert(args):
    """Convert, and print what was written, assumed and skipped."""
    from tqdm import tqdm

    from ..recordings import find_recording
    from ..recordings.conversion import convert

    source = find_recording(args.source, args.data)
    counts, remarks = convert(source, args.target, args.topic, args.topics, args.start, args.end, args.storage,
                              lambda items, total: tqdm(items, source.name, total, disable=None))
    for remark in shortened(remarks):
        print(remark)
    print(f'{args.target}  ' + (', '.join(f'{count} {name}' for name, count in counts.items()) or 'no message'))
