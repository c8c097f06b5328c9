# SPDX-License-Identifier: Apache-2.0
"""Reader of the events of a live page."""
import http.client
import json

TIMEOUT = 20.0


class Reader:
    """Reads the events of a live page as a browser does."""

    def __init__(self, host, port, path='/events'):
        self._connection = http.client.HTTPConnection(host, port, timeout=TIMEOUT)
        self._connection.request('GET', path)
        self._answer = self._connection.getresponse()
        assert (self._answer.status, self._answer.headers['Content-Type']) == (200, 'text/event-stream')

    def next(self, *names):
        """Name and content of the next event, or of the next of these names."""
        while True:
            name = self._answer.readline().decode().strip()
            if name.startswith('event: ') and (not names or name[7:] in names):
                return name[7:], json.loads(self._answer.readline().decode().removeprefix('data: '))

    def close(self):
        self._answer.close()
        self._connection.close()
