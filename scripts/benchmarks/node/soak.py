# SPDX-License-Identifier: Apache-2.0
"""Hours of driving: memory, time a scan and containers stay as they are, and the same scans give the same odometry.

A drive to and fro through a furnished building, by the odometry in a process of its own and by the running node, which
are compared to the last bit; a tenth of it three times over, in processes with other hash seeds and numbers of threads;
and once more with a map that is built meanwhile.
"""
import gc
import os
import time
from collections import deque
from hashlib import sha256
from itertools import islice

import numpy as np

from dbscan_reg_ros.commands.workers import local_workers
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.recordings.message_fields import odometry_numbers
from dbscan_reg_ros.robot.base_state import base_state

from ..report import Report, at_most
from .running_node import PATIENCE, cpu_seconds, graph, memory_mb, numbers_of, running_node, to_and_fro

SCANS = 150_000
BLOCK = 1000
"""Scans per block of the comparison; the memory is compared with that after the first block."""
STEP = 250
"""So often is the memory looked at."""
HOUR = 1.0 / 8.0
"""The first of some eight hours: a map has then seen the whole building."""
RUNS = 3
TENTH = 0.1
GIVEN_BACK = {'MALLOC_MMAP_THRESHOLD_': '131072', 'MALLOC_TRIM_THRESHOLD_': '131072'}
"""What the C library begins with and then raises at will. Kept, what is freed is given back: what is resident is
held."""
CONTAINERS = list, dict, set, deque
BOUNDS = {
    'odometry': {'growth_mb': at_most(5.0), 'items_count': at_most(BLOCK // 10), 'ratio_p50': at_most(1.1),
                 'ratio_p99': at_most(1.3)},
    'node': {'lost_count': at_most(0), 'growth_mb': at_most(5.0), 'ratio_mean': at_most(1.1),
             'differ_count': at_most(0)},
    'again': {'differ_count': at_most(0)},
    'map': {'over_mb': at_most(100.0), 'growth_mb': at_most(5.0)},
}


def measure(args):
    """Return a `Report`; ``--limit N`` drives N scans."""
    count = max(args.limit or SCANS, 2 * BLOCK)
    figures, blocks = in_a_process(drive, count)
    again = [in_a_process(drive, max(round(TENTH * count), BLOCK), seed, seed)[1] for seed in range(1, RUNS + 1)]
    report = Report()
    report.add('odometry', {'dbscan': figures}, BOUNDS['odometry'], prefix='odometry_')
    report.add('again', {'dbscan': {'runs_count': RUNS, 'differ_count': sum(differing(blocks, run) for run in again)}},
               BOUNDS['again'], prefix='again_')
    report.add('node', {'dbscan': drive_node(count, blocks)}, BOUNDS['node'], prefix='node_')
    report.add('map', {'dbscan': in_a_process(drive_with_map, count)}, BOUNDS['map'], prefix='map_')
    return report


def differing(blocks, others):
    """How many blocks are not the same, of those that both have."""
    return sum(one != other for one, other in zip(blocks, others, strict=False))


def in_a_process(work, count, hash_seed=0, threads=1):
    """``work(count)`` in a new process."""
    variables = {'PYTHONHASHSEED': str(hash_seed), 'OMP_NUM_THREADS': str(threads),
                 'OPENBLAS_NUM_THREADS': str(threads)}
    variables |= GIVEN_BACK
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        with local_workers(1) as executor:
            return executor.submit(work, count).result()
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def scans():
    """For ever."""
    from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate
    lidar, world = Lidar(), rooms(seed=1)
    return to_and_fro(simulate(world, follow(world.tour[:8], speed=1.0), lidar, seed=1).scans, lidar.rate)


def drive(count):
    """Return the odometry of `count` scans: its figures, and what tells each block of its answers from others."""
    odometry, seconds, blocks, memory = Odometry(), np.full(count, np.nan), Blocks(), []
    for k, scan in enumerate(islice(scans(), count)):
        begin = time.thread_time()
        update = odometry.process(scan)
        seconds[k] = time.thread_time() - begin
        state = base_state(update, SE2(), SE2())
        blocks.add(odometry_numbers(state))
        if k == BLOCK - 1:
            items = _items()
        if k >= BLOCK - 1 and (k + 1) % STEP == 0:
            memory.append(memory_mb(os.getpid()))
    # Before anything of numpy that the odometry does not use is imported.
    added = _items() - items
    tenth = round(TENTH * count)
    first, last = seconds[:tenth], seconds[-tenth:]
    figures = {'scans_count': count, 'memory_mb': memory[-1], 'growth_mb': growth(memory), 'items_count': added,
               'ms_p50': 1e3 * float(np.median(last)), 'ms_p99': 1e3 * float(np.quantile(last, 0.99)),
               'ratio_p50': float(np.median(last) / np.median(first)),
               'ratio_p99': float(np.quantile(last, 0.99) / np.quantile(first, 0.99))}
    return figures, blocks.digests


def drive_with_map(count):
    """Figures of a map that is built along `count` scans; ``over_mb`` is what it takes over the odometry alone."""
    alone, memory = drive(max(round(TENTH * count), 2 * BLOCK))[0]['memory_mb'], []
    from dbscan_reg_ros.places.mapper import Mapper
    odometry, mapper = Odometry(), Mapper()
    for k, scan in enumerate(islice(scans(), count)):
        mapper.process(odometry.process(scan))
        if (k + 1) % STEP == 0:
            memory.append(memory_mb(os.getpid()))
    later = memory[round(HOUR * len(memory)):]
    return {'scans_count': count, 'key_frames_count': len(mapper.numbers), 'over_mb': max(later) - alone,
            'growth_mb': growth(later)}


def growth(memory):
    """Of the memory held: the median of the last tenth of the time over that of the first, for it comes and goes."""
    tenth = max(round(TENTH * len(memory)), BLOCK // STEP)
    return float(np.median(memory[-tenth:]) - np.median(memory[:tenth]))


def _items():
    """How much is in all containers of this process."""
    gc.collect()
    return sum(len(thing) for thing in gc.get_objects() if type(thing) in CONTAINERS)


def drive_node(count, expected):
    """Figures of the node for `count` scans as fast as it answers; `expected` are the blocks that it should answer."""
    from dbscan_reg_ros.node.playback.player import Player
    stream, blocks, lost, marks = scans(), Blocks(), 0, []
    with graph() as folder, running_node(folder, GIVEN_BACK) as node, Player() as player:
        player.wait_for_node(PATIENCE)
        for done in range(0, count, STEP):
            answers = player.play(islice(stream, min(STEP, count - done)))
            marks.append((cpu_seconds(node.pid), memory_mb(node.pid)))
            lost += answers.lost
            for message in filter(None, answers.messages):
                blocks.add(numbers_of(message))
    spent, memory = np.array(marks[BLOCK // STEP - 1:]).T
    tenth = max(1, round(TENTH * len(spent)))
    return {'scans_count': count, 'lost_count': lost, 'growth_mb': growth(list(memory)),
            'ratio_mean': (spent[-1] - spent[-1 - tenth]) / (spent[tenth] - spent[0]),
            'differ_count': differing(expected, blocks.digests)}


class Blocks:
    """What tells one thousand answers from others.

    Attributes
    ----------
    digests : list of str
    """

    def __init__(self):
        self.digests = []
        self._hash, self._count = sha256(), 0

    def add(self, numbers):
        """Append the numbers of one scan."""
        self._hash.update(np.array(numbers, dtype=float).tobytes())
        self._count += 1
        if self._count % BLOCK == 0:
            self.digests.append(self._hash.hexdigest())
