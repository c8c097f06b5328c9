# SPDX-License-Identifier: Apache-2.0
"""Web server of the live page: it answers GET for the page and its events, and nothing else."""
import errno
import hmac
import ipaddress
import secrets
import socket
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

from ...core.errors import DbscanRegError
from ...evaluation.known_motion import KnownMotion
from ...figures.plots import density_map
from ..page.encoding import script_json
from ..page.report import SCRIPTS, Report, page_data, page_parts
from ..trajectory import Trajectory
from .live_drive import LiveDrive

PORTS = 20
"""Number of ports that are tried, beginning with the requested port."""
PATIENCE = 5.0
"""A comment is sent after this time [s] without an event."""
STALLED = 20.0
"""Time [s] after which a browser that accepts no data is disconnected; the browser reconnects by itself."""
MOST_BROWSERS = 32
SENT_AHEAD = 1 << 17
"""Largest number of bytes that wait in the socket of a browser."""
POLICY = ("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
          "connect-src 'self'; frame-ancestors 'none'")


class NoFreePort(DbscanRegError):
    """No address and port for the page can be used."""


class PageServer:
    """Serves the page of a `LiveDrive` in threads of its own at `host`; use it in a ``with`` statement.

    If `port` is busy, the next free port is used; without one or without the host that is a NoFreePort.

    Attributes
    ----------
    host : str port : int token : str
        Token in the address of the page, if other computers can reach `host`; else empty.
    """

    def __init__(self, drive: LiveDrive, host: str, port: int, title: str) -> None:
        self.host = host
        self.token = '' if is_local(host) else secrets.token_urlsafe(16)
        handler = type('Handler', (_Handler,), {'drive': drive, 'page': live_page(title), 'host': host,
                                                'token': self.token})
        self._drive = drive
        self._server = _bound(host, port, handler)
        self.port = int(self._server.server_address[1])
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=self._server.serve_forever, args=(0.1,)),
                         threading.Thread(target=self._draw)]
        for thread in self._threads:
            thread.start()

    @property
    def address(self) -> str:
        """URL of the page."""
        host = f'[{self.host}]' if ':' in self.host else self.host
        return f'http://{host}:{self.port}/' + (f'?token={self.token}' if self.token else '')

    def __enter__(self) -> 'PageServer':
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._drive.close()
        self._server.shutdown()
        for thread in self._threads:
            thread.join()
        self._server.server_close()

    def _draw(self) -> None:
        while not self._ended.wait(0.1):
            if self._drive.browsers:
                self._drive.draw_map()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = MOST_BROWSERS

    def handle_error(self, request, client_address):
        """Log nothing: the browser has disconnected."""


def _bound(host, port, handler):
    """Return a server at the first free port from `port` on."""
    for number in range(port, min(port + PORTS, 65536)):
        try:
            family, *_, place = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
            server = type('Server', (_Server,), {'address_family': family})
            return server(place[:2], handler)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise NoFreePort(f'{host} port {number}: {error.strerror}; give another --host or --port') from error
    raise NoFreePort(f'{host}: the ports from {port} to {port + PORTS - 1} are busy; give another --port')


def is_local(host: str) -> bool:
    """Whether only this computer itself can reach an address or host name."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == 'localhost'


class _Handler(BaseHTTPRequestHandler):
    """Handler of one HTTP request; `PageServer` sets the class attributes."""

    drive: LiveDrive
    page: bytes
    host = token = ''
    timeout = STALLED

    def do_GET(self):
        """Send the page or its events to a browser."""
        place = urlsplit(self.path)
        if not self._is_own_host():
            self.send_error(421, explain='The page is not served under this name.')
        elif not self._has_token(place.query):
            self.send_error(403, explain='The address lacks the token that watch has printed.')
        elif place.path == '/':
            self._begin('text/html; charset=utf-8')
            self.wfile.write(self.page)
        elif place.path == '/events':
            self._send_events()
        else:
            self.send_error(404)

    def _is_own_host(self):
        """Whether the Host header of a request names this computer; other host names are refused (DNS rebinding)."""
        name = urlsplit(f'//{self.headers.get("Host", "")}').hostname or ''
        if is_local(name) or name == self.host.lower():
            return True
        if is_local(self.host):
            return False
        # A name could be that of a foreign page that leads here; a number cannot.
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name == socket.gethostname().lower()
        return True

    def _has_token(self, query):
        given = parse_qs(query).get('token', [''])[0]
        return hmac.compare_digest(given.encode(), self.token.encode()) if self.token else True

    def _begin(self, kind):
        self.send_response(200)
        for name, value in (('Content-Type', kind), ('Content-Security-Policy', POLICY), ('Cache-Control', 'no-store'),
                            ('X-Content-Type-Options', 'nosniff'), ('Referrer-Policy', 'no-referrer')):
            self.send_header(name, value)
        self.end_headers()

    def _send_events(self):
        if self.drive.browsers >= MOST_BROWSERS:
            self.send_error(503, explain=f'{MOST_BROWSERS} browsers are connected.')
            return
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SENT_AHEAD)
        self._begin('text/event-stream')
        with self.drive:
            for part in self.drive.events(PATIENCE):
                for start in range(0, len(part), SENT_AHEAD):
                    self.wfile.write(part[start:start + SENT_AHEAD])

    def log_message(self, *_):
        """Log nothing."""


LEVELS = 'ok', 'warning', 'error', 'stale'
"""Levels of a report on ``/diagnostics``."""
LIVE_SCRIPTS = *SCRIPTS[:-1], 'live.js'


def live_page(title: str) -> bytes:
    """Return the HTML text of the page of a running node."""
    report = Report(title, [], KnownMotion(None, None, None), Trajectory(), density_map([], []), [], None)
    data, scans = page_data(report, live=True)
    data['drive']['statusNames'] = LEVELS
    data['drive']['along'] = {'label': 'time [s]', 'unit': 's', 'end': 1.0, 'at': ''}
    data['drive']['plots'] = [{'id': 'speed', 'name': 'Speed', 'short': 'speed', 'note': '',
                               'unit': 'm/s', 'log': False, 'values': ''}]
    data['nothing'] = ''
    contents = {'data': script_json(data), 'scans': scans, 'connect': "; connect-src 'self'", 'index': ''}
    return ''.join(page_parts(contents, scripts=LIVE_SCRIPTS)).encode()
