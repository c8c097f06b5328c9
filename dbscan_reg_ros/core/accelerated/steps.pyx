# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Compiled steps: same names, arguments and results as the functions of the numpy reference.

Arrays come in and go out; loops run over typed views, without the interpreter. Every index is checked.
"""
import numpy as np

from libc.math cimport atan2, cos, exp, fabs, hypot, sin, sqrt

from ..registration.point_to_line import Fit

cdef extern from *:
    """
    #ifndef DBSCAN_REG_SOURCE_HASH
    #define DBSCAN_REG_SOURCE_HASH "unknown"
    #endif
    """
    const char *DBSCAN_REG_SOURCE_HASH

SOURCE_HASH = DBSCAN_REG_SOURCE_HASH.decode()
"""Hash of the sources that this was built from."""

include "registration/lookup.pxi"
include "registration/point_to_line.pxi"

STEPS = ('fit', 'refine')
"""Names of the steps."""
