# SPDX-License-Identifier: Apache-2.0
"""The node with two lidars beside the node with one lidar of twice their rate, on the same drive.

Two lidars at 15 Hz are as many scans as one at 30 Hz, and may cost a fifth more.
"""
import dataclasses
import heapq
import math
from operator import attrgetter

import numpy as np

from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

from ..odometry.courses import FRONT, REAR
from ..report import at_least, at_most
from .running_node import play

RATE, BEAMS = 15.0, 1081
"""Of each of the two lidars [Hz]; one lidar has twice the rate."""
SECONDS = 30.0
WARM_UP = 5.0
"""Seconds that do not count: after them the second lidar has been compared and is used."""
ROUNDS = 3
"""Number of times that both streams are played, at the same time, for the speed of a machine varies."""
MOUNTINGS = {'front': FRONT, 'rear': REAR}
STREAMS = {'pair': 'first', 'pair_all': 'all'}
"""Stream of two lidars -> ``odom_on``: only with ``all`` the odometry shows which scans of the second one are used."""
MORE = {'lost_count': at_most(0), 'ms_more_p50': at_most(20.0), 'ms_more_p99': at_most(20.0)}
BOUNDS = {'single': {'lost_count': at_most(0)}, 'pair': {**MORE, 'ratio_core': at_most(1.2)},
          'pair_all': {**MORE, 'used': at_least(0.8)}}


def add_two_lidars(report, limit=None):
    """Add the streams of one and of two lidars to a `Report`; each has at most `limit` scans."""
    for name, row in compare(min(SECONDS, (limit or math.inf) / (2.0 * RATE))).items():
        report.add(name, {'dbscan': row}, BOUNDS[name], prefix=f'{name}_')


def compare(seconds, rounds=ROUNDS) -> dict:
    """Return the figures of one lidar and of two lidars, each played for `seconds` in `rounds`.

    A stream of two lidars is played at the same time as that of one, each to a node in a ROS graph of its own. Loads
    and their ratios are medians over the rounds; latencies are those of all scans of the first lidar.
    """
    from dbscan_reg_ros.commands.workers import local_workers
    single, pair = make_drive(seconds)
    rows, alone = {}, []
    with local_workers(2) as executor:
        for name, odom_on in STREAMS.items():
            ones, twos = [], []
            for _ in range(rounds):
                jobs = executor.submit(_played, single), executor.submit(_played, *pair, odom_on=odom_on)
                one, two = (job.result() for job in jobs)
                ones.append(one)
                twos.append(two)
            rows[name] = _beside(_figures(ones), _figures(twos))
            ratios = [two.core / (one.core or math.nan) for one, two in zip(ones, twos, strict=True)]
            rows[name]['ratio_core'] = float(np.median(ratios))
            if odom_on == 'all':
                rows[name]['used'] = min(each.used for each in twos)
            alone += ones
    return {'single': _figures(alone), **rows}


def _beside(one, two):
    """Return the figures of two lidars and by how much their latency is longer than that of one."""
    return {**two, **{f'ms_more_{name}': two[f'ms_{name}'] - one[f'ms_{name}'] for name in ('p50', 'p99')}}


def make_drive(seconds):
    """Return the scans of one lidar, and those of both lidars, on the same drive through rooms.

    The last scan is one of the first lidar, for whose odometry the player waits.
    """
    world = rooms(seed=1)
    path = follow(world.tour, speed=1.0).until(seconds)
    step = math.radians(270.0) / (BEAMS - 1)
    front = Lidar(BEAMS, math.radians(-135.0), step, rate=RATE, mounting=FRONT, frame_id='front')
    rear = dataclasses.replace(front, mounting=REAR, frame_id='rear', phase=0.019)
    lidars = dataclasses.replace(front, rate=2.0 * RATE), front, rear
    single, first, second = (simulate(world, path, lidar, seed).scans for seed, lidar in enumerate(lidars, 1))
    return single, (first, [scan for scan in second if scan.stamp < first[-1].stamp])


@dataclasses.dataclass(frozen=True)
class _Played:
    """What the node did with a stream."""

    lost: int
    """Number of scans without odometry; those of the second lidar count after `WARM_UP`, if odometry is published for
    them."""
    used: float
    """Fraction of the scans of the second lidar that have odometry."""
    delays: np.ndarray
    """Latency of the scans of the first lidar [s]."""
    core: float
    """Load of a core."""


def _played(first, second=(), odom_on='first'):
    """Play the scans of a lidar, or of two, to a node that publishes odometry for the scans of the first or of all."""
    from rclpy.serialization import serialize_message

    from dbscan_reg_ros.node.interfaces.messages import scan_to_message
    from dbscan_reg_ros.recordings.bags.bag import LASER_SCAN
    from dbscan_reg_ros.recordings.playback import Channel, Played
    channel = Channel('rear/scan', LASER_SCAN)
    others = [Played(serialize_message(scan_to_message(scan)), scan.stamp, channel) for scan in second]
    items = list(heapq.merge([Played(scan, scan.stamp) for scan in first], others, key=attrgetter('time')))
    words = _node_words(['front', 'rear'] if second else ['front'], odom_on)
    answers, usage = play(items, 2.0 * RATE, words, 'front/scan', [channel] if second else [], WARM_UP)
    begin = first[0].stamp + round(WARM_UP * 1e9)
    missing = {scan.stamp for scan in second}.difference(answers.unexpected_stamps)
    used = 1.0 - len(missing) / max(1, len(second))
    lost = answers.lost + (sum(stamp >= begin for stamp in missing) if odom_on == 'all' else 0)
    delays = np.array(answers.delays)[np.array(answers.stamps) >= begin]
    return _Played(lost, used, delays[np.isfinite(delays)], usage['core'])


def _node_words(names, odom_on):
    words = ['-p', f'sensors:=[{", ".join(names)}]', '-p', f'odom_on:={odom_on}']
    for name in names:
        pose = ', '.join(map(repr, map(float, MOUNTINGS[name].as_array())))
        words += ['-p', f'{name}.laser_pose:=[{pose}]']
    return words


def _figures(rounds):
    delays = 1e3 * np.concatenate([each.delays for each in rounds])
    p50, p99 = np.quantile(delays, (0.5, 0.99)) if len(delays) else (math.nan, math.nan)
    return {'lost_count': sum(each.lost for each in rounds), 'ms_p50': float(p50), 'ms_p99': float(p99),
            'core': float(np.median([each.core for each in rounds]))}
