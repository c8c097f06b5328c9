# SPDX-License-Identifier: Apache-2.0
"""What the C library does with memory that is freed."""
import ctypes
import os
from contextlib import suppress

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""glibc's numbers of the two settings (mallopt(3))."""
KEPT = 16 << 20
"""Maximum size of the freed memory that is kept [bytes]."""
LARGE = 1 << 20
"""Arrays of at least this size [bytes] are returned to the system at once."""


def keep_freed_memory():
    """Have glibc keep what one scan frees for the next.

    By default it returns the free end of its heap to the system from 128 KiB on, and the arrays of every scan cause
    page faults again: a sixth of the odometry's time. Nothing happens with another C library, or if the environment
    configures the allocator (``MALLOC_...``, ``GLIBC_TUNABLES``).
    """
    if any(name.startswith(('MALLOC_', 'GLIBC_TUNABLES')) for name in os.environ):
        return
    with suppress(AttributeError, OSError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(TRIM_THRESHOLD, KEPT)
        mallopt(MMAP_THRESHOLD, LARGE)
