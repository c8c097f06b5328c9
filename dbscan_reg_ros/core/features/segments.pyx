# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Line segments of a scan: split and join instead of Eq. 6, fits (Eq. 7); corners and other ends (section 2.2)."""
import numpy as np

from ..geometry import tolerance
from ..geometry.ties import order_up_to_rounding

from libc.math cimport atan2, fabs, sqrt
from libc.stdlib cimport free, malloc

from ..geometry.plane cimport (Line, Moments, cross, difference, distance, dot, fit_line, length_of, modulus,
                               vector)
from .records cimport KIND_CORNER, KIND_FREE, KIND_OCCLUSION, Segments
from .surfaces cimport DEPTH_MARGIN, Surfaces

cdef double TINY = tolerance.TINY, SAME = tolerance.SAME, SIGMAS = tolerance.SIGMAS

# A surface is split where it is farther than this from its chord [m], beyond the noise: less than that is no bend that
# a second line would fit better. So many times all pieces are split in two; eight corners of a room take three.
cdef double SPLIT_DISTANCE = 0.03
cdef Py_ssize_t SPLIT_LEVELS = 6
# Neighbouring pieces are joined if the residual of one line through both is below this multiple of the noise, unless
# they are farther apart than this [m], the width of a door.
cdef double JOIN_NOISE = 2.5, JOIN_GAP = 1.0
# Minimum number of steps from the first to the last point of a piece; passes in which neighbours are joined.
cdef Py_ssize_t MIN_STEPS = 2, JOINS = 2
# Largest number of segments: the pairs of two scans take time and memory. No course has as many.
cdef Py_ssize_t MAX_SEGMENTS = 100
# Two segments can meet in a corner only if the second starts at most this many points after the end of the first, and
# the sine of the angle between them is at least this.
cdef Py_ssize_t MAX_CORNER_POINTS = 3
cdef double MIN_CORNER_SINE = 0.3
# Root mean square distance from the line, as a fraction of the length, above which a segment is dropped.
cdef double MAX_BEND = 0.15
# Neighbouring pieces are joined up to this angle [rad]: base value, growth with noise / length, upper limit.
cdef double JOIN_ANGLE = 0.05, JOIN_ANGLE_NOISE = 6.0, MAX_JOIN_ANGLE = 0.25


cdef enum:
    # First point of a piece; of one that is not split further.
    EDGE = 1
    LAST_EDGE = 2


cdef struct Piece:
    # First and last point, number of points, summed moments, line; ends on it and direction from start to end.
    Py_ssize_t first
    Py_ssize_t last
    double size
    Moments sums
    Line line
    double complex start
    double complex end
    double complex along
    # Whether it continues the line of the piece before; whether it meets the next in a corner, and where.
    bint continues
    bint meets
    double complex corner


cdef Segments extract_segments(const Surfaces *surfaces, const double *noise, parameters):
    """Extract the line segments of one scan, in beam order.

    Parameters
    ----------
    surfaces : Surfaces
        The P points.
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters
    """
    cdef Py_ssize_t size = surfaces.size, count
    cdef unsigned char[::1] edges = np.zeros(size + 1, np.uint8)
    cdef Piece *pieces = <Piece *> malloc((size + 1) * sizeof(Piece))
    if pieces == NULL:
        raise MemoryError
    try:
        split(surfaces, noise, &edges[0])
        count = join(surfaces, noise, &edges[0], pieces)
        count = place_ends(surfaces, parameters.min_points, parameters.min_length, pieces, count)
        count = keep_longest(pieces, count)
        find_corners(surfaces, pieces, count)
        return make_segments(surfaces, noise, pieces, count)
    finally:
        free(pieces)


cdef void split(const Surfaces *surfaces, const double *noise, unsigned char *edges) noexcept nogil:
    """Flag the first point of each piece: surfaces are split level by level, farthest from their chords."""
    cdef const double *x = surfaces.x
    cdef const double *y = surfaces.y
    cdef double *area = surfaces.work
    cdef Py_ssize_t size = surfaces.size, first, end, k, level
    cdef double largest, length, dx, dy, x0, y0
    cdef bint found
    edges[0] = edges[size] = EDGE
    for k in range(size - 1):
        edges[k + 1] = EDGE if surfaces.breaks[k] else 0
    for level in range(SPLIT_LEVELS):
        first, found = 0, False
        while first < size:
            end = first + 1
            while not edges[end]:
                end += 1
            if edges[first] == EDGE:
                x0, y0, dx, dy, largest = x[first], y[first], x[end - 1] - x[first], y[end - 1] - y[first], 0.0
                length = length_of(dx, dy)
                # Distances from the chord beyond the limit, times the length of the chord.
                for k in range(first, end):
                    area[k] = (fabs(dx * (y[k] - y0) - dy * (x[k] - x0))
                               - max(SIGMAS * noise[k] + SPLIT_DISTANCE, TINY) * length)
                for k in range(first, end):
                    largest = max(largest, area[k])
                edges[first] = EDGE if largest > 0.0 else LAST_EDGE
                k = first
                while largest > 0.0:
                    # Of several the first.
                    if area[k] >= largest - TINY:
                        edges[k + 1] = EDGE
                        found = True
                        break
                    k += 1
            first = end
        if not found:
            break


