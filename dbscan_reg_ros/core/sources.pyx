# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""The sources that the compiled modules were built from."""

cdef extern from *:
    """
    #ifndef DBSCAN_REG_SOURCE_HASH
    #define DBSCAN_REG_SOURCE_HASH "unknown"
    #endif
    """
    const char *DBSCAN_REG_SOURCE_HASH

SOURCE_HASH = DBSCAN_REG_SOURCE_HASH.decode()
"""Hash of the sources, as `build.source_hash`."""
