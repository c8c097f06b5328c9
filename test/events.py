# SPDX-License-Identifier: Apache-2.0
"""Reader of the events of a live page."""
import http.client
import json
import time

TIMEOUT = 20.0
"""Time [s] within which an event must come."""


class Reader:
    """Reads the events of a live page as a browser does."""

    def __init__(self, host, port, path='/events'):
        self._connection = http.client.HTTPConnection(host, port, timeout=TIMEOUT)
        self._connection.request('GET', path)
        self._answer = self._connection.getresponse()
        assert (self._answer.status, self._answer.headers['Content-Type']) == (200, 'text/event-stream')

    def next(self, *names):
        """Name and content of the next event, or of the next of these names."""
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            line = self._answer.readline()
            assert line, 'the page has ended the connection'
            name = line.decode().strip()
            if name.startswith('event: ') and (not names or name[7:] in names):
                return name[7:], json.loads(self._answer.readline().decode().removeprefix('data: '))
        raise AssertionError(f'none of these events came in time: {", ".join(names) or "any"}')

    def close(self):
        self._answer.close()
        self._connection.close()