cdef Py_ssize_t join(const Surfaces *surfaces, const double *noise, const unsigned char *edges,
                     Piece *pieces) noexcept nogil:
    """Make the pieces between the edges, and join neighbours on one line; return the number of pieces."""
    cdef Py_ssize_t count = 0, first = 0, end, k, joined, turn
    while first < surfaces.size:
        end = first + 1
        while not edges[end]:
            end += 1
        if end - 1 - first >= MIN_STEPS:
            pieces[count].first, pieces[count].last, pieces[count].size = first, end - 1, end - first
            pieces[count].sums = difference(&surfaces.moments[end], &surfaces.moments[first])
            fit_piece(&pieces[count])
            count += 1
        first = end
    for turn in range(JOINS):
        joined = 0
        for k in range(1, count):
            pieces[k].continues = on_one_line(surfaces, noise, &pieces[k - 1], &pieces[k])
            joined += pieces[k].continues
        if not joined:
            break
        joined = 0
        for k in range(count):
            if k and pieces[k].continues:
                append(&pieces[joined - 1], &pieces[k])
            else:
                pieces[joined] = pieces[k]
                joined += 1
        count = joined
        for k in range(count):
            fit_piece(&pieces[k])
    return count


cdef inline void fit_piece(Piece *piece) noexcept nogil:
    """Fit the line of a piece to all its points (Eq. 7)."""
    piece.line = fit_line(piece.sums, piece.size)


cdef inline void append(Piece *piece, Piece *other) noexcept nogil:
    """Append the points of the next piece."""
    cdef Moments *sums = &piece.sums
    piece.last = other.last
    piece.size += other.size
    sums.x, sums.y, sums.xx = sums.x + other.sums.x, sums.y + other.sums.y, sums.xx + other.sums.xx
    sums.xy, sums.yy = sums.xy + other.sums.xy, sums.yy + other.sums.yy


cdef inline double complex point_of(const Surfaces *surfaces, Py_ssize_t k) noexcept nogil:
    """Return a point."""
    return vector(surfaces.x[k], surfaces.y[k])


cdef bint on_one_line(const Surfaces *surfaces, const double *noise, Piece *a, Piece *b) noexcept nogil:
    """Return whether a piece and the next are parts of one line."""
    cdef double complex start = point_of(surfaces, b.first), end = point_of(surfaces, a.last)
    cdef double complex reach_a = end - point_of(surfaces, a.first), reach_b = point_of(surfaces, b.last) - start
    cdef double shorter = min(modulus(reach_a), modulus(reach_b)), sigma = max(noise[a.last], noise[b.first])
    cdef double sine = a.line.c * b.line.s - a.line.s * b.line.c, cosine = a.line.c * b.line.c + a.line.s * b.line.s
    cdef double tolerance = JOIN_ANGLE + JOIN_ANGLE_NOISE * sigma / max(shorter, TINY)
    cdef Piece both
    if not (distance(start, end) < JOIN_GAP and dot(reach_b, reach_a) > 0.0):
        return False
    both = a[0]
    append(&both, b)
    fit_piece(&both)
    return (both.line.residual < (JOIN_NOISE * sigma) * (JOIN_NOISE * sigma)
            and atan2(fabs(sine), fabs(cosine)) < min(MAX_JOIN_ANGLE, tolerance))


cdef Py_ssize_t place_ends(const Surfaces *surfaces, double min_points, double min_length, Piece *pieces,
                           Py_ssize_t count) noexcept nogil:
    """Place the ends of the pieces on their lines; drop those with too few points, too short or bent ones."""
    cdef Py_ssize_t k, kept = 0
    cdef double complex centre, along, first, last
    cdef double length
    for k in range(count):
        first, last = point_of(surfaces, pieces[k].first), point_of(surfaces, pieces[k].last)
        centre = pieces[k].line.x + 1j * pieces[k].line.y
        along = pieces[k].line.c + 1j * pieces[k].line.s
        if dot(last - first, along) < 0.0:
            along = -along
        pieces[k].along = along
        pieces[k].start = centre + along * dot(first - centre, along)
        pieces[k].end = centre + along * dot(last - centre, along)
        length = distance(pieces[k].end, pieces[k].start)
        if (pieces[k].size >= min_points and length >= min_length
                and pieces[k].line.residual < (MAX_BEND * length) * (MAX_BEND * length)):
            pieces[kept] = pieces[k]
            kept += 1
    return kept


