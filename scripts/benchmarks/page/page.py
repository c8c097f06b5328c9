# SPDX-License-Identifier: Apache-2.0
"""Pages in a headless browser: that of the Intel log (time to open, time of a frame, memory), and the live page.

A page of a whole drive has to open about as fast as an empty one of its size, and to fit in a mail and in the memory of
a small computer.
"""
import os
import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.errors import DbscanRegError
from dbscan_reg_ros.recordings import data_folder

from ..report import Report, at_most
from . import live
from .browser import Browser, find_browser

BOUNDS = {'file_mb': at_most(8.0), 'ratio_open': at_most(2.0), 'memory_mb': at_most(500.0)}
"""Size of the file; time until the map is drawn, beside a blank page of the same size; memory of all processes."""
TURNS = 8
SIZE = 1400, 900
DRAG = """new Promise(done => {
  const times = [];
  let last = performance.now(), k = 0;
  const step = now => {
    times.push(now - last);
    last = now;
    k += 1 + Math.floor(drive.count / 600);
    if (k >= drive.count) { done(times); return; }
    page.go(k);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})"""


def measure(args):
    """Return the tables that `args` names, by default both."""
    if find_browser() is None:
        raise DbscanRegError('bench page: needs a chromium on the PATH')
    report = Report()
    if not args.only or 'report' in args.only:
        _add_report(report, data_folder(args.data) / 'intel' / 'intel.log.gz')
    if not args.only or 'live' in args.only:
        live.add_table(report, args)
    return report


def _add_report(report, log):
    """Add the figures of the page of a `log` to a `Report`."""
    with tempfile.TemporaryDirectory() as folder:
        replay([str(log), '--out', folder])
        page = Path(folder, log.name.partition('.')[0], 'latest', 'report.html')
        row = in_browser(page, Path(folder, 'blank.html'), Path(folder, 'profile'))
    report.add('page of the Intel log', {'dbscan': row}, BOUNDS)


def in_browser(page, blank, profile):
    """Return the figures of the page; `blank` is where a page of the same size is written."""
    size = page.stat().st_size
    frame = '<!DOCTYPE html><script type="text/plain">{}</script>'
    blank.write_text(frame.format('x' * (size - len(frame) + 2)))
    with closing(Browser(f'{profile}_once')) as browser:
        browser.screen(*SIZE)
        browser.open(page.as_uri())
        browser.value('ready.then(() => 0)')
        frames = browser.value(DRAG)[1:]
        browser.call('HeapProfiler.collectGarbage')
        memory = memory_of(browser.process)
    opened, scans = {page: [], blank: []}, []
    with closing(Browser(f'{profile}_turns')) as browser:
        browser.screen(*SIZE)
        for _ in range(TURNS):
            for file, times in opened.items():
                browser.open(file.as_uri())
                browser.frame()
                times.append(browser.value('performance.now()'))
                if file is page:
                    browser.value('ready.then(() => 0)')
                    scans.append(browser.value('performance.now()'))
    ours, empty = map(min, opened.values())
    return {'file_mb': size / 1e6, 'ms_open': ours, 'ms_blank': empty, 'ratio_open': ours / empty,
            'ms_scans': min(scans),
            'ms_frame_p50': float(np.median(frames)), 'ms_frame_p95': float(np.percentile(frames, 95)),
            'memory_mb': memory / 1e6}


def memory_of(process):
    """Return the memory [bytes] of the processes of a session, shared pages divided among those that share them."""
    total = 0
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            if os.getsid(int(folder.name)) == process:
                words = (folder / 'smaps_rollup').read_text().partition('Pss:')[2].split()
                total += 1024 * int(words[0])
        except (OSError, IndexError):
            continue
    return total
