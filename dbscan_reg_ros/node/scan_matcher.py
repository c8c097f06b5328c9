"""``scan_matcher``: laser odometry as a ROS 2 node."""
import argparse
import signal
import sys

from .ros_arguments import split_arguments

BAD_INPUT = 2


def main(argv=None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns
    -------
    int
        0 after a signal, 2 when an argument or a parameter is wrong.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    parser = argparse.ArgumentParser(
        prog='scan_matcher', description='Laser odometry: subscribes to scan, publishes odom, segments and /tf.',
        usage='scan_matcher [-h] [--ros-args --params-file FILE -p NAME:=VALUE -r FROM:=TO ...]')
    parser.parse_args(split_arguments(argv)[0])
    stop = _StopSignals()

    import rclpy
    from rclpy.node import Node

    from ..core.errors import ParameterError
    from .matcher import ScanMatcher

    try:
        try:
            rclpy.init(args=['scan_matcher', *argv])
        except RuntimeError as error:
            return _complain(f'ROS arguments: {error}')
        stop.leave_to_ros()
        node = Node('scan_matcher', automatically_declare_parameters_from_overrides=True)
        ScanMatcher(node).start()
        rclpy.spin(node)
    except ParameterError as error:
        return _complain(error)
    except Exception:
        if not stop.requested:
            raise
    finally:
        rclpy.try_shutdown()
        stop.ignore()
    return 0


def _complain(problem):
    print(f'scan_matcher: {problem}', file=sys.stderr)
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


if __name__ == '__main__':
    sys.exit(main())
