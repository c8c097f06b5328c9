# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map alignment: registers a scan to all key frames at once, and estimates covariance and observability."""

# A direction is well constrained if its information is at least this fraction of the information across it.
cdef double WELL_CONSTRAINED = 0.02
# If the points move by more than this ratio of the cell size on average, correspondences are looked up again.
cdef double MAX_DISPLACEMENT = 0.25


def align_to_map(window, features, initial, prior, p, coarse=None):
    """Align a scan with all key frames of the window.

    Parameters
    ----------
    window : KeyFrameWindow
    features : Features
        Of the scan.
    initial : InitialAlignment
        Where the rotation is unobservable, it is left to the prior: the alignment starts at the prior's pose.
    prior : PosePrior
        Information in the frame of the scan [1/m^2, 1/rad^2]; zero where it contradicts `initial`.
    p : Parameters
    coarse : KeyFrameWindow, optional
        Key frames with which all iterations but the last align the scan; None: those of `window`. In the last
        iteration the others have the weights of `weighted_by_agreement`.

    Returns
    -------
    pose : SE2
        Pose of the scan in the odometry frame.
    correspondences : Correspondences
    """
    coarse = window if coarse is None else coarse
    points, direction = features.oriented_points, initial.direction
    scales, damping = p.refinement.window_scales(features.noise), p.refinement.damping
    last = max(len(scales) - 1, 0)
    noise = max(p.refinement.map_scale, features.noise)
    information = noise ** 2 * turned(prior.information, prior.pose.theta)
    pose = prior.pose if initial.rotation_unobservable else initial.pose
    found = find_correspondences(coarse, pose, points, direction, p)
    if direction is not None or initial.rotation_unobservable:
        information = map_steps.strengthened(information, features, found, initial, p)
    prior = PosePrior(prior.pose, information)
    pose = align(found, pose, prior, scales[:last], damping)
    # The nearest lines of dense points change with small steps, those of sparse points hardly.
    cell = p.density.cell_size
    if (coarse is not window or len(points) > p.density.max_points
            or displacement(found, pose) > MAX_DISPLACEMENT * cell):
        own, found = found, find_correspondences(window, pose, points, direction, p)
        if coarse is not window:
            found = weighted_by_agreement(found, own, window.is_in(coarse), p.refinement.map_first_scale, noise)
    return align(found, pose, prior, scales[last:], damping), found


cdef find_correspondences(window, pose, points, direction, p):
    """Look up correspondences; near-parallel walls count as parallel to the degenerate `direction` [rad], if any.

    Without one, the direction that is constrained least is used, if it is weakly constrained.
    """
    found = look_up_correspondences(window, pose, points, p.density)
    cdef double[:, ::1] rows = found.rows, information = np.empty((4, 4))
    cdef double[::1] error = np.empty(rows.shape[1]), weight = np.empty(rows.shape[1])
    cdef double[4] step = [0.0, 0.0, 0.0, 1.0]
    cdef double across, least, angle
    cdef double[3] motion
    cdef Equations sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cdef Weakest weakest
    cdef Py_ssize_t k
    weigh(rows, found.index, found.size, found.weights, step, p.refinement.map_first_scale, error, weight)
    for k in range(rows.shape[1]):
        add_row(&sums, weight[k], rows[0, k], rows[1, k], rows[2, k], rows[3, k])
    write_equations(&sums, &information[0, 0])
    if direction is None:
        read_weakest(information, &weakest)
        if weakest.weak >= WELL_CONSTRAINED * weakest.strong:
            return found
        direction = weakest.angle
    angle = direction
    if not is_corridor_like(information, angle):
        return found
    least = p.degeneracy.parallel_tolerance
    write_parallel(angle, information, p.decision.min_information, motion)
    for k in range(rows.shape[1]):
        across = motion[0] * rows[0, k] + motion[1] * rows[1, k] + motion[2] * rows[2, k]
        if fabs(across) < least * length_of(rows[0, k], rows[1, k]):
            rows[0, k], rows[1, k] = rows[0, k] - motion[0] * across, rows[1, k] - motion[1] * across
    return found


def look_up_correspondences(window, pose, points, density):
    """Look up the lines of all key frames that the `points` of a scan at `pose` (odometry frame) lie on.

    Points of high leverage are looked up in every key frame. The others, where a scan has many, are split into
    subsets; each subset is looked up in several key frames, and each key frame looks up one.
    """
    lookup = points_by_frame(high_leverage(points.normals), points.beams, len(window.frames),
                             density.max_points // SUBSETS)
    frame, index, turned_points, lines, error = look_up_pairs(window.fields, window.poses, pose, points, lookup,
                                                              density.min_normal_cosine)
    cdef const double complex[::1] rotated_point = turned_points, normal = lines
    cdef const double[::1] off = error
    cdef Py_ssize_t k
    table = np.empty((4, len(index)))
    cdef double[:, ::1] rows = table
    with nogil:
        for k in range(normal.shape[0]):
            rows[0, k], rows[1, k] = normal[k].real, -normal[k].imag
            rows[2, k], rows[3, k] = -product_imag(normal[k], rotated_point[k]), off[k]
    weights = None if points.weights is None else points.weights.take(index)
    return Correspondences(pose, len(points), frame, index, turned_points, table, weights)


cdef double displacement(found, other) except? -1.0:
    """Return the mean distance [m] by which the points move from the pose of the correspondences to another pose."""
    cdef const double complex[::1] points = found.rotated_points
    pose = found.pose
    cdef double dx = other.x - pose.x, dy = other.y - pose.y, t = wrap(other.theta - pose.theta)
    cdef double c = cos(t) - 1.0, s = sin(t), total = 0.0
    cdef Py_ssize_t k
    for k in range(points.shape[0]):
        total += length_of(dx + c * points[k].real - s * points[k].imag, dy + s * points[k].real + c * points[k].imag)
    return total / max(points.shape[0], 1)


def alignment_uncertainty(features, pose, correspondences, initial, p):
    """Estimate covariance and observability of a scan aligned at `pose`.

    Returns
    -------
    covariance : (3, 3) float
        In the frame of the scan [m, m, rad].
    observability : Observability
        Directions in the odometry frame.
    """
    rows, start = correspondences.rows, correspondences.pose
    cdef PointViews views = views_of(features.oriented_points)
    cdef const double complex[::1] rotated_point = correspondences.rotated_points
    cdef const Py_ssize_t[::1] index = correspondences.index
    cdef Py_ssize_t size = index.shape[0], k
    cdef double[::1] error = np.empty(size), weight = np.empty(size)
    cdef double[:, ::1] own = np.empty((3, size))
    cdef double[4] step = [pose.x - start.x, pose.y - start.y, wrap(pose.theta - start.theta), 1.0]
    cdef double theta = pose.theta, c = cos(theta), s = sin(theta), x, y
    weigh(rows, index, correspondences.size, correspondences.weights, step, p.refinement.score_scale, error, weight)
    with nogil:
        for k in range(size):
            x = views.normals[index[k]].real * views.inverse_noise[index[k]]
            y = views.normals[index[k]].imag * views.inverse_noise[index[k]]
            own[0, k], own[1, k] = c * x - s * y, s * x + c * y
            own[2, k] = rotated_point[k].real * own[1, k] - rotated_point[k].imag * own[0, k]
    return covariance_of(error, weight, rows[:3], own, features.noise, p.decision, theta,
                         initial.direction is not None, initial.rotation_unobservable)
