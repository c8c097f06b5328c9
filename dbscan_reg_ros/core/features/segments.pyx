# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Line segments of a scan: split and join instead of Eq. 6, fits (Eq. 7) and the kinds of their ends (section 2.2)."""
import numpy as np

from ..geometry import tolerance
from ..geometry.ties import order_up_to_rounding

from libc.math cimport atan2, fabs, sqrt
from libc.stdlib cimport free, malloc

from ..geometry.plane cimport Line, cross, distance, dot, fit_line, modulus
from .records cimport KIND_CORNER, KIND_FREE, KIND_OCCLUSION, Segments

cdef double TINY = tolerance.TINY, SAME = tolerance.SAME, SIGMAS = tolerance.SIGMAS

# Minimum number of steps from the first to the last point of a piece; passes in which neighbours are joined.
cdef Py_ssize_t MIN_STEPS = 2, JOINS = 2
# Two segments can meet in a corner only if the second starts at most this many points after the end of the first, and
# the sine of the angle between them is at least this.
cdef Py_ssize_t MAX_CORNER_POINTS = 3
cdef double MIN_CORNER_SINE = 0.3
# Root mean square distance from the line, as a fraction of the length, above which a segment is dropped.
cdef double MAX_BEND = 0.15
# Neighbouring pieces are joined up to this angle [rad]: base value, growth with noise / length, upper limit.
cdef double JOIN_ANGLE = 0.05, JOIN_ANGLE_NOISE = 6.0, MAX_JOIN_ANGLE = 0.25


cdef struct Piece:
    # First and last point, number of points, summed moments, line; ends on it and direction from start to end.
    Py_ssize_t first
    Py_ssize_t last
    double size
    double[5] moments
    Line line
    double complex start
    double complex end
    double complex along
    # Whether it is joined to the piece before, or meets the next in a corner, there.
    bint joined
    double complex meeting


cdef struct SegmentLimits:
    double split_distance, join_noise, join_gap, depth_margin, min_points, min_length
    Py_ssize_t split_levels


cdef SegmentLimits segment_limits(p) except *:
    """Return the `SegmentParameters` as numbers."""
    return SegmentLimits(p.split_distance, p.join_noise, p.join_gap, p.depth_margin, p.min_points, p.min_length,
                         p.split_levels)


cdef Segments extract_segments(const double complex[::1] points, const unsigned char[::1] breaks,
                               const double[:, ::1] moments, const double[::1] radius, const Py_ssize_t[::1] beams,
                               const double[::1] noise, parameters):
    """Extract the line segments of one scan, in beam order.

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    breaks : (P - 1,) bool
        As from `surfaces.find_breaks`.
    moments : (5, P + 1) float
        Sums of x, y, xx, xy, yy before each point.
    radius : (P,) float
        Range of each point [m].
    beams : (P,) int
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters
    """
    cdef SegmentLimits limits = segment_limits(parameters)
    cdef Py_ssize_t size = points.shape[0], count
    if moments.shape[0] != 5 or moments.shape[1] != size + 1:
        raise IndexError('moments of another number of points')
    cdef unsigned char[::1] edges = np.zeros(size + 1, np.uint8)
    cdef Piece *pieces = <Piece *> malloc((size + 1) * sizeof(Piece))
    if pieces == NULL:
        raise MemoryError
    try:
        with nogil:
            split(points, breaks, noise, &limits, edges)
            count = join(points, moments, noise, &limits, edges, pieces)
            count = place_ends(points, &limits, pieces, count)
        count = keep_longest(pieces, count, parameters.max_segments)
        with nogil:
            find_corners(points, breaks, &limits, pieces, count)
        return make_segments(pieces, count, radius, noise, beams, limits.depth_margin)
    finally:
        free(pieces)


cdef int split(const double complex[::1] points, const unsigned char[::1] breaks, const double[::1] noise,
               SegmentLimits *limits, unsigned char[::1] edges) except -1 nogil:
    """Flag the first point of each piece: surfaces are split level by level, farthest from their chords."""
    cdef Py_ssize_t size = points.shape[0], first, end, k, level
    cdef double largest, length, area
    cdef double complex chord
    cdef bint found
    edges[0] = edges[size] = True
    for k in range(size - 1):
        edges[k + 1] = breaks[k]
    for level in range(limits.split_levels):
        first, found = 0, False
        while first < size:
            end = first + 1
            while not edges[end]:
                end += 1
            chord, largest = points[end - 1] - points[first], 0.0
            length = modulus(chord)
            for k in range(first, end):
                area = beyond_chord(points[k] - points[first], chord, length, split_distance(noise[k], limits))
                largest = max(largest, area)
            if largest > 0.0:
                for k in range(first, end):
                    area = beyond_chord(points[k] - points[first], chord, length, split_distance(noise[k], limits))
                    # Of several the first.
                    if area >= largest - TINY:
                        edges[k + 1] = found = True
                        break
            first = end
        if not found:
            break
    return 0


