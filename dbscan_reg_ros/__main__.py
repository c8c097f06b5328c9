# SPDX-License-Identifier: Apache-2.0
"""``dbscan-reg-ros COMMAND ...``, ``python -m dbscan_reg_ros COMMAND ...``: as ``ros2 run dbscan_reg_ros COMMAND ...``."""
import argparse
import sys
from importlib import import_module
from pathlib import Path

from .command_lines import COMMANDS, PROGRAM
from .version import add_version


def main(argv=None) -> int:
    argv = sys.argv[1:] if argv is None else argv
    prog = PROGRAM if Path(sys.argv[0]).name == PROGRAM else 'python -m dbscan_reg_ros'
    parser = argparse.ArgumentParser(
        prog=prog, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='2D lidar scan registration and odometry.\n\ncommands:\n' + '\n'.join(
            f'  {name:24}{summary}' for name, (_, summary) in COMMANDS.items()),
        epilog='COMMAND --help says more of each')
    add_version(parser)
    parser.add_argument('command', metavar='COMMAND', choices=COMMANDS, help='one of the above')
    parser.add_argument('arguments', metavar='...', nargs=argparse.REMAINDER, help='its arguments')
    args = parser.parse_args(argv)
    return import_module(f'dbscan_reg_ros.{COMMANDS[args.command][0]}').main(args.arguments)


if __name__ == '__main__':
    sys.exit(main())
