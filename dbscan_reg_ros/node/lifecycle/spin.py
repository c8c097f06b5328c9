# SPDX-License-Identifier: Apache-2.0
"""Run a node: parse its command line, spin it, and return its exit status."""
from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from ...allocation import keep_freed_memory
from ...command_lines import add_version, split_arguments, started_as
from ...core.errors import BuildError
from ...paths import config_folder
from ...requirements import MissingPackages, check_packages

if TYPE_CHECKING:
    from rclpy.node import Node

BAD_INPUT = 2
FAILED = 1


def run_node(name: str, description: str, make: Callable[[str], Node], argv: Sequence[str] | None = None) -> int:
    """Run the node and command `name` until SIGINT or SIGTERM; `make` creates it after ROS is initialised.

    Return the exit status: 0 after a signal, 2 when an argument or a parameter is wrong, 1 when a package is missing.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    _parse(name, description, argv)
    try:
        check_packages(name)
    except (MissingPackages, BuildError) as error:
        return _complain(name, error, FAILED)
    stop = _StopSignals()
    _configure_libraries()
    return _run(name, make, argv, stop)


def _parse(name: str, description: str, argv: list[str]) -> None:
    """Parse the command line; ``--help``, ``--version`` and wrong arguments end the process."""
    parser = argparse.ArgumentParser(
        prog=name, description=description,
        usage=f'{started_as(name)} [-h] [--version] [--ros-args --params-file FILE -p NAME:=VALUE -r FROM:=TO ...]')
    add_version(parser)
    parser.parse_args(split_arguments(argv)[0])


def _configure_libraries() -> None:
    """Set the number of threads of numpy and the handling of freed memory; to be called before numpy is imported."""
    for library in ('OPENBLAS', 'OMP'):
        # The matrices are small: more threads only cost time.
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')
    keep_freed_memory()


def _run(name: str, make: Callable[[str], Node], argv: list[str], stop: _StopSignals) -> int:
    """Initialise ROS, create the node and spin it until a signal; return the exit status."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from ...core.errors import ParameterError
    from ..rclpy_internals import execute_next

    try:
        rclpy.init(args=[name, *argv], signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        return _complain(name, _missing_file(argv) or f'ROS does not start: {error}')
    try:
        executor = SingleThreadedExecutor()
        # A task wakes the executor.
        stop.then(lambda: executor.create_task(lambda: None))
        node = make(name)
        executor.add_node(node)
        _exempt_from_collection()
        while not stop.requested:
            execute_next(executor)
        node.destroy_node()
    except ParameterError as error:
        return _complain(name, error)
    finally:
        rclpy.try_shutdown()
    return 0


def _missing_file(argv: list[str]) -> str:
    """Return a text that names the first ``--params-file`` of the ROS arguments that is no file, or nothing."""
    words = split_arguments(argv)[1]
    for option, file in pairwise(words):
        if option == '--params-file' and not os.path.isfile(file):
            return f'--params-file {file}: there is no such file; those of the sensors are in {config_folder()}'
    return ''


def _exempt_from_collection() -> None:
    """Exempt all present objects from garbage collection.

    They stay until the node ends. Without this, a collection in every few hundred scans checks all of them, for longer
    than a scan takes.
    """
    gc.collect()
    gc.freeze()


def _complain(name: str, problem: object, code: int = BAD_INPUT) -> int:
    """Print one line that describes a problem; return the exit status."""
    print(f'{name}: {problem}', file=sys.stderr)
    return code


class _StopSignals:
    """Converts SIGINT and SIGTERM, even if repeated, to a single request to stop the node.

    The signals are blocked in every thread and handled by a separate thread, so that the node ends between two
    callbacks, even during its start. The signal handlers of rclpy would shut the context down during a callback.
    """

    def __init__(self) -> None:
        self.requested = False
        self._listener: Callable[[], object] = lambda: None
        signals = {signal.SIGINT, signal.SIGTERM}
        signal.pthread_sigmask(signal.SIG_BLOCK, signals)
        threading.Thread(target=self._take, args=(signals,), daemon=True).start()

    def then(self, listener: Callable[[], object]) -> None:
        """Call `listener` from another thread when a stop is requested."""
        self._listener = listener

    def _take(self, signals: set[signal.Signals]) -> None:
        signal.sigwait(signals)
        self.requested = True
        self._listener()
