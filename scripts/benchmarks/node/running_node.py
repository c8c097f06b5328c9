# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own: latency, load of a core, memory and the time it takes to start."""
import os
import tempfile
import time
from contextlib import contextmanager, suppress
from itertools import cycle, islice
from pathlib import Path

import numpy as np

from dbscan_reg_ros.core.scan import Scan

from ..bounds import at_most
from ..report import Report

WARM_UP = 2.0
"""Seconds that do not count: both sides get to know each other."""
SETTLED = 20.0
"""Memory is compared with that after so many seconds, when the window is full."""
PATIENCE = 30.0
"""A node that needs longer [s] will never be ready."""
STARTS = 5
STREAMS = {
    'fine': {'beams': 1081, 'fov': 270.0, 'rate': 40.0, 'seconds': 60.0},
    'coarse': {'beams': 181, 'fov': 180.0, 'rate': 25.0, 'seconds': 20.0},
}
BOUNDS = {
    'fine': {'lost_count': at_most(0), 'ms_p50': at_most(8.0), 'ms_p99': at_most(25.0),
             'core': at_most(0.40), 'growth_mb': at_most(5.0)},
    'coarse': {'lost_count': at_most(0), 'core': at_most(0.12)},
    'start': {'ms_ready': at_most(2000.0)},
}


ALONE = '-p', 'mounting:=none'
"""Arguments of the node for one lidar in the middle of the base."""


def measure(args):
    """Return a `Report`; ``--limit N`` makes each stream N scans long."""
    from .two_lidars import add_two_lidars
    report = Report()
    report.add('start', {'dbscan': start_up()}, BOUNDS['start'], prefix='start_')
    for name, stream in STREAMS.items():
        count = args.limit or round(stream['seconds'] * stream['rate'])
        report.add(name, {'dbscan': run(**stream, count=count)}, BOUNDS[name], prefix=f'{name}_')
    add_two_lidars(report, args.limit)
    return report


def start_up() -> dict:
    """Milliseconds from starting the process to its first odometry, the scans being there already.

    The median of a few starts, for discovery takes its time now and then.
    """
    times = [_start_up() for _ in range(STARTS)]
    return {'ms_ready': 1e3 * float(np.median(times))}


def _start_up():
    from dbscan_reg_ros.node.playback.player import Player, PlayerError
    scans = make_scans(181, 180.0, 10.0, 1)
    with graph() as folder, Player() as player:
        began = time.monotonic()
        with running_node(folder):
            while (waited := time.monotonic() - began) < PATIENCE:
                with suppress(PlayerError):
                    if not player.play(scans, patience=0.05).lost:
                        return time.monotonic() - began
    return waited


def run(beams, fov, rate, count, seconds=None) -> dict:
    """Return what a stream of `count` scans costs."""
    answers, spent, memory = play(make_scans(beams, fov, rate, count), rate)
    delays = 1e3 * np.array(answers.delays[int(min(WARM_UP * rate, count // 2)):])
    known = delays[np.isfinite(delays)]
    return {'lost_count': answers.lost, 'ms_p50': float(np.median(known)) if len(known) else float('nan'),
            'ms_p99': float(np.quantile(known, 0.99)) if len(known) else float('nan'), 'core': spent,
            'growth_mb': memory}


def play(items, rate, words=ALONE, topic='scan', channels=(), warm_up=WARM_UP):
    """Play scans at `rate` [Hz] to a node that is started with the arguments `words`.

    `items` has the scans of `topic` and the messages of the `channels`. Return the `Answers`, the load of a core after
    `warm_up` [s], and the growth of the memory [MB].
    """
    from dbscan_reg_ros.node.playback.player import Player
    with graph() as folder, running_node(folder, words=words) as node, Player(topic=topic) as player:
        player.announce(channels)
        player.wait_for_node(PATIENCE)
        usage = _Usage(node.pid, SETTLED * rate)
        answers = player.play(usage.watched(items, warm_up * rate), rate=1.0)
        return answers, *usage.result()


class _Usage:
    """Load of a core and growth of the memory of a process while scans are taken from a list."""

    def __init__(self, pid, settled):
        self._pid = pid
        self._settled = settled
        self._begin = self._memory = None

    def watched(self, scans, warm_up):
        for k, scan in enumerate(scans):
            if k == int(min(warm_up, len(scans) // 2)):
                self._begin = time.monotonic(), cpu_seconds(self._pid)
            if k == int(min(self._settled, len(scans) // 2)):
                self._memory = memory_mb(self._pid)
            yield scan

    def result(self):
        """Return (load of a core [0..1], growth of the memory [MB])."""
        began, spent = self._begin
        return ((cpu_seconds(self._pid) - spent) / (time.monotonic() - began), memory_mb(self._pid) - self._memory)


def make_scans(beams, fov, rate, count):
    """Return a drive to and fro through a building, so often that there are `count` scans."""
    from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate
    step = np.radians(fov) / (beams - 1)
    world = rooms(seed=1)
    lidar = Lidar(beams=beams, angle_min=-0.5 * np.radians(fov), angle_increment=step, rate=rate)
    drive = simulate(world, follow(world.tour[:4], speed=1.0), lidar, seed=1).scans[:min(count, int(10.0 * rate))]
    return list(islice(to_and_fro(drive, rate), count))


def to_and_fro(drive, rate):
    """Yield the scans of a drive, backwards, and so on for ever, with stamps that go on at `rate` [Hz]."""
    period = round(1e9 / rate)
    for k, scan in enumerate(cycle([*drive, *drive[-2:0:-1]])):
        yield Scan(drive[0].stamp + k * period, scan.ranges, scan.geometry, 0.0, scan.frame_id)


@contextmanager
def graph():
    """Provide a ROS graph of its own, and a folder for the node's log."""
    from dbscan_reg_ros.private_graph import private_graph
    with private_graph(), tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def running_node(folder, variables=None, words=ALONE):
    """Return a `Process` that runs scan_matcher, by default with the laser as the base; its logs go to `folder`.

    `variables` are added to its environment, `words` are its ROS arguments.
    """
    from dbscan_reg_ros.commands.processes import Process, package_command
    root = os.fspath(Path(__file__).resolve().parents[3])
    environment = (variables or {}) | {'ROS_LOG_DIR': os.fspath(folder),
                   'PYTHONPATH': os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))}
    return Process(package_command('scan_matcher', '--ros-args', *words), folder / 'node.log', environment)


def cpu_seconds(pid):
    """Time that a process has spent on any core [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def memory_mb(pid):
    """Resident memory of a process [MB]."""
    line = next(line for line in Path(f'/proc/{pid}/status').read_text().splitlines() if line.startswith('VmRSS:'))
    return int(line.split()[1]) / 1024.0
