# SPDX-License-Identifier: Apache-2.0
"""Evidence for and against motions, as `core.registration.confidence.evidence`."""


cdef inline int seen_at(const double[::1] near, const double[::1] far, double x, double y, double tolerance,
                        double* conflict) except? -1 nogil:
    """Return 0 where a scan sees nothing at a place, 1 where it is visible, 2 on the outline; and the `conflict`."""
    cdef Py_ssize_t number = bin_of(x, y, near.shape[0])
    cdef double radius = length_of(x, y), least = near[number], behind = radius - far[number]
    conflict[0] = min(max((least - radius - tolerance) * (1.0 / tolerance), 0.0), 1.0)
    if least <= 0.0 or behind >= 2.0 * tolerance:
        return 0
    return 2 if behind < tolerance and radius > least - tolerance else 1


cdef inline double nearest_of(double complex place, const double complex[::1] others) except? -1.0 nogil:
    """Return the distance of the nearest of the `others` [m]."""
    cdef double nearest = INFINITY
    cdef Py_ssize_t k
    for k in range(others.shape[0]):
        nearest = min(nearest, length_of(place.real - others[k].real, place.imag - others[k].imag))
    return nearest


cdef const double complex[::1] fixed_ends(segments):
    """Return the corners and free ends of the segments, as `Segments.fixed_ends`, and keep them there."""
    cdef dict kept = segments.__dict__
    cdef const Py_ssize_t[:, :] kinds
    cdef const double[:, :] start, end
    cdef double complex[::1] place
    cdef Py_ssize_t free_end = EndKind.FREE, occlusion = EndKind.OCCLUSION, k, count = 0
    if 'fixed_ends' not in kept:
        kinds, start, end = segments.kinds, segments.start, segments.end
        place = places = np.empty(2 * kinds.shape[0], complex)
        for k in range(kinds.shape[0]):
            if kinds[k, 0] != occlusion:
                place[count] = start[k, 0] + 1j * start[k, 1]
                count += 1
        for k in range(kinds.shape[0]):
            if kinds[k, 1] == free_end:
                place[count] = end[k, 0] + 1j * end[k, 1]
                count += 1
        kept['fixed_ends'] = places[:count]
    return kept['fixed_ends']


cdef double crossing_of(reference, current, const double[:] candidate):
    """Return the length [m] of the matched segments across their main direction."""
    cdef const double[:, :] start_r = reference.start, end_r = reference.end
    cdef const double[:, :] start_o = current.start, end_o = current.end
    cdef const double[:] direction_r = reference.direction, direction_o = current.direction
    cdef const double[:] length_r = reference.length, length_o = current.length
    cdef double same_place = evidence_steps._SAME_PLACE, parallel = evidence_steps._PARALLEL
    cdef double c = cos(candidate[2]), s = sin(candidate[2]), x, y, angle, along, across, overlap, length
    cdef double total = 0.0, double_c = 0.0, double_s = 0.0, step_x, step_y
    cdef Py_ssize_t r, o
    with nogil:
        for o in range(direction_o.shape[0]):
            step_x, step_y = 0.5 * (start_o[o, 0] + end_o[o, 0]), 0.5 * (start_o[o, 1] + end_o[o, 1])
            x, y = c * step_x - s * step_y + candidate[0], s * step_x + c * step_y + candidate[1]
            angle, length = direction_o[o] + candidate[2], 0.0
            for r in range(direction_r.shape[0]):
                if cos(angle - direction_r[r]) <= parallel:
                    continue
                step_x = x - 0.5 * (start_r[r, 0] + end_r[r, 0])
                step_y = y - 0.5 * (start_r[r, 1] + end_r[r, 1])
                along = step_x * cos(direction_r[r]) + step_y * sin(direction_r[r])
                across = step_y * cos(direction_r[r]) - step_x * sin(direction_r[r])
                if fabs(across) >= same_place:
                    continue
                overlap = min(0.5 * (length_r[r] + length_o[o]) - fabs(along), min(length_r[r], length_o[o]))
                length = max(length, overlap)
            total += length
            double_c += length * cos(2.0 * angle)
            double_s += length * sin(2.0 * angle)
    return 0.5 * (total - length_of(double_c, double_s))


