# SPDX-License-Identifier: Apache-2.0
"""Points of older key frames for the local map, as `core.odometry.mapping.local_map`."""


def newest_in_cell(const double complex[::1] points, const Py_ssize_t[::1] age_rank, const double complex[::1] latest,
                   double cell_size):
    """Return ``(P,)``: the `points` in whose cell no point has a higher rank, and none is one of the `latest`."""
    cdef Py_ssize_t size = points.shape[0], total = size + latest.shape[0], slots = 16, k, slot
    while slots < 2 * total:
        slots *= 2
    # An open hash table of cells: the key of each slot, and the highest rank seen there.
    cdef double[::1] key = np.empty(slots)
    cdef Py_ssize_t[::1] newest = np.full(slots, -1, np.intp), home = np.empty(max(size, 1), np.intp)
    kept = np.empty(size, dtype=bool)
    cdef unsigned char[::1] flag = kept
    cdef double row = local_map_steps._ROW
    with nogil:
        for k in range(latest.shape[0]):
            slot = slot_of(key, newest, rint(latest[k].real / cell_size) * row + rint(latest[k].imag / cell_size))
            newest[slot] = total
        for k in range(size):
            home[k] = slot = slot_of(key, newest,
                                     rint(points[k].real / cell_size) * row + rint(points[k].imag / cell_size))
            newest[slot] = max(newest[slot], age_rank[k])
        for k in range(size):
            flag[k] = age_rank[k] == newest[home[k]]
    return kept


cdef inline Py_ssize_t slot_of(double[::1] key, const Py_ssize_t[::1] newest, double cell) except -1 nogil:
    """Return the slot of a cell in a hash table with free slots, and claim a free one for it."""
    cdef Py_ssize_t mask = key.shape[0] - 1
    cdef Py_ssize_t slot = <Py_ssize_t> ((<unsigned long long> <long long> cell * 11400714819323198485ULL) >> 32) & mask
    while newest[slot] >= 0 and key[slot] != cell:
        slot = (slot + 1) & mask
    key[slot] = cell
    return slot
