# SPDX-License-Identifier: Apache-2.0
"""Choices that rounding errors do not decide."""
import numpy as np

from .array_types import FloatArray, IntArray
from .tolerance import ROUNDING


def order_up_to_rounding(keys: FloatArray) -> IntArray:
    """Return the ascending order of the `keys` ``(N,)``.

    Keys that differ by rounding errors only count as equal, and are in the order of their indices: the last bit of a
    sum depends on the processor and the libraries.
    """
    order: IntArray = keys.argsort(kind='stable')
    ordered = keys[order]
    size = np.abs(ordered)
    apart = ordered[1:] - ordered[:-1] > ROUNDING * np.maximum(size[1:], size[:-1])
    return order if apart.all() else order[np.lexsort((order, np.concatenate(([0], apart.cumsum()))))]


def first_largest(values: FloatArray) -> IntArray:
    """Return the index, along the last axis, of the first value that is the largest up to rounding errors."""
    largest = values.max(axis=-1, keepdims=True)
    first: IntArray = (values >= largest - ROUNDING * np.abs(largest)).argmax(axis=-1)
    return first
