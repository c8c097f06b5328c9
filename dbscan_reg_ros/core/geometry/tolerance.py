# SPDX-License-Identifier: Apache-2.0
"""Tolerances that do not depend on the sensor or the building, and choices that rounding errors do not decide."""
import numpy as np

from .array_types import FloatArray, IntArray

TINY = 1e-9
"""Sums, lengths and ratios below this are rounding errors; divisors are at least this."""
ROUNDING = 1e-11
"""Largest relative difference of two equal sums or weights that rounding errors explain."""
RESOLUTION = 0.001
"""Length [m] and angle [rad] that no lidar resolves: the lower limit of kernel scales and standard deviations."""
SAME = 0.1
"""Distance [m] and angle [rad] below which two lines, ends of lines or motions count as the same."""
SIGMAS = 3.0
"""Number of standard deviations that noise rarely exceeds."""


def order_up_to_rounding(keys: FloatArray, group: IntArray | None = None) -> IntArray:
    """Return the ascending order of the `keys` ``(N,)``, of each `group` ``(N,)`` in turn.

    Keys that differ by rounding errors only count as equal, and are in the order of their indices: the last bit of a
    sum depends on the processor and the libraries.
    """
    order: IntArray = keys.argsort(kind='stable') if group is None else np.lexsort((keys, group))
    ordered = keys[order]
    size = np.abs(ordered)
    apart = ordered[1:] - ordered[:-1] > ROUNDING * np.maximum(size[1:], size[:-1])
    if group is not None:
        apart |= group[order[1:]] != group[order[:-1]]
    return order if apart.all() else order[np.lexsort((order, np.concatenate(([0], apart.cumsum()))))]


def first_largest(values: FloatArray) -> IntArray:
    """Return the index, along the last axis, of the first value that is the largest up to rounding errors."""
    largest = values.max(axis=-1, keepdims=True)
    first: IntArray = (values >= largest - ROUNDING * np.abs(largest)).argmax(axis=-1)
    return first
