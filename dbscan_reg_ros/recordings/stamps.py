# SPDX-License-Identifier: Apache-2.0
"""Stamps: from text and back without rounding, corrected, and replaced where they cannot be used."""
from decimal import Decimal
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..core.scan import SECOND

END_OF_TIME = 2**31 * SECOND
"""The first stamp that a ROS message cannot hold [ns]."""


def nanoseconds(text, first=0, end=END_OF_TIME) -> int:
    """Convert decimal seconds, such as ``'976052857.337530'``, to nanoseconds.

    Raises a ValueError when `text` is not a number, or the stamp is not at least `first` and less than `end` [ns]: by
    default those that a ROS message can hold.
    """
    try:
        stamp = (Decimal(text) * SECOND).to_integral_value()
        possible = first <= stamp < end
    except (ArithmeticError, ValueError):
        raise ValueError(f'stamp {text!r:.60} is no number of seconds') from None
    if not possible:
        raise ValueError(f'stamp {text:.60} s is outside {first // SECOND} to {end // SECOND} s: expected seconds')
    return int(stamp)


def to_float(text) -> float:
    """Convert text to a number, possibly infinite or not a number; raise ValueError if `text` is none."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(f'{text!r:.60} is not a number') from None


def seconds(stamp) -> str:
    """Format a stamp [ns] as decimal seconds with all nine decimals."""
    whole, rest = divmod(int(stamp), SECOND)
    return f'{whole}.{rest:09d}'


APART = SECOND // 10_000
"""Stamps that differ by less than this [ns] are regarded as equal: no lidar is that fast."""
STEADY = SECOND
"""Assumed interval of scans whose stamps cannot be used [ns]."""
START = SECOND
"""First stamp of scans whose stamps are shifted [ns]; not 0, which means that there is no stamp."""
WRAPS = {'s': 2**32 * SECOND, 'ms': 2**32 * SECOND // 1000, 'us': 2**32 * SECOND // 1_000_000}
"""Unit of a 32-bit counter -> time after which the counter starts at 0 again [ns]."""
NEAR = 0.1
"""A counter wraps when it steps from the last to the first tenth (this fraction) of its range, or back."""


class Mended(NamedTuple):
    """Stamps that can be used."""

    stamps: list
    """list of int (N,): stamps [ns], each within the limits of a ROS message."""
    note: str
    """Corrections that were made, in one line; empty if the stamps were not changed."""


def mend(stamps) -> Mended:
    """Correct the stamps of the scans in a file, or replace them if they cannot be used.

    Counters of 32 bits that start at 0 again are unwrapped; stamps that are negative, or too large for a ROS message,
    are shifted. If fewer than half of the stamps are later than the one before, for example if all are equal,
    or if they span more than a ROS message can hold, they cannot be used: the scans are assumed to be `STEADY` apart.

    Parameters
    ----------
    stamps : sequence of int (N,)
        Stamps [ns] in the order of the scans; integers of any size.
    """
    given = [int(stamp) for stamp in stamps]
    unwrapped, wraps = _unwrap(given)
    notes = [f'stamps start at 0 again after 2^32 {unit}: unwrapped' for unit in wraps]
    increasing = usable(unwrapped)
    if not increasing or max(unwrapped, default=0) - min(unwrapped, default=0) >= END_OF_TIME - START:
        reason = 'they span 68 years or more' if increasing else 'fewer than half are later than the one before'
        first = given[0] if 0 < given[0] < END_OF_TIME - len(given) * STEADY else START
        return Mended([first + number * STEADY for number in range(len(given))],
                      f'stamps are of no use ({reason}): scans are assumed to be {STEADY / SECOND:g} s apart')
    first = min(unwrapped, default=0)
    if first < 0 or max(unwrapped, default=0) >= END_OF_TIME:
        unwrapped = [stamp - first + START for stamp in unwrapped]
        notes.append(f'stamps from {first / SECOND:.3f} s on are shifted to start at {START / SECOND:g} s')
    return Mended(unwrapped, '; '.join(notes))


def equal(before, after) -> bool:
    """Whether two successive stamps of scans [ns] are regarded as equal."""
    return 0 <= after - before < APART


def usable(stamps) -> bool:
    """Whether at least half of the stamps ``(N,)`` [ns] are later than the previous one; true for a single stamp."""
    later = sum(b > a for a, b in pairwise(stamps))
    return 2 * later >= len(stamps) - 1


def _unwrap(stamps):
    """Return the stamps with 32-bit counters unwrapped, and the units of the counters that started at 0 again."""
    found = []
    for unit, wrap in WRAPS.items():
        if not stamps or not (1 - NEAR) * wrap < max(stamps) < (1 + NEAR) * wrap:
            continue
        share = np.array(stamps, dtype=float) / wrap
        low, high = share < NEAR, share > 1 - NEAR
        turns = np.cumsum(np.concatenate(([0], (high[:-1] & low[1:]).astype(int) - (low[:-1] & high[1:]).astype(int))))
        if turns.any():
            found.append(unit)
            stamps = [stamp + turn * wrap for stamp, turn in zip(stamps, turns.tolist(), strict=True)]
    return stamps, found
