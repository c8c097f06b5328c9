# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Points of a drive looked up in a grid: aligned with its surfaces, and counted by what the map has there."""
import numpy as np

from ..robot.occupancy import FREE, OCCUPIED

from libc.math cimport cos, fabs, sin

from ..core.geometry.symmetric cimport Factors, Symmetric, factors, write_rows

# Information of the pose where an alignment begins: along a corridor it stays there.
cdef double DAMPING = 1.0


cdef inline Py_ssize_t within(double at, Py_ssize_t cells) noexcept nogil:
    """Return the number of the cell of a coordinate, or of that at the border on its side."""
    return <Py_ssize_t> min(max(at, 0.0), <double> (cells - 1))


cdef class SurfaceLookup:
    """A grid, in whose frame, with the axes along its rows, all poses and points are.

    Parameters
    ----------
    values : (H, W) int8
        `FREE`, `OCCUPIED` or `UNKNOWN`, with a border of unknown cells.
    distance : (H, W) float32
        Distance [m] of each cell from the nearest surface.
    resolution : float
        Side of a cell [m].
    """

    cdef const signed char[:, ::1] values
    cdef const float[:, ::1] distance, along_x, along_y
    cdef double resolution
    cdef signed char free, occupied

    def __init__(self, values, distance, double resolution):
        self.values, self.distance, self.resolution = np.ascontiguousarray(values), distance, resolution
        along_y, along_x = np.gradient(distance, np.float32(resolution))
        self.along_x, self.along_y = np.ascontiguousarray(along_x), np.ascontiguousarray(along_y)
        self.free, self.occupied = FREE, OCCUPIED

    cdef double nearest(self, double x, double y, double *slope_x, double *slope_y, signed char *value) noexcept nogil:
        """Return the distance of a point [m] from the nearest surface, its gradient, and the value of its cell."""
        cdef double column = x / self.resolution + 1.0, row = y / self.resolution + 1.0
        cdef Py_ssize_t i = within(row, self.values.shape[0]), k = within(column, self.values.shape[1])
        slope_x[0], slope_y[0], value[0] = self.along_x[i, k], self.along_y[i, k], self.values[i, k]
        return fabs(self.distance[i, k] + self.resolution * (slope_x[0] * (column - <Py_ssize_t> column - 0.5)
                                                             + slope_y[0] * (row - <Py_ssize_t> row - 0.5)))

    cdef signed char value(self, double x, double y) noexcept nogil:
        """Return the value of the cell of a point [m]."""
        return self.values[within(y / self.resolution + 1.0, self.values.shape[0]),
                           within(x / self.resolution + 1.0, self.values.shape[1])]

    def align(self, double[:, ::1] poses, const double[:, ::1] points, const double[::1] scales):
        """Move each of the `poses` (H, 3) of a frame to where the `points` (N, 2) in it lie on surfaces.

        Gauss-Newton with the robust kernel of Geman and McClure, whose scale [m] in each iteration is given.

        Returns
        -------
        normal : (H, 3, 3) float
            Normal matrix of the last iteration, of squares of one metre.
        variance : (H,) float
            Weighted mean of the squared distances [m^2] there.
        """
        normal, variance = np.zeros((poses.shape[0], 3, 3)), np.zeros(poses.shape[0])
        cdef double[:, :, ::1] matrices = normal
        cdef double[::1] variances = variance
        cdef Symmetric m
        cdef Factors f
        cdef signed char value
        cdef Py_ssize_t h, n, k
        cdef double c, s, x, y, off, gx, gy, gt, weight, bx, by, bt, weights, squares
        for h in range(poses.shape[0]):
            for k in range(scales.shape[0]):
                c, s = cos(poses[h, 2]), sin(poses[h, 2])
                m = Symmetric(DAMPING, 0.0, 0.0, DAMPING, 0.0, DAMPING)
                bx = by = bt = weights = squares = 0.0
                for n in range(points.shape[0]):
                    x, y = c * points[n, 0] - s * points[n, 1], s * points[n, 0] + c * points[n, 1]
                    off = self.nearest(poses[h, 0] + x, poses[h, 1] + y, &gx, &gy, &value)
                    weight = 1.0 / (1.0 + (off / scales[k]) * (off / scales[k]))
                    weight *= weight
                    gt = gy * x - gx * y
                    m.xx, m.xy, m.xt = m.xx + weight * gx * gx, m.xy + weight * gx * gy, m.xt + weight * gx * gt
                    m.yy, m.yt, m.tt = m.yy + weight * gy * gy, m.yt + weight * gy * gt, m.tt + weight * gt * gt
                    bx, by, bt = bx + weight * off * gx, by + weight * off * gy, bt + weight * off * gt
                    weights, squares = weights + weight, squares + weight * off * off
                f = factors(m.xx, m.xy, m.xt, m.yy, m.yt, m.tt)
                by -= f.p * bx
                bt = (bt - f.q * bx - f.r * by) / f.c
                by = by / f.b - f.r * bt
                bx = bx / f.a - f.p * by - f.q * bt
                poses[h, 0], poses[h, 1], poses[h, 2] = poses[h, 0] - bx, poses[h, 1] - by, poses[h, 2] - bt
            write_rows(&m, &matrices[h, 0, 0])
            for k in range(3):
                matrices[h, k, k] -= DAMPING
            variances[h] = squares / weights
        return normal, variance

    def count(self, const double[:, ::1] poses, const double[:, ::1] hits, const double[:, ::1] fronts,
              const double[:, ::1] squares, double reach):
        """Count what the map has at returns and free squares; the parameters and the result are those of `Matcher`.

        A return up to `reach` [m] from a surface is on it; half a cell nearer and farther it is so in part, so that a
        pose between two cells does not count more than another.
        """
        counts = np.zeros((poses.shape[0], 6))
        cdef double[:, ::1] count = counts
        cdef double[::1] found
        cdef signed char value
        cdef Py_ssize_t h, n
        cdef double c, s, x, y, near, on, off, gx, gy
        for h in range(poses.shape[0]):
            c, s, x, y = cos(poses[h, 2]), sin(poses[h, 2]), poses[h, 0], poses[h, 1]
            found = count[h]
            for n in range(hits.shape[0]):
                near = self.nearest(x + c * hits[n, 0] - s * hits[n, 1], y + s * hits[n, 0] + c * hits[n, 1], &gx, &gy,
                                    &value)
                near = min(max((reach - near) / self.resolution + 0.5, 0.0), 1.0)
                off = 1.0 - near if value == self.free else 0.0
                value = self.value(x + c * fronts[n, 0] - s * fronts[n, 1], y + s * fronts[n, 0] + c * fronts[n, 1])
                on = near if value == self.free else 0.0
                found[0], found[1], found[2] = found[0] + on, found[1] + off, found[2] + (1.0 - on - off)
            for n in range(squares.shape[0]):
                value = self.value(x + c * squares[n, 0] - s * squares[n, 1], y + s * squares[n, 0] + c * squares[n, 1])
                if value == self.free:
                    found[3] += 1.0
                elif value == self.occupied:
                    found[4] += 1.0
                else:
                    found[5] += 1.0
        return counts
