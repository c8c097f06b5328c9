# SPDX-License-Identifier: Apache-2.0
"""Small objects of a scan, as `core.features.small_objects`."""


def find_small_objects(features, double size, parameters):
    """Find surfaces (Eq. 5) smaller than a `size` [m] with a larger range, or no return, on both sides."""
    geometry = features.scan.geometry
    cdef double increment = fabs(geometry.angle_increment)
    cdef double margin = parameters.depth_margin + SIGMAS * features.noise, width
    cdef bint closed = geometry.closed
    cdef Py_ssize_t circle = round(2.0 * math.pi / increment) if closed else geometry.size
    ordered, numbers, bare, breaks = small_object_steps._ring(features, circle, parameters)
    cdef const Py_ssize_t[::1] beams = np.ascontiguousarray(ordered, np.intp)
    cdef const double complex[::1] points = np.ascontiguousarray(numbers)
    cdef const unsigned char[::1] without_normal = np.ascontiguousarray(bare), broken = np.ascontiguousarray(breaks)
    cdef Py_ssize_t count = points.shape[0], objects = 1, found = 0, k, i, first, last, before, after
    cdef Py_ssize_t[::1] start = np.empty(count + 1, np.intp)
    integers, distances, fronts = np.empty((2, count), np.intp), np.empty((2, count)), np.empty(count, complex)
    flags = np.empty(count, dtype=bool)
    cdef Py_ssize_t[:, ::1] integer = integers
    cdef double[:, ::1] number = distances
    cdef double complex[::1] front = fronts
    cdef unsigned char[::1] flag = flags
    with nogil:
        start[0] = 0
        for k in range(count - 1):
            if broken[k]:
                start[objects] = k + 1
                objects += 1
        start[objects if count else 0] = count
        objects = objects if count else 0
        for k in range(0 if closed else 1, objects if closed else objects - 1):
            first, last = start[k], start[k + 1] - 1
            before, after = (first if k else count) - 1, start[(k + 1) % objects]
            if not (modulus(points[before]) > modulus(points[first]) + margin
                    or modulo(beams[first] - beams[before], circle) > 1):
                continue
            if not (modulus(points[after]) > modulus(points[last]) + margin
                    or modulo(beams[after] - beams[last], circle) > 1):
                continue
            if not distance(points[last], points[first]) < size:
                continue
            front[found] = 0.5 * (points[first] + points[last])
            integer[0, found], integer[1, found] = modulo(beams[first], circle), last - first + 1
            width = (last - first + 1) * increment * modulus(front[found])
            number[0, found], number[1, found], flag[found] = modulus(points[first]), width, True
            for i in range(first, last + 1):
                number[0, found] = min(number[0, found], modulus(points[i]))
                flag[found] = flag[found] and without_normal[i]
            found += 1
    return SmallObjects(integers[0, :found], integers[1, :found], distances[0, :found], fronts[:found],
                        distances[1, :found], flags[:found])


cdef inline Py_ssize_t modulo(Py_ssize_t number, Py_ssize_t of) noexcept nogil:
    """Return the remainder, which is not negative."""
    return (number % of + of) % of
