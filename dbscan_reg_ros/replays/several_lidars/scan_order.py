# SPDX-License-Identifier: Apache-2.0
"""Scans of a recording by their numbers among the scans of all lidars."""
from typing import NamedTuple

from ...core.scan import Scan
from ...robot.scan_buffer import OfLidar, RecordedScans


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
    """Read the scans of all lidars in the order of `RecordedScans` until those with these `numbers` are found.

    The scans before and after each of them, of the same lidar, are returned as well.
    """
    found: dict[int, OfLidar] = {}
    last: dict[int, OfLidar] = {}
    around: list[dict[int, Scan]] = [{} for _ in streams]
    read = 0
    for number, each in enumerate(RecordedScans(streams).before()):
        read, previous = number + 1, last.get(each.lidar)
        last[each.lidar] = each
        if number in numbers:
            found[number] = each
        if number in numbers or previous in found.values():
            around[each.lidar].update({one.own: one.scan for one in (previous, each) if one})
        if number > max(numbers) and all(one.own + 1 in around[one.lidar] for one in found.values()):
            break
    return Found(found, around, read)
