# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences and robust iterations, as `core.registration.point_to_line`."""


cdef const double[::1] ones = np.ones(4096)


cdef const double[::1] given_or_ones(values, Py_ssize_t size):
    """Return the values of P points; where they are None as many ones."""
    if values is not None:
        return values
    return ones[:size] if size <= ones.shape[0] else np.ones(size)


def fit(candidates, points, field, double min_normal_cosine):
    """Find the `Fit` of a scan's points to the reference.

    Parameters
    ----------
    candidates : (H, 3) array
    points : OrientedPoints
        Of the current scan.
    field : LikelihoodField
        Of the reference.
    min_normal_cosine : float
        Minimum cosine of the angle between corresponding normals.
    """
    cdef const double[:, :] poses = candidates
    cdef const double complex[::1] own = points.points, own_normals = points.normals
    cdef const unsigned char[::1] table = field.index.view(np.uint8)
    cdef const double complex[::1] lines = field.normals
    cdef const double[::1] offsets = field.offsets
    cdef Grid grid = grid_of(field)
    cdef Py_ssize_t size = own.shape[0], none = lines.shape[0] - 1, h, k, at
    cdef double c, s, x, y, nx, ny
    shape = poses.shape[0], size
    errors, alikes = np.empty(shape), np.empty(shape, dtype=bool)
    normals, rotated, places = np.empty(shape, complex), np.empty(shape, complex), np.empty(shape, complex)
    cdef double[:, ::1] error = errors
    cdef unsigned char[:, ::1] alike = alikes
    cdef double complex[:, ::1] normal = normals, turned = rotated, place = places
    with nogil:
        for h in range(poses.shape[0]):
            c, s = cos(poses[h, 2]), sin(poses[h, 2])
            for k in range(size):
                # p_R = Rot(theta) p_O + t (Eq. 8)
                x, y = c * own[k].real - s * own[k].imag, s * own[k].real + c * own[k].imag
                turned[h, k] = x + 1j * y
                x, y = x + poses[h, 0], y + poses[h, 1]
                place[h, k] = x + 1j * y
                at = nearest(table, &grid, x, y)
                # The normal is conjugated: its product with a point has the distance from the line as the real part.
                nx, ny = lines[at].real, lines[at].imag
                normal[h, k] = lines[at]
                error[h, k] = nx * x - ny * y - offsets[at]
                x, y = own_normals[k].real, own_normals[k].imag
                alike[h, k] = (nx * (c * x - s * y) - ny * (s * x + c * y) > min_normal_cosine
                               and (min_normal_cosine >= 0.0 or at != none))
    return Fit(points.sharpened(errors), alikes, points.sharpened(normals), rotated, places)


cdef struct Equations:
    # Upper triangle of the weighted squares of the rows (x, y, theta, error).
    double xx, xy, xt, x, yy, yt, y, tt, t, e


cdef inline void add_row(Equations *sums, double weight, double a, double b, double r, double e) noexcept nogil:
    """Add a point with the Jacobian (a, b, r) and the error e to the normal equations."""
    sums.xx += weight * a * a
    sums.xy += weight * a * b
    sums.xt += weight * a * r
    sums.x += weight * a * e
    sums.yy += weight * b * b
    sums.yt += weight * b * r
    sums.y += weight * b * e
    sums.tt += weight * r * r
    sums.t += weight * r * e
    sums.e += weight * e * e


cdef inline void solve_step(Equations *s, double damping, double *step) noexcept nogil:
    """Solve the normal equations for a damped step, as `symmetric_matrix.solve`: L D L' by hand."""
    cdef double added = damping * (s.xx + s.yy + 1e-6)
    cdef double a = s.xx + added, p = s.xy / a, q = s.xt / a
    cdef double b = s.yy + added - p * s.xy, rest = s.yt - p * s.xt, r = rest / b
    cdef double y = s.y - p * s.x, t = (s.t - q * s.x - r * y) / (s.tt + added - q * s.xt - r * rest)
    y = y / b - r * t
    step[0], step[1], step[2] = s.x / a - p * y - q * t, y, t


cdef inline void write_equations(Equations *s, double[:, ::1] table) noexcept nogil:
    """Write the normal equations as a symmetric matrix (4, 4)."""
    table[0, 0], table[0, 1], table[0, 2], table[0, 3] = s.xx, s.xy, s.xt, s.x
    table[1, 0], table[1, 1], table[1, 2], table[1, 3] = s.xy, s.yy, s.yt, s.y
    table[2, 0], table[2, 1], table[2, 2], table[2, 3] = s.xt, s.yt, s.tt, s.t
    table[3, 0], table[3, 1], table[3, 2], table[3, 3] = s.x, s.y, s.t, s.e


