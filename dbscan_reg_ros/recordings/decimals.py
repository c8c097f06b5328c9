"""Stamps between decimal text and whole nanoseconds, without the detour through binary fractions."""
from decimal import Decimal

END_OF_TIME = 2**31 * 1_000_000_000
"""The first stamp that a ROS message cannot hold [ns]."""


def nanoseconds(text) -> int:
    """Seconds in decimal, ``'976052857.337530'``, as nanoseconds.

    Raises
    ------
    ValueError
        When `text` is not a number, or a message cannot hold it.
    """
    try:
        stamp = (Decimal(text) * 1_000_000_000).to_integral_value()
        possible = 0 <= stamp < END_OF_TIME
    except (ArithmeticError, ValueError):
        raise ValueError(f'stamp {text!r} is no number of seconds') from None
    if not possible:
        raise ValueError(f'stamp {text} s is outside 0 to 2^31 s')
    return int(stamp)


def seconds(stamp) -> str:
    """Nanoseconds as seconds in decimal, with all nine decimals."""
    whole, rest = divmod(int(stamp), 1_000_000_000)
    return f'{whole}.{rest:09d}'
