# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own: latency, load of a core, memory and the time it takes to start."""
import json
import os
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from itertools import cycle, islice
from pathlib import Path

import numpy as np

from dbscan_reg_ros.core.scan import Scan

from ..bounds import at_most
from ..fingerprint.fingerprint import built, environment, resolved, root
from ..report import Report

WARM_UP = 2.0
"""Seconds that do not count: both sides get to know each other."""
SETTLED = 20.0
"""Memory is compared with that after so many seconds, when the window is full."""
PATIENCE = 30.0
"""A node that needs longer [s] will never be ready."""
STARTS = 5
SCRIPT = Path(__file__).with_name('timed_node.py')
STREAMS = {
    'fine': {'beams': 1081, 'fov': 270.0, 'rate': 40.0, 'seconds': 60.0},
    'coarse': {'beams': 181, 'fov': 180.0, 'rate': 25.0, 'seconds': 20.0},
}
BOUNDS = {
    'fine': {'lost_count': at_most(0), 'ms_p50': at_most(8.0), 'ms_p99': at_most(25.0), 'ms_own': at_most(0.5),
             'core': at_most(0.11), 'memory_mb': at_most(90.0), 'growth_mb': at_most(5.0)},
    'coarse': {'lost_count': at_most(0), 'core': at_most(0.06), 'memory_mb': at_most(90.0)},
    'start': {'ms_ready': at_most(2000.0), 'ratio_ready': at_most(0.7)},
}
"""The ratio is that to fdd4aae."""
ALONE = '-p', 'mounting:=none'
"""Arguments of the node for one lidar in the middle of the base."""


def measure(args):
    """Return a `Report`; ``--limit N`` makes each stream N scans long, ``--against`` adds another commit's node."""
    from .two_lidars import add_two_lidars
    report = Report()
    trees = {'dbscan': root()}
    if args.against:
        trees['theirs'] = built(resolved(args.against))
    starts = start_up(trees)
    if args.against:
        starts['dbscan']['ratio_ready'] = starts['dbscan']['ms_ready'] / starts['theirs']['ms_ready']
    report.add('start', starts, BOUNDS['start'], prefix='start_')
    for name, stream in STREAMS.items():
        count = args.limit or round(stream['seconds'] * stream['rate'])
        rows = {method: run(**stream, count=count, tree=tree) for method, tree in trees.items()}
        report.add(name, rows, BOUNDS[name], prefix=f'{name}_')
    if not args.against:
        add_two_lidars(report, args.limit)
    return report


def start_up(trees) -> dict:
    """Milliseconds from starting the process to its first odometry, the scans being there already.

    `trees` is method -> source tree. The median of a few starts; the trees take turns.
    """
    rounds = [[_start_up(tree) for tree in trees.values()] for _ in range(STARTS)]
    return {name: {'ms_ready': time} for name, time in zip(trees, 1e3 * np.median(rounds, axis=0), strict=True)}


def _start_up(tree):
    from dbscan_reg_ros.node.playback.player import Player, PlayerError
    scans = make_scans(181, 180.0, 10.0, 1)
    with graph() as folder, Player() as player:
        began = time.monotonic()
        with running_node(folder, tree=tree):
            while (waited := time.monotonic() - began) < PATIENCE:
                with suppress(PlayerError):
                    if not player.play(scans, patience=0.05).lost:
                        return time.monotonic() - began
    return waited


def run(beams, fov, rate, count, seconds=None, tree=None) -> dict:
    """Return what a stream of `count` scans costs the node of a source tree, by default this one."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, 'times.json')
        answers, usage = play(make_scans(beams, fov, rate, count), rate, tree=tree, times=file)
        ms_own = own_part(**json.loads(file.read_text()))
    delays = 1e3 * np.array(answers.delays[int(min(WARM_UP * rate, count // 2)):])
    known = delays[np.isfinite(delays)]
    return {'lost_count': answers.lost, 'ms_p50': float(np.median(known)) if len(known) else float('nan'),
            'ms_p99': float(np.quantile(known, 0.99)) if len(known) else float('nan'), 'ms_own': ms_own, **usage}


def own_part(callback, odometry) -> float:
    """Return what a scan takes besides the odometry, the mean over the later half of the scans [ms]."""
    half = len(odometry) // 2
    return float(np.mean(callback[-half:]) - np.mean(odometry[-half:]))


def play(items, rate, words=ALONE, topic='scan', channels=(), warm_up=WARM_UP, **node_options):
    """Play scans at `rate` [Hz] to a node that is started with the arguments `words`.

    `items` has the scans of `topic` and the messages of the `channels`. Return the `Answers`, and as a dictionary the
    load of a core after `warm_up` [s], the memory at the end and its growth [MB].
    """
    from dbscan_reg_ros.node.playback.player import Player
    with graph() as folder, running_node(folder, words=words, **node_options) as node, Player(topic=topic) as player:
        player.announce(channels)
        player.wait_for_node(PATIENCE)
        usage = _Usage(node.pid, SETTLED * rate)
        answers = player.play(usage.watched(items, warm_up * rate), rate=1.0)
        return answers, usage.result()


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
        """Return the load of a core [0..1], the memory and its growth [MB]."""
        began, spent = self._begin
        memory = memory_mb(self._pid)
        return {'core': (cpu_seconds(self._pid) - spent) / (time.monotonic() - began), 'memory_mb': memory,
                'growth_mb': memory - self._memory}


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
    os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = os.fspath(SCRIPT.with_name('announcements.xml'))
    with private_graph(), tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def running_node(folder, variables=None, words=ALONE, tree=None, times=None):
    """Return a `Process` that runs scan_matcher, by default with the laser as the base; its logs go to `folder`.

    `variables` are added to its environment, `words` are its ROS arguments, `tree` is its source tree, by default this
    one, `times` the file that the times of its scans are written to.
    """
    from dbscan_reg_ros.commands.processes import Process
    given = environment(tree or root()) | (variables or {}) | {'ROS_LOG_DIR': os.fspath(folder)}
    command = [sys.executable, os.fspath(SCRIPT), os.fspath(times or os.devnull), '--ros-args', *words]
    return Process(command, folder / 'node.log', given)


def cpu_seconds(pid):
    """Time that a process has spent on any core [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def memory_mb(pid):
    """Resident memory of a process [MB]."""
    line = next(line for line in Path(f'/proc/{pid}/status').read_text().splitlines() if line.startswith('VmRSS:'))
    return int(line.split()[1]) / 1024.0
