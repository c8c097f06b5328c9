# SPDX-License-Identifier: Apache-2.0
"""Processes of our own that always end."""
import os
import signal
import subprocess
import sys
import time
import weakref
from contextlib import suppress

from ..core.errors import DbscanRegError
from .command_line import ENDING, held
from .private_graph import domain_locks

POLL = 0.05
"""Time [s] between two looks at what a process has printed."""


class ProcessEnded(DbscanRegError):
    """A process has ended that was to go on."""


class Process:
    """A child process with a session of its own, so that a Ctrl-C in the terminal does not reach it by itself.

    Parameters
    ----------
    command : list of str
    log : path-like
        File that takes its standard output and error.
    environment : dict, optional
        Variables on top of this process' own.
    """

    def __init__(self, command, log, environment=None):
        self.command = [os.fspath(word) for word in command]
        self.log = log
        with open(log, 'wb') as output, held(*ENDING):
            self._popen = subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                                           env=os.environ | (environment or {}), start_new_session=True,
                                           pass_fds=domain_locks())
            self._end = weakref.finalize(self, _kill_group, self._popen)
        self.pid = self._popen.pid

    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._popen.poll() is None

    def output(self) -> str:
        """Return what it has printed so far."""
        with open(self.log, encoding='utf-8', errors='replace') as log:
            return log.read()

    def lines(self, last):
        """Yield each line as it is printed, up to one that is `last`; `ProcessEnded` if the process ends before."""
        with open(self.log, encoding='utf-8', errors='replace') as log:
            line = part = ''
            while line != last:
                part += log.readline()
                if part.endswith('\n'):
                    line, part = part[:-1], ''
                    yield line
                elif self.running():
                    time.sleep(POLL)
                else:
                    raise ProcessEnded(f'{" ".join(self.command)} has ended; its output is in {self.log}')

    def signal(self, number):
        """Send it a signal, if it still runs."""
        self._popen.send_signal(number)

    def wait(self, timeout) -> int:
        """Its exit status; `subprocess.TimeoutExpired` after `timeout` seconds."""
        return self._popen.wait(timeout)

    def stop(self, patience=5.0) -> int:
        """End it and all its children: politely at first, by force after `patience` seconds.

        Returns
        -------
        int
            Its exit status; negative when a signal ended it.
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
    """Kill the process and all in its session."""
    with suppress(ProcessLookupError):
        os.killpg(popen.pid, signal.SIGKILL)
    popen.wait()


def package_command(*words) -> list:
    """Return the command line that runs ``python -m dbscan_reg_ros`` with `words`, in this interpreter."""
    return [sys.executable, '-m', 'dbscan_reg_ros', *words]