cdef inline double split_distance(double noise, SegmentLimits *limits) noexcept nogil:
    """Return the distance from the chord [m] beyond which a point becomes a corner."""
    return max(SIGMAS * noise + limits.split_distance, TINY)


cdef inline double beyond_chord(double complex offset, double complex chord, double length,
                                double limit) noexcept nogil:
    """Return the distance from the chord beyond the limit, times the length of the chord."""
    return fabs(cross(chord, offset)) - limit * length


cdef Py_ssize_t join(const double complex[::1] points, const double[:, ::1] moments, const double[::1] noise,
                     SegmentLimits *limits, const unsigned char[::1] edges, Piece *pieces) except -1 nogil:
    """Make the pieces between the edges, and join neighbours on one line; return the number of pieces."""
    cdef Py_ssize_t count = 0, first = 0, end, k, row, joined, turn
    while first < points.shape[0]:
        end = first + 1
        while not edges[end]:
            end += 1
        if end - 1 - first >= MIN_STEPS:
            pieces[count].first, pieces[count].last, pieces[count].size = first, end - 1, end - first
            for row in range(5):
                pieces[count].moments[row] = moments[row, end] - moments[row, first]
            fit_piece(&pieces[count])
            count += 1
        first = end
    for turn in range(JOINS):
        joined = 0
        for k in range(1, count):
            pieces[k].joined = on_one_line(points, noise, limits, &pieces[k - 1], &pieces[k])
            joined += pieces[k].joined
        if not joined:
            break
        joined = 0
        for k in range(count):
            if k and pieces[k].joined:
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
    cdef double *m = piece.moments
    piece.line = fit_line(m[0], m[1], m[2], m[3], m[4], piece.size)


cdef inline void append(Piece *piece, Piece *other) noexcept nogil:
    """Append the points of the next piece."""
    cdef Py_ssize_t row
    piece.last = other.last
    piece.size += other.size
    for row in range(5):
        piece.moments[row] += other.moments[row]


cdef bint on_one_line(const double complex[::1] points, const double[::1] noise, SegmentLimits *limits,
                      Piece *a, Piece *b) except -1 nogil:
    """Return whether a piece and the next are parts of one line."""
    cdef double complex reach_a = points[a.last] - points[a.first], reach_b = points[b.last] - points[b.first]
    cdef double shorter = min(modulus(reach_a), modulus(reach_b)), sigma = max(noise[a.last], noise[b.first])
    cdef double sine = a.line.c * b.line.s - a.line.s * b.line.c, cosine = a.line.c * b.line.c + a.line.s * b.line.s
    cdef double tolerance = JOIN_ANGLE + JOIN_ANGLE_NOISE * sigma / max(shorter, TINY)
    cdef Piece both = a[0]
    append(&both, b)
    fit_piece(&both)
    return (both.line.residual < (limits.join_noise * sigma) * (limits.join_noise * sigma)
            and distance(points[b.first], points[a.last]) < limits.join_gap
            and dot(reach_b, reach_a) > 0.0
            and atan2(fabs(sine), fabs(cosine)) < min(MAX_JOIN_ANGLE, tolerance))


cdef Py_ssize_t place_ends(const double complex[::1] points, SegmentLimits *limits, Piece *pieces,
                           Py_ssize_t count) except -1 nogil:
    """Place the ends of the pieces on their lines; drop those with too few points, too short or bent ones."""
    cdef Py_ssize_t k, kept = 0
    cdef double complex centre, along
    cdef double length
    for k in range(count):
        centre = pieces[k].line.x + 1j * pieces[k].line.y
        along = pieces[k].line.c + 1j * pieces[k].line.s
        if dot(points[pieces[k].last] - points[pieces[k].first], along) < 0.0:
            along = -along
        pieces[k].along = along
        pieces[k].start = centre + along * dot(points[pieces[k].first] - centre, along)
        pieces[k].end = centre + along * dot(points[pieces[k].last] - centre, along)
        length = distance(pieces[k].end, pieces[k].start)
        if (pieces[k].size >= limits.min_points and length >= limits.min_length
                and pieces[k].line.residual < (MAX_BEND * length) * (MAX_BEND * length)):
            pieces[kept] = pieces[k]
            kept += 1
    return kept


