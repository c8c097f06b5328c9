# SPDX-License-Identifier: Apache-2.0
"""``dump``: the parameters of a running node as a file."""
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from ..node.lifecycle.ros_arguments import split_arguments
from ..signals import interruptible
from .command_line import make_parser, run


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    own, ros = split_arguments(sys.argv[1:] if argv is None else argv)
    parser = make_parser('dump', 'Print the parameters of a running scan_matcher with their help, as a file for '
                         '--ros-args --params-file FILE.')
    parser.add_argument('--node', default='/scan_matcher', metavar='NAME',
                        help='full name of the node (default: /scan_matcher)')
    parser.add_argument('--out', type=Path, metavar='FILE', help='file to write (default: the terminal)')
    parser.add_argument('--wait', type=float, default=10.0, metavar='S', help='wait at most S seconds for the node '
                        '(default: 10)')
    return run(parser, lambda args: dump(args, ros), own)


def dump(args, ros_arguments):
    """Read the parameters of the node and write them."""
    from ..node.interfaces.remote_parameters import read_remote
    from ..robot.parameter_files import format_parameters

    with interruptible(signal.SIGINT):
        values = read_remote(args.node, args.wait, ros_arguments)
    text = format_parameters(values, f'The parameters of {args.node}.')
    if args.out:
        args.out.write_text(text, encoding='utf-8')
    else:
        sys.stdout.write(text)
