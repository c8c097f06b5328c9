# SPDX-License-Identifier: Apache-2.0
"""Stamps between decimal text and whole nanoseconds, without the detour through binary fractions."""
from decimal import Decimal

END_OF_TIME = 2**31 * 1_000_000_000
"""The first stamp that a ROS message cannot hold [ns]."""


def nanoseconds(text, first=0, end=END_OF_TIME) -> int:
    """Seconds in decimal, ``'976052857.337530'``, as nanoseconds.

    Parameters
    ----------
    text : str
    first, end : int
        The first that is taken and the first after those that are [ns]; what a message can hold, when not given.

    Raises
    ------
    ValueError
        When `text` is not a number, or not from `first` to `end`.
    """
    try:
        stamp = (Decimal(text) * 1_000_000_000).to_integral_value()
        possible = first <= stamp < end
    except (ArithmeticError, ValueError):
        raise ValueError(f'stamp {text!r} is no number of seconds') from None
    if not possible:
        raise ValueError(f'stamp {text} s is outside 0 to 2^31 s')
    return int(stamp)


def seconds(stamp) -> str:
    """Nanoseconds as seconds in decimal, with all nine decimals."""
    whole, rest = divmod(int(stamp), 1_000_000_000)
    return f'{whole}.{rest:09d}'