def collect_evidence(const double[:, :] candidates, fits, weak, reference, current, parameters):
    """Collect the evidence for and against each of the motions.

    Parameters
    ----------
    candidates : (H, 3) array
    fits : Fit
        Of them, for the current scan's `sampled_points`.
    weak : (H,) sequence of float
        Number of points that constrain the weakest direction of each.
    reference, current : Features
    parameters : Parameters
    """
    cdef const double[:, ::1] error = fits.error
    cdef const unsigned char[:, ::1] alike = fits.alike
    cdef const double complex[:, ::1] place = fits.places
    cdef const double complex[::1] own = reference.sampled_points.points
    cdef const double complex[::1] ends_r = fixed_ends(reference.segments), ends_o = fixed_ends(current.segments)
    cdef const double[::1] near_r = reference.free_space.near, far_r = reference.free_space.far
    cdef const double[::1] near_o = current.free_space.near, far_o = current.free_space.far
    cdef Py_ssize_t size = error.shape[1], count = own.shape[0], h, k, on_outline, matched, unmatched
    cdef const double[::1] weights = given_or_ones(current.sampled_points.weights, size)
    cdef double tolerance = parameters.density.violation_tolerance, scale = parameters.refinement.score_scale
    cdef double factor = -0.5 / (scale * scale), same_place = evidence_steps._SAME_PLACE
    cdef double weight, conflict, of_current, of_reference, squares, total, c, s, x, y, apart
    cdef double complex[::1] moved = np.empty(ends_o.shape[0], complex)
    found = []
    for h in range(candidates.shape[0]):
        of_current = of_reference = squares = total = 0.0
        on_outline = matched = unmatched = 0
        with nogil:
            c, s = cos(candidates[h, 2]), sin(candidates[h, 2])
            for k in range(size):
                # Gaussian kernel (Eq. 18), 0 where the normals disagree.
                weight = exp(factor * error[h, k] * error[h, k]) if alike[h, k] else 0.0
                seen_at(near_r, far_r, place[h, k].real, place[h, k].imag, tolerance, &conflict)
                of_current += conflict * (1.0 - weight)
                weight *= weights[k]
                squares += error[h, k] * weight * error[h, k]
                total += weight
            for k in range(count):
                x, y = own[k].real - candidates[h, 0], own[k].imag - candidates[h, 1]
                on_outline += seen_at(near_o, far_o, c * x + s * y, c * y - s * x, tolerance, &conflict) == 2
                of_reference += conflict
            for k in range(ends_o.shape[0]):
                x = c * ends_o[k].real - s * ends_o[k].imag + candidates[h, 0]
                y = s * ends_o[k].real + c * ends_o[k].imag + candidates[h, 1]
                moved[k] = x + 1j * y
                apart = nearest_of(moved[k], ends_r)
                matched += apart < same_place
                if apart >= 2.0 * same_place and seen_at(near_r, far_r, x, y, tolerance, &conflict):
                    unmatched += 1
            for k in range(ends_r.shape[0]):
                x, y = ends_r[k].real - candidates[h, 0], ends_r[k].imag - candidates[h, 1]
                apart = nearest_of(ends_r[k], moved)
                matched += apart < same_place
                if (apart >= 2.0 * same_place
                        and seen_at(near_o, far_o, c * x + s * y, c * y - s * x, tolerance, &conflict)):
                    unmatched += 1
        found.append(Evidence(
            of_current / max(size, 1), of_reference / max(count, 1), on_outline, matched, unmatched,
            crossing_of(reference.segments, current.segments, candidates[h]), sqrt(squares / max(total, TINY)),
            length_of(candidates[h, 0], candidates[h, 1]), weak[h]))
    return found
