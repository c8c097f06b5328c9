"""From a command line to a running node, and back to its exit status."""
import argparse
import os
import signal
import sys

from .ros_arguments import split_arguments

BAD_INPUT = 2


def run_node(name, description, make, argv=None) -> int:
    """Run a node until SIGINT or SIGTERM.

    Parameters
    ----------
    name : str
        Of the command and the node.
    description : str
        For ``--help``.
    make : callable
        Takes the name, returns the node; called when ROS is up.
    argv : list of str, optional

    Returns
    -------
    int
        0 after a signal, 2 when an argument or a parameter is wrong.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    parser = argparse.ArgumentParser(
        prog=name, description=description,
        usage=f'{name} [-h] [--ros-args --params-file FILE -p NAME:=VALUE -r FROM:=TO ...]')
    parser.parse_args(split_arguments(argv)[0])
    stop = _StopSignals()
    for library in ('OPENBLAS', 'OMP'):
        # The matrices are small: more threads only burn time.
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')

    import rclpy

    from ..core.errors import ParameterError

    try:
        try:
            rclpy.init(args=[name, *argv])
        except RuntimeError as error:
            return _complain(name, f'ROS does not start: {error}')
        stop.leave_to_ros()
        rclpy.spin(make(name))
    except ParameterError as error:
        return _complain(name, error)
    except Exception:
        if not stop.requested:
            raise
    finally:
        rclpy.try_shutdown()
        stop.ignore()
    return 0


def _complain(name, problem):
    print(f'{name}: {problem}', file=sys.stderr)
    return BAD_INPUT


class _StopSignals:
    """Ends the process quietly on SIGINT and SIGTERM, at any moment.

    Until ROS is up, by an exit on the spot. From then on ROS shuts its context down, which ends the spinning; what is
    just being published may fail then.
    """

    def __init__(self):
        self.requested = False
        self._ros_is_up = False
        self._handle(self._stop)

    def leave_to_ros(self):
        self._ros_is_up = True

    def ignore(self):
        """For the process is ending: Python would give the signals back to the system, which kills."""
        self._handle(signal.SIG_IGN)

    def _handle(self, handler):
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, handler)

    def _stop(self, _number, _frame):
        self.requested = True
        if not self._ros_is_up:
            sys.exit(0)