cdef Py_ssize_t keep_longest(Piece *pieces, Py_ssize_t count, Py_ssize_t most) except -1:
    """Keep the longest pieces, at most `max_segments`, in beam order; return their number."""
    cdef Py_ssize_t k
    if count <= most:
        return count
    lengths = np.array([distance(pieces[k].end, pieces[k].start) for k in range(count)])
    for k, chosen in enumerate(np.sort(order_up_to_rounding(-lengths)[:most]).tolist()):
        pieces[k] = pieces[<Py_ssize_t> chosen]
    return most


cdef int find_corners(const double complex[::1] points, const unsigned char[::1] breaks, SegmentLimits *limits,
                      Piece *pieces, Py_ssize_t count) except -1 nogil:
    """Find where a segment and the next meet in a corner, and move their ends there."""
    cdef Py_ssize_t k, at
    cdef double sine, beyond, reach, half
    for k in range(count - 1):
        pieces[k].joined = False
        sine = cross(pieces[k].along, pieces[k + 1].along)
        if fabs(sine) < MIN_CORNER_SINE or pieces[k + 1].first - pieces[k].last > MAX_CORNER_POINTS:
            continue
        beyond = cross(pieces[k + 1].start - pieces[k].end, pieces[k + 1].along) / sine
        pieces[k].meeting = pieces[k].end + beyond * pieces[k].along
        reach = SAME + distance(points[pieces[k + 1].first], points[pieces[k].last])
        half = 0.5 * distance(pieces[k + 1].end, pieces[k + 1].start)
        pieces[k].joined = (fabs(beyond) < reach and beyond > -0.5 * distance(pieces[k].end, pieces[k].start)
                            and distance(pieces[k + 1].start, pieces[k].meeting) < min(reach, half))
        for at in range(pieces[k].last, pieces[k + 1].first):
            if breaks[at]:
                pieces[k].joined = False
    for k in range(count - 1):
        if pieces[k].joined:
            pieces[k].end = pieces[k + 1].start = pieces[k].meeting
    return 0


cdef Segments make_segments(Piece *pieces, Py_ssize_t count, const double[::1] radius, const double[::1] noise,
                            const Py_ssize_t[::1] beams, double depth_margin):
    """Return the `Segments` of the pieces; an end beside free space is free."""
    places, numbers, integers = np.empty((2, count, 2)), np.empty((4, count)), np.empty((2, count, 2), np.intp)
    cdef double[:, ::1] start = places[0], end = places[1], number = numbers
    cdef Py_ssize_t[:, ::1] kind = integers[0], beam = integers[1]
    cdef Py_ssize_t k, first, last
    cdef double sigma
    for k in range(count):
        first, last = pieces[k].first, pieces[k].last
        start[k, 0], start[k, 1] = pieces[k].start.real, pieces[k].start.imag
        end[k, 0], end[k, 1] = pieces[k].end.real, pieces[k].end.imag
        beam[k, 0], beam[k, 1] = beams[first], beams[last]
        kind[k, 0] = kind[k, 1] = KIND_OCCLUSION
        if first and radius[first - 1] > radius[first] + (depth_margin + SIGMAS * noise[first]):
            kind[k, 0] = KIND_FREE
        if last + 1 < radius.shape[0] and radius[last + 1] > radius[last] + (depth_margin + SIGMAS * noise[last]):
            kind[k, 1] = KIND_FREE
        if k and pieces[k - 1].joined:
            kind[k, 0] = KIND_CORNER
        if k + 1 < count and pieces[k].joined:
            kind[k, 1] = KIND_CORNER
        sigma = 0.5 * (noise[first] + noise[last])
        sigma = sqrt(sigma * sigma + pieces[k].line.residual)
        number[0, k] = atan2(pieces[k].along.imag, pieces[k].along.real)
        number[1, k] = distance(pieces[k].end, pieces[k].start)
        number[2, k] = sigma / sqrt(max(pieces[k].size * pieces[k].line.spread, TINY))
        number[3, k] = sigma / sqrt(pieces[k].size)
    return Segments(places[0], places[1], numbers[0], numbers[1], numbers[2], numbers[3], integers[0], integers[1])
