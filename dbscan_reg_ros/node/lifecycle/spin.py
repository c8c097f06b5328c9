# SPDX-License-Identifier: Apache-2.0
"""From a command line to a running node, and back to its exit status."""
import argparse
import contextlib
import os
import signal
import sys
import threading
import time

from ...allocation import keep_freed_memory
from ...requirements import MissingPackages, check_packages
from ...version import add_version
from .ros_arguments import split_arguments

BAD_INPUT = 2
FAILED = 1
IDLE = 1e-3
"""Who waits so long [s] for work has nothing else to do."""


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
        0 after a signal, 2 when an argument or a parameter is wrong, 1 when a package is missing.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    parser = argparse.ArgumentParser(
        prog=name, description=description,
        usage=f'{name} [-h] [--version] [--ros-args --params-file FILE -p NAME:=VALUE -r FROM:=TO ...]')
    add_version(parser)
    parser.parse_args(split_arguments(argv)[0])
    try:
        check_packages(name)
    except MissingPackages as error:
        return _complain(name, error, FAILED)
    stop = _StopSignals()
    for library in ('OPENBLAS', 'OMP'):
        # The matrices are small: more threads only burn time.
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')
    keep_freed_memory()

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from ...core.errors import ParameterError

    try:
        rclpy.init(args=[name, *argv], signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        return _complain(name, f'ROS does not start: {error}')
    try:
        executor = SingleThreadedExecutor()
        stop.then(lambda: executor.create_task(lambda: None))
        node = make(name)
        executor.add_node(node)
        while not stop.requested:
            _spin_once(executor)
        node.destroy_node()
    except ParameterError as error:
        return _complain(name, error)
    finally:
        rclpy.try_shutdown()
    return 0


def _spin_once(executor):
    """Handle what comes next.

    After each callback, rclpy's executor wakes itself once more, in case another thread waits, and asks all that is on the
    node whether it is ready. Where that was idle before, the wake-up is taken with no node to ask, at a tenth of the cost;
    under load all who are ready have their turn.
    """
    from rclpy.executors import TimeoutException

    began = time.monotonic()
    task, _, _ = executor.wait_for_ready_callbacks()
    idle = time.monotonic() - began > IDLE
    task()
    task.result()
    if idle:
        with contextlib.suppress(TimeoutException):
            executor.wait_for_ready_callbacks(0.0, [])


def _complain(name, problem, code=BAD_INPUT):
    print(f'{name}: {problem}', file=sys.stderr)
    return code


class _StopSignals:
    """Turns SIGINT and SIGTERM, however often and whenever they come, into one request to stop.

    They are blocked in every thread and taken by a thread of their own: nothing is interrupted, so that the node ends
    between two callbacks, even if it was still starting. ROS' own handlers would shut its context down under it.
    """

    def __init__(self):
        self.requested = False
        self._listener = lambda: None
        signals = {signal.SIGINT, signal.SIGTERM}
        signal.pthread_sigmask(signal.SIG_BLOCK, signals)
        threading.Thread(target=self._take, args=(signals,), daemon=True).start()

    def then(self, listener):
        """Call `listener`, from another thread, once a stop is requested."""
        self._listener = listener

    def _take(self, signals):
        signal.sigwait(signals)
        self.requested = True
        self._listener()