def refine(candidates, alignment, scales, known=None):
    """Refine all candidates together by robust point-to-line iterations, one for each of the `scales` [m].

    Parameters
    ----------
    candidates : (H, 3) array
    alignment : Alignment
    scales : sequence of float [m]
        Kernel of each iteration.
    known : Fit, optional
        Of the candidates as they are; their correspondences are looked up again, with the same result.

    Returns
    -------
    candidates : (H, 3) array
    equations : (H, 4, 4) array
        The `normal_equations` of the last iteration.
    """
    points, field = alignment.points, alignment.field
    refined, equations = candidates.copy(), np.zeros((len(candidates), 4, 4))
    cdef double[:, ::1] poses = refined
    cdef double[:, :, ::1] tables = equations
    cdef const double[::1] kernels = np.array(scales, dtype=float)
    cdef const double complex[::1] own = points.points, own_normals = points.normals
    cdef const double[::1] weights = given_or_ones(points.weights, own.shape[0])
    cdef const double[::1] inverse_noise = given_or_ones(points.inverse_noise, own.shape[0])
    cdef const unsigned char[::1] table = field.index.view(np.uint8)
    cdef const double complex[::1] lines = field.normals
    cdef const double[::1] offsets = field.offsets
    cdef Grid grid = grid_of(field)
    cdef double min_cosine = alignment.min_normal_cosine, damping = alignment.damping
    cdef Py_ssize_t none = lines.shape[0] - 1, h, k, at, level
    cdef double c, s, x, y, mx, my, nx, ny, e, factor
    cdef double[3] step
    cdef Equations sums
    with nogil:
        for h in range(poses.shape[0]):
            sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for level in range(kernels.shape[0]):
                c, s = cos(poses[h, 2]), sin(poses[h, 2])
                factor = -0.5 / (kernels[level] * kernels[level])
                sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                for k in range(own.shape[0]):
                    x, y = c * own[k].real - s * own[k].imag, s * own[k].real + c * own[k].imag
                    at = nearest(table, &grid, x + poses[h, 0], y + poses[h, 1])
                    nx, ny = lines[at].real, lines[at].imag
                    mx, my = own_normals[k].real, own_normals[k].imag
                    if not nx * (c * mx - s * my) - ny * (s * mx + c * my) > min_cosine:
                        continue
                    if min_cosine < 0.0 and at == none:
                        continue
                    # Error and Jacobian (nx, -ny, -Im(n p)), times the inverse noise scale; Gaussian kernel (Eq. 18).
                    e = (nx * (x + poses[h, 0]) - ny * (y + poses[h, 1]) - offsets[at]) * inverse_noise[k]
                    nx, ny = nx * inverse_noise[k], ny * inverse_noise[k]
                    add_row(&sums, exp(factor * e * e) * weights[k], nx, -ny, -(nx * y + ny * x), e)
                solve_step(&sums, damping, step)
                for k in range(3):
                    poses[h, k] -= step[k]
            write_equations(&sums, tables[h])
    return refined, equations


def next_step(found, points, double scale, double damping):
    """Return the step ``(3,)`` of one more iteration with a kernel of `scale` [m], from the `Fit` of one candidate."""
    cdef const double[:, ::1] error = found.error
    cdef const unsigned char[:, ::1] alike = found.alike
    cdef const double complex[:, ::1] normal = found.normals, rotated = found.rotated_points
    cdef const double[::1] weights = given_or_ones(points.weights, error.shape[1])
    cdef double factor = -0.5 / (scale * scale), e
    cdef Py_ssize_t k
    cdef Equations sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cdef double[3] step
    with nogil:
        for k in range(error.shape[1]):
            if alike[0, k]:
                e = error[0, k]
                add_row(&sums, exp(factor * e * e) * weights[k], normal[0, k].real, -normal[0, k].imag,
                        -product_imag(normal[0, k], rotated[0, k]), e)
        solve_step(&sums, damping, step)
    return np.array((-step[0], -step[1], -step[2]))


cdef inline double product_imag(double complex a, double complex b) noexcept nogil:
    """Return the imaginary part of a product."""
    return a.real * b.imag + a.imag * b.real


def polish(candidate, found, points, refinement):
    """Refine one candidate ``(3,)`` with a kernel that narrows to the spread of the errors.

    The correspondences of `found`, the candidate's `Fit`, are kept, so the errors are linear in the step. A candidate
    that moves farther than the first kernel, as it may along a corridor, is returned unchanged.

    Returns
    -------
    candidate : (3,) array
    found : Fit
        Of it, H = 1.
    """
    if not refinement.polish_iterations:
        return candidate, found
    errors = found.error.copy()
    cdef double[:, ::1] error = errors
    cdef const unsigned char[:, ::1] alike = found.alike
    cdef const double complex[:, ::1] normal = found.normals, rotated = found.rotated_points
    cdef const double[::1] weights = given_or_ones(points.weights, error.shape[1])
    cdef double scale = refinement.final_scale, damping = refinement.damping, factor, weight, sum_weight, e
    cdef Py_ssize_t k
    cdef Equations sums
    cdef double[3] step
    cdef double[3] total = [0.0, 0.0, 0.0]
    for _ in range(refinement.polish_iterations):
        sums, sum_weight = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0
        factor = -0.5 / (scale * scale)
        for k in range(error.shape[1]):
            if alike[0, k]:
                e = error[0, k]
                weight = exp(factor * e * e) * weights[k]
                sum_weight += weight
                add_row(&sums, weight, normal[0, k].real, -normal[0, k].imag,
                        -product_imag(normal[0, k], rotated[0, k]), e)
        solve_step(&sums, damping, step)
        scale = refinement.narrowed(scale, sqrt(sums.e / max(sum_weight, 1e-9)))
        for k in range(3):
            total[k] += step[k]
        for k in range(error.shape[1]):
            error[0, k] -= (step[0] * normal[0, k].real - step[1] * normal[0, k].imag
                            - step[2] * product_imag(normal[0, k], rotated[0, k]))
    if hypot(total[0], total[1]) >= refinement.final_scale:
        return candidate, found
    return candidate - np.array((total[0], total[1], total[2])), found._replace(error=errors)
