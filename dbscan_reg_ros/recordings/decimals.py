# SPDX-License-Identifier: Apache-2.0
"""Conversion of text to numbers, and of stamps to whole nanoseconds without rounding to binary fractions."""
from decimal import Decimal

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
