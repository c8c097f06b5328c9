# SPDX-License-Identifier: Apache-2.0
"""Drives of a base with two lidars at opposite corners."""
import heapq
import math

import numpy as np

from dbscan_reg_ros.commands.simulate import main as simulate_command
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

FRONT, REAR = SE2(0.35, 0.25, math.radians(45.0)), SE2(-0.35, -0.25, math.radians(-135.0))


def drive_of_two_lidars():
    """Return the scans of both lidars in the order of their stamps, and a function of a stamp: the pose of the base."""
    world = rooms(1)
    path = follow(world.tour[:2], speed=1.0)
    front, rear = (simulate(world, path, Lidar(361, math.radians(-135.0), math.radians(0.75), 0.05, 25.0, rate,
                                               mounting=mounting, phase=phase, frame_id=frame), 1)
                   for frame, mounting, rate, phase in (('front', FRONT, 12.5, 0.0), ('rear', REAR, 15.0, 0.019)))
    scans = list(heapq.merge(front.scans, rear.scans, key=lambda scan: scan.stamp))
    return scans, lambda stamp: SE2.from_array(path.poses_at(np.array([1e-9 * (stamp - scans[0].stamp)]))[0])


def bag_of_two_lidars(bag, *words):
    """Write a bag of lidars at (0.3, 0.2, 45) and (-0.3, -0.2, -135) [m, m, deg], 12.5 and 15 Hz, in a corridor."""
    scanner = ('--lidar hokuyo_utm30lx --beams 361 --angle-increment 0.75 --duration 0.05 --at {} --rate {} '
               '--phase {}')
    front, rear = scanner.format('0.3 0.2 45', 12.5, 0.0), scanner.format('-0.3 -0.2 -135', 15, 0.019)
    assert simulate_command([str(bag), '--world', 'corridor', *front.split(), *rear.split(), *words]) == 0
    return bag
