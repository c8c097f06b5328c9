# SPDX-License-Identifier: Apache-2.0
"""Entry point of ``dbscan-reg-ros COMMAND`` and ``python -m dbscan_reg_ros COMMAND``."""
import io
import os
import signal
import sys
from collections.abc import Sequence


def entry_point() -> int:
    """Run the command named by the executable, or else by the first argument; return its exit status.

    SIGINT and SIGTERM are blocked at once: a signal that comes while modules are imported is delivered when the command
    or the node handles signals. Characters that the standard output does not know become question marks, and Jupyter's
    choice of a backend of matplotlib, which may not be installed here, does not count: pictures become files.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    from pathlib import Path

    from .command_lines import COMMANDS
    os.environ['MPLBACKEND'] = 'agg'
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='replace')
    name = Path(sys.argv[0]).name
    return main([name, *sys.argv[1:]] if name in COMMANDS else sys.argv[1:])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; return its exit status."""
    import argparse
    from importlib import import_module

    from .command_lines import COMMANDS, add_version, started_as

    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(
        prog=started_as(), formatter_class=argparse.RawDescriptionHelpFormatter,
        description='2D lidar scan registration and odometry.\n\ncommands:\n' + '\n'.join(
            f'  {name:24}{summary}' for name, (_, summary) in COMMANDS.items()),
        epilog='COMMAND --help explains its arguments')
    add_version(parser)
    parser.add_argument('command', metavar='COMMAND', choices=COMMANDS, help='one of the commands above')
    parser.add_argument('arguments', metavar='...', nargs=argparse.REMAINDER, help='arguments of the command')
    args = parser.parse_args(argv)
    return int(import_module(f'dbscan_reg_ros.{COMMANDS[args.command][0]}').main(args.arguments))


if __name__ == '__main__':
    sys.exit(entry_point())
