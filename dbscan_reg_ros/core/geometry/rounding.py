# SPDX-License-Identifier: Apache-2.0
"""Numbers as texts."""


def fixed(value: float, digits: int) -> str:
    """Format a number with this many decimal places, never as -0."""
    return f'{round(float(value), digits) + 0.0:.{digits}f}'
