# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
from .records cimport Features


cpdef Features with_poles(Features features, double size, parameters)
