# SPDX-License-Identifier: Apache-2.0
"""Ends of a command that come early: signals, a standard output that closes, a full disk."""
import os
import signal
import sys
import threading
from contextlib import contextmanager

ENDING = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
"""Signals that request the end of a command."""


@contextmanager
def interruptible(*signals, once=False):
    """Turn `signals` that are not ignored into a KeyboardInterrupt.

    An exception that follows a signal is raised as a KeyboardInterrupt, too: rclpy replaces a KeyboardInterrupt that is
    raised while it converts a message with an exception of its own. With `once`, all signals after the first are
    ignored until the process ends.

    After a signal, errors of finalizers are no longer printed, until the process ends: an object whose constructor was
    interrupted may lack the attributes that its ``__del__`` uses.
    """
    came = []

    def interrupt(number, _frame):
        came.append(number)
        sys.unraisablehook = _ignore
        for each in signals if once else ():
            signal.signal(each, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt)
              for number in signals if signal.getsignal(number) is not signal.SIG_IGN}
    try:
        yield
    except Exception as error:
        if came:
            raise KeyboardInterrupt from error
        raise
    finally:
        for number, handler in before.items() if not (came and once) else ():
            signal.signal(number, handler)


def _ignore(_unraisable):
    """Print nothing about an error in a finalizer."""


@contextmanager
def held(*signals):
    """Delay the handling of `signals` until the end of the ``with`` block, so that the block is not interrupted."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = []
    before = {number: signal.signal(number, lambda number, _frame: came.append(number))
              for number in signals if signal.getsignal(number) is not signal.SIG_IGN}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came[:1]:
            signal.raise_signal(number)


@contextmanager
def lasting_output():
    """Discard what is printed in the ``with`` block from the first failure of standard output or error on.

    So the work goes on and its results are written, although the reader of the output has ended, as in ``| head -1``.
    Raises an OSError at the end of the block, for any other failure of standard output than a reader that has ended.
    """
    before = sys.stdout, sys.stderr
    streams = [stream and _Stream(stream) for stream in before]
    sys.stdout, sys.stderr = streams
    try:
        yield
    finally:
        for stream in filter(None, streams):
            stream.flush()
        sys.stdout, sys.stderr = before
    failure = streams[0] and streams[0].failure
    if failure and not isinstance(failure, BrokenPipeError):
        raise OSError(failure.errno, failure.strerror, 'standard output')


class _Stream:
    """Text stream that discards everything after its first failure, kept as `failure`."""

    def __init__(self, stream):
        self._stream, self.failure = stream, None

    def write(self, text):
        self._attempt(self._stream.write, text)
        return len(text)

    def flush(self):
        self._attempt(self._stream.flush)

    def _attempt(self, function, *args):
        if self.failure:
            return
        try:
            function(*args)
        except OSError as error:
            self.failure = error
            discard(self._stream)

    def __getattr__(self, name):
        return getattr(self._stream, name)


def discard(stream):
    """Discard what `stream` holds and will get."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, stream.fileno())
    os.close(nothing)
