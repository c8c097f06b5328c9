# SPDX-License-Identifier: Apache-2.0
"""Streams of scans played to the node: latency, load of a core, memory and the time it takes to start.

A scan has to be answered before the next one comes, on a computer that has other work: that bounds latency, load of a
core and memory.
"""
import json
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..report import Report, at_most
from ..trees import built, resolved, root
from .running_node import ALONE, PATIENCE, WARM_UP, graph, make_scans, play, running_node
from .two_lidars import add_two_lidars

STARTS = 5
STREAMS = {
    'fine': {'beams': 1081, 'fov': 270.0, 'rate': 40.0, 'seconds': 60.0},
    'coarse': {'beams': 181, 'fov': 180.0, 'rate': 25.0, 'seconds': 20.0},
}
BOUNDS = {
    'fine': {'lost_count': at_most(0), 'ms_p50': at_most(8.0), 'ms_p99': at_most(25.0), 'ms_own': at_most(0.5),
             'core': at_most(0.11), 'memory_mb': at_most(90.0), 'growth_mb': at_most(5.0)},
    'coarse': {'lost_count': at_most(0), 'core': at_most(0.06), 'memory_mb': at_most(90.0)},
    'slam': {'lost_count': at_most(0), 'ratio_p99': at_most(1.2), 'ratio_core': at_most(1.5)},
    'start': {'ms_ready': at_most(2000.0), 'ratio_ready': at_most(0.7)},
}
"""The ratio of the start is that to fdd4aae; those of ``slam``, ``coarse`` with a map that is built, that to it."""
SLAM = *ALONE, '-p', 'map.mode:=slam'


def measure(args):
    """Return a `Report`; ``--limit N`` makes each stream N scans long, ``--against`` adds another commit's node."""
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
        rows = {method: run(stream, count, tree) for method, tree in trees.items()}
        report.add(name, rows, BOUNDS[name], prefix=f'{name}_')
    if not args.against:
        slam, none = run(stream, count, words=SLAM), rows['dbscan']
        ratios = {'ratio_p99': slam['ms_p99'] / none['ms_p99'], 'ratio_core': slam['core'] / none['core']}
        report.add('slam', {'dbscan': slam | ratios}, BOUNDS['slam'], prefix='slam_')
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


def run(stream, count, tree=None, words=ALONE) -> dict:
    """Return what `count` scans of a stream cost the node of a source tree, by default this one, with these `words`."""
    rate = stream['rate']
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, 'times.json')
        scans = make_scans(stream['beams'], stream['fov'], rate, count)
        answers, usage = play(scans, rate, words, tree=tree, times=file)
        ms_own = own_part(**json.loads(file.read_text()))
    delays = 1e3 * np.array(answers.delays[int(min(WARM_UP * rate, count // 2)):])
    known = delays[np.isfinite(delays)]
    return {'lost_count': answers.lost, 'ms_p50': float(np.median(known)) if len(known) else float('nan'),
            'ms_p99': float(np.quantile(known, 0.99)) if len(known) else float('nan'), 'ms_own': ms_own, **usage}


def own_part(callback, odometry) -> float:
    """Return what a scan takes besides the odometry, the mean over the later half of the scans [ms]."""
    half = len(odometry) // 2
    return float(np.mean(callback[-half:]) - np.mean(odometry[-half:]))
