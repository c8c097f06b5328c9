# SPDX-License-Identifier: Apache-2.0
"""Features of a scan whose returns are selected, as `core.features.extraction`."""


def extract_from_returns(returns, parameters, noise_ratio=None):
    """Extract the features of a scan whose returns are selected already; as `extract_features`."""
    limits, scan = parameters.scan, returns.scan
    cdef double noise = returns.noise, left = noise
    filtered, _ = ring_band_filter(returns.points, noise, parameters.filter)
    points, positions, radii, beams = finite_points(filtered)
    if len(points) < limits.min_returns:
        raise ScanError(f'{len(points)} returns remain after the ring band filter; advanced.scan.min_returns asks for '
                        f'{limits.min_returns}')
    cdef double ratio = returns.noise_ratio if noise_ratio is None else noise_ratio
    # Before the filter, outliers count as noise. Corners must stand out from this noise, normals and breaks need not.
    if len(points) < np.count_nonzero(returns.valid):
        left = min(noise, <double> estimate_noise(radii, limits))
    sequence = point_sequence(positions, beams, scan.geometry.angle_increment, left, parameters.segments)
    normals = estimate_normals(sequence, noise_by_range(radii, left, ratio), parameters.segments)
    segments = extract_segments(sequence, noise_by_range(radii, noise, ratio), parameters.segments)
    if sequence.increment < 0.0:
        segments = segments.reversed()
    return Features(scan, points, beams, sequence.breaks, normals.view(float).reshape(-1, 2), segments, left,
                    parameters.density, ratio, backend=returns.backend)


cdef finite_points(filtered):
    """Return the finite points of a scan ``(P, 2)`` [m], also as complex numbers ``(P,)``, their ranges and beams."""
    cdef const double[:, :] place = filtered
    cdef Py_ssize_t size = place.shape[0], k, count = 0
    points, radii, beams = np.empty((size, 2)), np.empty(size), np.empty(size, np.intp)
    cdef double[:, ::1] point = points
    cdef double[::1] radius = radii
    cdef Py_ssize_t[::1] beam = beams
    with nogil:
        for k in range(size):
            if isfinite(place[k, 0]):
                point[count, 0], point[count, 1], beam[count] = place[k, 0], place[k, 1], k
                radius[count] = length_of(place[k, 0], place[k, 1])
                count += 1
    points = points[:count]
    return points, points.view(complex)[:, 0], radii[:count], beams[:count]


cdef noise_by_range(const double[::1] radius, double noise, double ratio):
    """Return the standard deviation ``(P,)`` of each range [m], as `core.features.range_noise.range_noise`."""
    cdef double typical = range_noise_steps.TYPICAL_NOISE
    cdef Py_ssize_t k
    result = np.empty(radius.shape[0])
    cdef double[::1] each = result
    for k in range(radius.shape[0]):
        each[k] = noise + max(ratio * radius[k] - typical, 0.0)
    return result


def build_oriented_points(const double[:, :] points, const double[:, :] normals, const Py_ssize_t[:] beams):
    """Build `OrientedPoints` from points and normals ``(P, 2)``, leaving out points without a normal."""
    cdef Py_ssize_t size = points.shape[0], k, count = 0
    vectors, numbers = np.empty((2, size), complex), np.empty(size, np.intp)
    cdef double complex[:, ::1] vector = vectors
    cdef Py_ssize_t[::1] beam = numbers
    with nogil:
        for k in range(size):
            if normals[k, 0] != 0.0 or normals[k, 1] != 0.0:
                vector[0, count] = points[k, 0] + 1j * points[k, 1]
                vector[1, count] = normals[k, 0] + 1j * normals[k, 1]
                beam[count] = beams[k]
                count += 1
    return OrientedPoints(vectors[0, :count], vectors[1, :count], numbers[:count])
