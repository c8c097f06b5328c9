# SPDX-License-Identifier: Apache-2.0
"""The live page: time from a scan to the page, and what the node's latency becomes while it is watched.

A page on another computer only reads what is sent anyway, so the latency of the node may change by at most 5 %.
"""
import os
import socket
import threading
import time
import urllib.request
from contextlib import closing, contextmanager

import numpy as np

from dbscan_reg_ros.core.errors import DbscanRegError

from ..node.running_node import PATIENCE, WARM_UP, graph, make_scans, memory_mb, running_node
from ..report import Bound
from .browser import Browser

TURNS = 5
CLOSED = 'no browser is connected'
BEAMS, FIELD, RATE, SECONDS = 181, 180.0, 25.0, 10.0
BOUNDS = {'ratio_latency': Bound(0.95, 1.05)}
ARRIVALS = """(() => {
  window.arrivals = [];
  const add = page.add.bind(page);
  page.add = event => {
    add(event);
    requestAnimationFrame(() => setTimeout(() => arrivals.push([event.time, Date.now() / 1000])));
  };
})()"""
"""Notes when each scan is drawn."""


def add_table(report, args):
    """Add the figures to a `Report`; ``--limit N`` plays N scans each time."""
    report.add('live page, node with 181 beams at 25 Hz', {'dbscan': alternate(args.limit or round(SECONDS * RATE))},
               BOUNDS, prefix='live_')


def alternate(count) -> dict:
    """Return the figures of `count` scans: without a browser, with one elsewhere, with one here."""
    from dbscan_reg_ros.commands.processes import Process, package_command
    from dbscan_reg_ros.commands.watch import OPENED
    from dbscan_reg_ros.node.playback.player import Player

    scans = make_scans(BEAMS, FIELD, RATE, count)
    without, elsewhere, here, shown = [], [], [], []
    with (graph() as folder, running_node(folder) as node, Player() as player,
          Process(package_command('watch'), folder / 'watch.log', {'ROS_LOG_DIR': os.fspath(folder)}) as watch):
        address = next(line.split()[-1] for line in watch.lines(OPENED) if line.startswith('page'))
        player.wait_for_node(PATIENCE)
        for turn in range(TURNS):
            without += _delays(player, scans, {})
            with _taking(f'{address}events'):
                _until(lambda: _noted(watch, OPENED) > _noted(watch, CLOSED))
                elsewhere += _delays(player, scans, {})
            _until(lambda: _noted(watch, OPENED) == _noted(watch, CLOSED))
            with closing(Browser(folder / f'profile_{turn}')) as browser:
                browser.open(address)
                browser.value('ready.then(() => 0)')
                browser.value(ARRIVALS)
                _wait(browser, 'page.node')
                published = {}
                here += _delays(player, scans, published)
                drawn = {round(stamp, 6): when for stamp, when in browser.value('arrivals')}
                shown += [drawn[stamp] - published[stamp] for stamp in drawn.keys() & published.keys()]
            _until(lambda: _noted(watch, OPENED) == _noted(watch, CLOSED))
        memory = memory_mb(watch.pid)
        assert node.running()
    return {'ms_to_page_p50': 1e3 * float(np.median(shown)), 'ms_to_page_p95': 1e3 * float(np.quantile(shown, 0.95)),
            'ms_without': 1e3 * float(np.median(without)), 'ms_with': 1e3 * float(np.median(elsewhere)),
            'ratio_latency': float(np.median(elsewhere) / np.median(without)),
            'ms_browser_here': 1e3 * float(np.median(here)), 'watch_mb': memory}


def _noted(watch, line):
    """Count how often the process has printed a line."""
    return watch.output().splitlines().count(line)


@contextmanager
def _taking(address):
    """Take the events of the page without drawing them, as a browser on another computer costs nothing here."""
    with urllib.request.urlopen(address, timeout=PATIENCE) as events:
        thread = threading.Thread(target=lambda: list(iter(lambda: events.read1(65536), b'')), daemon=True)
        thread.start()
        yield
        events.fp.raw._sock.shutdown(socket.SHUT_RDWR)
        thread.join()


def _delays(player, scans, published):
    """Play `scans` in real time, note when each was published, and return the latencies [s] after the warm-up."""
    def noted():
        for scan in scans:
            yield scan
            published[round(scan.stamp * 1e-9, 6)] = time.time()

    delays = np.array(player.play(noted(), rate=1.0).delays)[int(min(WARM_UP * RATE, len(scans) // 2)):]
    return delays[np.isfinite(delays)].tolist()


def _wait(browser, expression):
    """Wait until an expression of the page is true."""
    browser.value(f'new Promise(done => {{ const look = () => {expression} ? done(0) : setTimeout(look, 50); '
                  'look(); })')


def _until(condition):
    """Wait until a condition is true."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise DbscanRegError('bench page: the live page does not notice that the browser has gone')
        time.sleep(0.05)
