# SPDX-License-Identifier: Apache-2.0
"""Child processes that are always ended together with their own children."""
import os
import signal
import subprocess
import sys
import time
import weakref
from contextlib import suppress

from ..core.errors import DbscanRegError
from ..endings import ENDING, held
from ..private_graph import domain_locks

POLL = 0.05
"""Interval [s] at which the output of a process is read."""


class ProcessEnded(DbscanRegError):
    """A process that should keep running has ended."""


class Process:
    """Child process in its own session, so that a Ctrl-C in the terminal sends no signal to it.

    Its standard output and error are written to the file `log`; `environment` is added to that of this process.
    """

    def __init__(self, command, log, environment=None):
        self.command = [os.fspath(word) for word in command]
        self.log = log
        with open(log, 'wb') as output, held(*ENDING):
            self._popen = self._started(output, os.environ | (environment or {}))
            self._end = weakref.finalize(self, _kill_group, self._popen)
        self.pid = self._popen.pid

    def _started(self, output, environment):
        return subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=environment,
                                start_new_session=True, pass_fds=domain_locks())

    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._popen.poll() is None

    def output(self) -> str:
        """Return what the process has printed so far."""
        with open(self.log, encoding='utf-8', errors='replace') as log:
            return log.read()

    def lines(self, last=None, others=()):
        """Yield each line that the process prints, up to the line `last`.

        Raises a ProcessEnded when the process, or one of the `others`, has ended before.
        """
        with open(self.log, encoding='utf-8', errors='replace') as log:
            line = part = ''
            while line != last:
                ended = next((process for process in (self, *others) if not process.running()), None)
                part += log.readline()
                if part.endswith('\n'):
                    line, part = part[:-1], ''
                    yield line
                elif ended:
                    raise ProcessEnded(f'{" ".join(ended.command)} has ended with exit status {ended.wait(0)}; its '
                                       f'output is in {ended.log}')
                else:
                    time.sleep(POLL)

    def signal(self, number):
        """Send a signal to the process if it is still running."""
        self._popen.send_signal(number)

    def wait(self, timeout) -> int:
        """Wait for the exit status of the process; raise `subprocess.TimeoutExpired` after `timeout` seconds."""
        return self._popen.wait(timeout)

    def stop(self, patience=5.0) -> int:
        """End the process and all its children: with a signal first, and by killing them after `patience` seconds.

        Return the exit status of the process; negative if a signal ended it.
        """
        try:
            for number in (signal.SIGINT, signal.SIGTERM):
                self.signal(number)
                try:
                    self.wait(patience)
                    break
                except subprocess.TimeoutExpired:
                    continue
        finally:
            self._end()
        return self._popen.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()


def _kill_group(popen):
    """Kill the process and all processes in its session."""
    with suppress(ProcessLookupError):
        os.killpg(popen.pid, signal.SIGKILL)
    popen.wait()


def package_command(*words) -> list:
    """Return the command line that runs ``python -m dbscan_reg_ros`` with `words`, in this interpreter."""
    return [sys.executable, '-m', 'dbscan_reg_ros', *words]
