"""``python -m dbscan_reg_ros COMMAND ...``: the same commands as ``ros2 run dbscan_reg_ros COMMAND ...``."""
import argparse
import sys
from importlib import import_module

from .commands import COMMANDS


def main(argv=None) -> int:
    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(
        prog='python -m dbscan_reg_ros', formatter_class=argparse.RawDescriptionHelpFormatter,
        description='2D lidar scan registration and odometry.\n\ncommands:\n' + '\n'.join(
            f'  {name:24}{summary}' for name, (_, summary) in COMMANDS.items()),
        epilog='COMMAND --help says more of each')
    parser.add_argument('command', metavar='COMMAND', choices=COMMANDS, help='one of the above')
    parser.add_argument('arguments', metavar='...', nargs=argparse.REMAINDER, help='its arguments')
    args = parser.parse_args(argv)
    return import_module(f'dbscan_reg_ros.{COMMANDS[args.command][0]}').main(args.arguments)


if __name__ == '__main__':
    sys.exit(main())