cdef Py_ssize_t keep_longest(Piece *pieces, Py_ssize_t count) except -1:
    """Keep the longest pieces, at most `MAX_SEGMENTS`, in beam order; return their number."""
    cdef Py_ssize_t k
    if count <= MAX_SEGMENTS:
        return count
    lengths = np.array([distance(pieces[k].end, pieces[k].start) for k in range(count)])
    for k, chosen in enumerate(np.sort(order_up_to_rounding(-lengths)[:MAX_SEGMENTS]).tolist()):
        pieces[k] = pieces[<Py_ssize_t> chosen]
    return MAX_SEGMENTS


cdef void find_corners(const Surfaces *surfaces, Piece *pieces, Py_ssize_t count) noexcept nogil:
    """Find where a segment and the next meet in a corner, and move their ends there."""
    cdef Py_ssize_t k, at
    cdef double sine, beyond, reach, half
    for k in range(count - 1):
        pieces[k].meets = False
        sine = cross(pieces[k].along, pieces[k + 1].along)
        if fabs(sine) < MIN_CORNER_SINE or pieces[k + 1].first - pieces[k].last > MAX_CORNER_POINTS:
            continue
        beyond = cross(pieces[k + 1].start - pieces[k].end, pieces[k + 1].along) / sine
        pieces[k].corner = pieces[k].end + beyond * pieces[k].along
        reach = SAME + distance(point_of(surfaces, pieces[k + 1].first), point_of(surfaces, pieces[k].last))
        half = 0.5 * distance(pieces[k + 1].end, pieces[k + 1].start)
        pieces[k].meets = (fabs(beyond) < reach and beyond > -0.5 * distance(pieces[k].end, pieces[k].start)
                            and distance(pieces[k + 1].start, pieces[k].corner) < min(reach, half))
        for at in range(pieces[k].last, pieces[k + 1].first):
            if surfaces.breaks[at]:
                pieces[k].meets = False
    for k in range(count - 1):
        if pieces[k].meets:
            pieces[k].end = pieces[k + 1].start = pieces[k].corner


cdef Segments make_segments(const Surfaces *surfaces, const double *noise, Piece *pieces, Py_ssize_t count):
    """Return the `Segments` of the pieces; an end beside free space is free."""
    places, numbers, integers = np.empty((2, count, 2)), np.empty((4, count)), np.empty((2, count, 2), np.intp)
    cdef double[:, ::1] start = places[0], end = places[1], number = numbers
    cdef Py_ssize_t[:, ::1] kind = integers[0], beam = integers[1]
    cdef const double *radius = surfaces.radius
    cdef Py_ssize_t k, first, last
    cdef double sigma
    for k in range(count):
        first, last = pieces[k].first, pieces[k].last
        start[k, 0], start[k, 1] = pieces[k].start.real, pieces[k].start.imag
        end[k, 0], end[k, 1] = pieces[k].end.real, pieces[k].end.imag
        beam[k, 0], beam[k, 1] = surfaces.beam[first], surfaces.beam[last]
        kind[k, 0] = kind[k, 1] = KIND_OCCLUSION
        if first and radius[first - 1] > radius[first] + (DEPTH_MARGIN + SIGMAS * noise[first]):
            kind[k, 0] = KIND_FREE
        if last + 1 < surfaces.size and radius[last + 1] > radius[last] + (DEPTH_MARGIN + SIGMAS * noise[last]):
            kind[k, 1] = KIND_FREE
        if k and pieces[k - 1].meets:
            kind[k, 0] = KIND_CORNER
        if k + 1 < count and pieces[k].meets:
            kind[k, 1] = KIND_CORNER
        sigma = 0.5 * (noise[first] + noise[last])
        sigma = sqrt(sigma * sigma + pieces[k].line.residual)
        number[0, k] = atan2(pieces[k].along.imag, pieces[k].along.real)
        number[1, k] = distance(pieces[k].end, pieces[k].start)
        number[2, k] = sigma / sqrt(max(pieces[k].size * pieces[k].line.spread, TINY))
        number[3, k] = sigma / sqrt(pieces[k].size)
    return Segments(places[0], places[1], numbers[0], numbers[1], numbers[2], numbers[3], integers[0], integers[1])
