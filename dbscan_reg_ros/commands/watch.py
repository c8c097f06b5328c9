# SPDX-License-Identifier: Apache-2.0
"""``watch``: serve a page that shows a running node live in a browser."""
import getpass
import signal
import socket
import sys
from collections.abc import Sequence

from ..command_lines import split_arguments
from ..endings import interruptible
from .command_line import INTERRUPTED, make_parser, number, run

PORT = 8710
OPENED = 'a browser is connected'
FOUND = 'node         '
"""Begin of the line that names the node, once the page shows it."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    own, ros = split_arguments(sys.argv[1:] if argv is None else argv)
    parser = make_parser('watch', 'Serve a page that shows a running node: the scans on the growing map, the pose and '
                         'its covariance, speed and status. It subscribes to scan, to other scans that the node '
                         'subscribes to, to odom and /diagnostics while a browser shows the page, and sends nothing '
                         'to the node. Ctrl-C ends it. ROS arguments may follow, such as --ros-args -r scan:=laser.')
    parser.add_argument('--host', default='127.0.0.1', metavar='ADDRESS',
                        help='address of this computer that browsers connect to (default: %(default)s, this computer '
                        'alone). With another address, everybody in the network who knows the printed address can see '
                        'the page')
    parser.add_argument('--port', type=number(int, 1, 65535, 'a port from 1 to 65535'), default=PORT, metavar='N',
                        help='first port to try; if it is busy, the next free port is used (default: %(default)s)')

    def work(args):
        with interruptible(signal.SIGINT, signal.SIGTERM, once=True):
            watch(args, ros)

    status = run(parser, work, own, outlasts=False)
    # Ctrl-C is how it ends.
    return 0 if status == INTERRUPTED else status


def watch(args, ros_arguments):
    """Serve the page until a signal ends the command."""
    from ..node.watching.listener import Listener
    from ..replays.live.live_drive import LiveDrive
    from ..replays.live.server import PageServer, is_local

    drive = LiveDrive()

    def begin(name):
        drive.restart(name)
        print(f'{FOUND}{name}', flush=True)

    with (Listener(drive.add, drive.report, begin, ros_arguments) as listener,
          PageServer(drive, args.host, args.port, listener.topics[0]) as server):
        print(f'topics       {" ".join(listener.topics)}')
        print(f'page         {server.address}')
        if is_local(args.host):
            print(f'from another computer: ssh -L {server.port}:{args.host}:{server.port} '
                  f'{getpass.getuser()}@{socket.gethostname()}, then open the same address there', flush=True)
        else:
            print('watch: everybody in the network who knows this address sees the scans; nothing is encrypted',
                  file=sys.stderr, flush=True)
        _follow(listener, drive)


def _follow(listener, drive):
    """Subscribe to the topics of the node only while a browser is connected."""
    watched = False
    while True:
        if watched != (drive.browsers > 0):
            watched = not watched
            (listener.subscribe if watched else listener.unsubscribe)()
            print(OPENED if watched else 'no browser is connected', flush=True)
        listener.spin(0.1)
