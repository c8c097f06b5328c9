# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, scans that are played to it, and what both cost."""
import os
import sys
import tempfile
import time
from contextlib import contextmanager
from itertools import cycle, islice
from pathlib import Path

import numpy as np

from dbscan_reg_ros.core.scan import Scan

from ..trees import environment, root

WARM_UP = 2.0
"""Seconds that do not count: both sides get to know each other."""
SETTLED = 20.0
"""Memory is compared with that after so many seconds, when the window is full."""
PATIENCE = 30.0
"""A node that needs longer [s] will never be ready."""
SCRIPT = Path(__file__).with_name('timed_node.py')
ALONE = '-p', 'mounting:=none'
"""Arguments of the node for one lidar in the middle of the base."""


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


def numbers_of(message) -> list:
    """Return the numbers of an Odometry message, as `odometry_numbers` those of a state."""
    pose, twist = message.pose.pose, message.twist.twist
    p, q, v, w = pose.position, pose.orientation, twist.linear, twist.angular
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w, *message.pose.covariance, v.x, v.y, v.z, w.x, w.y, w.z,
            *message.twist.covariance]
