"""What a scan knows of the space around it: its surfaces, for look-up by place, and its free space, by bearing."""
import math
from dataclasses import dataclass

import numpy as np

from .parameters import DensityParameters


@dataclass(frozen=True, eq=False)
class Cloud:
    """The points of a scan that are compared to a reference: ``(P,)`` arrays x, y [m] and unit normal nx, ny."""

    x: np.ndarray
    y: np.ndarray
    nx: np.ndarray
    ny: np.ndarray

    def __len__(self):
        return len(self.x)

    def select(self, chosen):
        """The points that the mask `chosen` picks."""
        return Cloud(self.x[chosen], self.y[chosen], self.nx[chosen], self.ny[chosen])

    def thinned(self, count):
        """At most `count` of the points, evenly along the scan."""
        step = -(-len(self.x) // count)
        return self if step <= 1 else Cloud(self.x[::step], self.y[::step], self.nx[::step], self.ny[::step])


def build_cloud(points, normals) -> Cloud:
    """The `Cloud` of a scan from its points and normals ``(P, 2)``, those without a normal left out."""
    known = normals[:, 0] ** 2 + normals[:, 1] ** 2 > 0.5
    columns = np.ascontiguousarray(np.concatenate((points[known], normals[known]), axis=1).T)
    return Cloud(*columns)


@dataclass(frozen=True, eq=False)
class Surface:
    """Oriented points behind a grid that names the nearest of them: the reference density as a table (Eq. 16-18).

    The Gaussian kernel of the density estimate is taken of the nearest point's line only, stretched along the line to
    half the distance between neighbours: one look-up a point instead of a sum over all.

    Attributes
    ----------
    origin_x, origin_y, cell : float [m]
    index : (rows * columns,) int
        Nearest point of each cell; the last point, which has no normal, where none is near.
    rows, columns : int
    x, y, nx, ny, known : (P + 1,) float
        Points, unit normals, and 1 where there is a normal; all 0 for the last.
    """

    origin_x: float
    origin_y: float
    cell: float
    rows: int
    columns: int
    index: np.ndarray
    x: np.ndarray
    y: np.ndarray
    nx: np.ndarray
    ny: np.ndarray
    known: np.ndarray

    def nearest(self, px, py):
        """Index of the point nearest to each place (arrays of any shape, [m])."""
        row = np.clip((px - self.origin_x) * (1.0 / self.cell), 0.0, self.rows - 1.0).astype(np.intp)
        column = np.clip((py - self.origin_y) * (1.0 / self.cell), 0.0, self.columns - 1.0).astype(np.intp)
        row *= self.columns
        row += column
        return self.index.take(row)


def build_surface(points, normals, parameters: DensityParameters) -> Surface:
    """A `Surface` of points ``(P, 2)`` with normals ``(P, 2)``, those without a normal left out."""
    known = normals[:, 0] ** 2 + normals[:, 1] ** 2 > 0.5
    points, normals = points[known], normals[known]
    size = len(points)
    if size:
        low, high = points.min(axis=0), points.max(axis=0)
    else:
        low, high = np.zeros(2), np.zeros(2)
    extent = float((high - low).max()) + 2.0 * parameters.reach
    cell = max(parameters.cell, extent / parameters.cells)
    margin = int(math.ceil(parameters.reach / cell)) + 1
    origin = low - margin * cell
    rows, columns = (int(v) + 2 * margin + 1 for v in (high - low) / cell)
    index = np.full(rows * columns, size, dtype=np.int32)
    if size:
        place = (points - origin) / cell
        at = place.astype(np.intp)
        off_centre = ((place - at - 0.5) ** 2).sum(axis=1)
        order = np.argsort(-off_centre, kind='stable').astype(np.int32)
        home = (at[:, 0] * columns + at[:, 1])[order]
        offsets = _disc(parameters.reach / cell, columns)
        # Written from the far offsets to the near ones, and in a cell from its rim to its centre: the nearest point has
        # the last word. Beam order would favour one side and turn the match.
        index[(home + offsets[:, None]).ravel()] = np.tile(order, len(offsets))
    zero = np.zeros(1)
    return Surface(float(origin[0]), float(origin[1]), cell, rows, columns, index,
                   np.concatenate((points[:, 0], zero)), np.concatenate((points[:, 1], zero)),
                   np.concatenate((normals[:, 0], zero)), np.concatenate((normals[:, 1], zero)),
                   np.concatenate((np.ones(size), zero)))


def _disc(radius, columns):
    reach = int(math.ceil(radius))
    side = np.arange(-reach, reach + 1)
    square = side[:, None] ** 2 + side ** 2
    row, column = np.nonzero(square <= radius * radius)
    order = np.argsort(-square[row, column], kind='stable')
    return ((row - reach) * columns + column - reach)[order]


@dataclass(frozen=True, eq=False)
class View:
    """How far a scan saw in every direction.

    Attributes
    ----------
    near, far : (B,) float [m]
        Least and greatest range of the beams that touch each bin of the full circle; 0 where the scan does not know.
    """

    near: np.ndarray
    far: np.ndarray

    def bins(self, px, py):
        """Bin of each place as seen from the sensor."""
        size = len(self.near)
        bearing = np.arctan2(py, px)
        bearing += math.pi
        bearing *= size / (2.0 * math.pi)
        return np.minimum(bearing.astype(np.intp), size - 1)


def build_view(points, increment) -> View:
    """The `View` of a scan from its filtered points ``(P, 2)``.

    A bin is known when beams on both of its sides have a return, no farther apart than three increments.
    """
    size = int(np.clip(round(2.0 * math.pi / abs(increment)), 60, 2880))
    bearing = np.arctan2(points[:, 1], points[:, 0])
    radius = np.hypot(points[:, 0], points[:, 1])
    order = np.argsort(bearing, kind='stable')
    bearing, radius = bearing[order], radius[order]
    bearing = np.concatenate((bearing[-1:] - 2.0 * math.pi, bearing, bearing[:1] + 2.0 * math.pi))
    radius = np.concatenate((radius[-1:], radius, radius[:1], radius[:1]))
    edges = np.linspace(-math.pi, math.pi, size + 1)
    last = np.searchsorted(bearing, edges[:-1], 'right') - 1
    first = np.searchsorted(bearing, edges[1:], 'left')
    # A moved scan is sparse in places: what counts is that both neighbours exist, not that they are in adjacent beams.
    known = bearing[first] - bearing[last] < 3.0 * max(abs(increment), 2.0 * math.pi / size)
    span = np.stack((last, first + 1), axis=1).ravel()
    near = np.minimum.reduceat(radius, span)[::2]
    far = np.maximum.reduceat(radius, span)[::2]
    return View(np.where(known, near, 0.0), np.where(known, far, 0.0))
