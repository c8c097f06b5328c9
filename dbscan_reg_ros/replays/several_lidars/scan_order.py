# SPDX-License-Identifier: Apache-2.0
"""Order and numbers of the scans of several lidars: those of all lidars are counted together, by their stamps."""
import heapq
from typing import NamedTuple

from ...core.scan import Scan


class OfLidar(NamedTuple):
    """A scan of one of several lidars.

    `lidar` is the number of the lidar, from 0 for the first, and `own` that of the scan among the scans of this lidar.
    """

    lidar: int
    own: int
    scan: Scan


def in_stamp_order(streams, first=0):
    """Yield each scan as `OfLidar`: the oldest of the next scans of all lidars, of equal stamps that of the first.

    Parameters
    ----------
    streams : list of iterable of Scan
        Scans of each lidar. Where stamps of one lidar go back, its scans keep their order.
    first : int
        Number of the first of these lidars.
    """
    return heapq.merge(*(_of_lidar(number, scans) for number, scans in enumerate(streams, first)),
                       key=lambda each: each.scan.stamp)


def _of_lidar(lidar, scans):
    return (OfLidar(lidar, own, scan) for own, scan in enumerate(scans))


class Found(NamedTuple):
    """Scans that `find_scans` found.

    Attributes
    ----------
    scans : dict
        Number of a wanted scan among those of all lidars -> `OfLidar`.
    around : list of dict
        For each lidar, the number of a scan among its own -> scan: the wanted scans and their neighbours.
    read : int
        Number of scans that were read.
    """

    scans: dict
    around: list
    read: int


def find_scans(streams, numbers) -> Found:
    """Read the scans of all lidars in the order of `in_stamp_order` until those with these `numbers` are found.

    The scans before and after each of them, of the same lidar, are returned as well.
    """
    found: dict[int, OfLidar] = {}
    last: dict[int, OfLidar] = {}
    around: list[dict[int, Scan]] = [{} for _ in streams]
    read = 0
    for number, each in enumerate(in_stamp_order(streams)):
        read, previous = number + 1, last.get(each.lidar)
        last[each.lidar] = each
        if number in numbers:
            found[number] = each
        if number in numbers or previous in found.values():
            around[each.lidar].update({one.own: one.scan for one in (previous, each) if one})
        if number > max(numbers) and all(one.own + 1 in around[one.lidar] for one in found.values()):
            break
    return Found(found, around, read)
