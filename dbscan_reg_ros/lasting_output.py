# SPDX-License-Identifier: Apache-2.0
"""Standard output that may close, or whose disk may be full, before the work of a command is done."""
import os
import sys
from contextlib import contextmanager


@contextmanager
def lasting_output():
    """Discard what is printed in the ``with`` block from the first failure of standard output or error on.

    So the work goes on and its results are written, although the reader of the output has ended, as in ``| head -1``.

    Raises
    ------
    OSError
        At the end of the block, for any other failure of standard output than a reader that has ended.
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
