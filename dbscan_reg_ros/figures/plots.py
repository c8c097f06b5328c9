# SPDX-License-Identifier: Apache-2.0
"""Pictures of maps and comparisons, legible without colour; maps have the same scale on both axes."""
import os
import warnings
from collections.abc import Iterable
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import ArgumentError, DbscanRegError
from ..core.geometry.se2 import SE2, as_complex
from ..core.odometry.records import OdometryUpdate
from ..core.scan import Scan
from ..recordings.files import replacing

MOST_POINTS = 3_000_000
"""Larger maps are thinned to about this many points."""
CELLS = 1500
"""Cells of the longer side of the map: one cell for each pixel, so that the picture is not resampled."""


LINES = '-', '--', '-.', ':', (0, (5, 1, 1, 1, 1, 1))
"""Styles of trajectories, so that they are told apart without colour."""
PNG_LEVEL = 3
"""Compression of PNG pictures: half of the time of the usual 6, for files that are 7 % larger."""


class DensityMap(NamedTuple):
    """Density of the returns on a map."""

    ink: np.ndarray
    """Density of each cell, 0..1 ``(rows, columns)`` float32; the first row is the lowest."""
    extent: tuple
    """(left, right, bottom, top) [m]"""


class MapPoints:
    """The returns of the `count` scans of a map, each scan in its own frame; about `MOST_POINTS` of them are kept.

    `yaw` is the angle [rad] by which `lidars.turned` rotated the scans.
    """

    def __init__(self, count, yaw=0.0):
        self._each = max(1, MOST_POINTS // max(count, 1))
        self._yaw = yaw
        self._scans = []

    def add(self, scan):
        """Keep the returns of the next scan."""
        points = as_complex(scan.points[scan.valid])
        self._scans.append(points[::-(-len(points) // self._each) or 1].astype(np.complex64))

    def density(self, poses) -> DensityMap:
        """Return the density of the returns, given the poses ``(N, 3)`` of the sensor at the scans added."""
        poses = np.asarray(poses, dtype=float).reshape(-1, 3)
        laid = [np.empty(0, dtype=np.complex64), *(points.astype(np.complex64) for points in self._laid(poses))]
        return _density(np.concatenate(laid).view(np.float32).reshape(-1, 2), poses)

    def placed(self, poses, chosen):
        """Yield the pose ``(3,)`` of each of the `chosen` scans (a bool each) and its returns ``(M, 2)`` on the map."""
        for pose, points, use in zip(poses, self._laid(poses), chosen, strict=False):
            if use:
                yield pose, np.stack((points.real, points.imag), axis=1)

    def _laid(self, poses):
        """Yield the returns of each scan on the map, as complex numbers; `poses` are those of `density`."""
        # After an interruption the last pose may have no scan.
        for points, place, turn in zip(self._scans, as_complex(poses[:, :2]), np.exp(1j * (poses[:, 2] - self._yaw)),
                                       strict=False):
            yield turn * points + place


def density_map(scans, poses) -> DensityMap:
    """Return the density of the returns of `scans`, an iterable with one scan for each of the `poses` ``(N, 3)``."""
    points = MapPoints(len(poses))
    for scan, pose in zip_longest(scans, poses):
        if scan is None or pose is None:
            count = 'fewer' if scan is None else 'more'
            raise ArgumentError(f'{len(poses)} poses, but {count} scans; expected one scan for each pose')
        points.add(scan)
    return points.density(poses)


def save(figure, path, dpi, **options):
    """Write a matplotlib `figure` completely or not at all; the ending of `path` selects the format."""
    from matplotlib import rc_context

    _lay_out(figure, dpi)
    if Path(path).suffix == '.png':
        options |= {'pil_kwargs': {'compress_level': PNG_LEVEL}}
    # Fonts as TrueType: publishers refuse those of type 3.
    with replacing(path, binary=True) as file, _any_script(), rc_context({'pdf.fonttype': 42}):
        figure.savefig(file, dpi=dpi, format=Path(path).suffix[1:] or None, **options)


def picture(figure, dpi):
    """Return a matplotlib `figure` as a `PIL.Image.Image`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    _lay_out(figure, dpi)
    canvas = FigureCanvasAgg(figure)
    with _any_script():
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def write_png(path, image):
    """Write a `PIL.Image.Image` completely or not at all."""
    with replacing(path, binary=True) as file:
        image.save(file, format='png', compress_level=PNG_LEVEL)


def _lay_out(figure, dpi):
    """Lay a figure out, once: matplotlib lays a figure with an engine out twice, and draws it twice."""
    figure.set_dpi(dpi)
    if (layout := figure.get_layout_engine()) is not None:
        with warnings.catch_warnings():
            warnings.filterwarnings('error', 'constrained_layout not applied')
            try:
                layout.execute(figure)
            except UserWarning:
                width, height = figure.get_size_inches()
                raise DbscanRegError(f'a picture of {width:g} x {height:g} inches has no room beside its texts; '
                                     'expected a larger size') from None
        figure.set_layout_engine(None)


@contextmanager
def _any_script():
    """A title may be the name of a file in any script; the font draws a box for a character that it lacks."""
    with warnings.catch_warnings():
        warnings.filterwarnings('ignore', 'Glyph .* missing from')
        yield


def plot_map(path: str | os.PathLike[str], scans: Iterable[Scan],
             poses: Iterable[ArrayLike | SE2 | OdometryUpdate], title: str = '',
             truth: ArrayLike | None = None) -> None:
    """Draw the density of the returns of scans at their poses, and the trajectory over it.

    Parameters
    ----------
    path : str or Path
        The picture to write; its ending chooses the format.
    scans : iterable of Scan
        One scan for each pose; read one at a time.
    poses : (N, 3)
        Poses of the sensor: x, y [m], theta [rad]; or updates of the odometry, which have them.
    truth : (M, 3), optional
        The true trajectory in the same frame; NaN interrupts its line.

    Raises
    ------
    ArgumentError
        When there is not one scan for each pose.
    """
    rows = np.asarray([each.pose if isinstance(each, OdometryUpdate) else each for each in poses], dtype=float)
    draw_map(path, density_map(scans, rows), rows, title, truth)


def draw_map(path, density, poses, title='', truth=None):
    """Draw a `DensityMap` and the trajectory, with the parameters of `plot_map`."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    poses = np.asarray(poses, dtype=float).reshape(-1, 3)
    extent = density.extent
    sides = np.array((extent[1] - extent[0], extent[3] - extent[2]))
    width, height = 10.0 * sides / sides.max()
    # No layout engine: it would draw the picture twice.
    left, right, below, above = 0.9, max(0.3, 4.5 - width), 1.0, 0.4
    figure = Figure(figsize=(left + width + right, below + height + above))
    figure.subplots_adjust(left / (left + width + right), below / (below + height + above),
                           1.0 - right / (left + width + right), 1.0 - above / (below + height + above))
    axes = figure.add_subplot()
    axes.imshow(density.ink, cmap='gray_r', origin='lower', extent=extent, vmin=0.0, vmax=1.0,
                interpolation='antialiased')
    axes.plot(poses[:, 0], poses[:, 1], '-', color='tab:blue', linewidth=0.8, alpha=0.9, label='trajectory')
    truth = np.empty((0, 3)) if truth is None else np.asarray(truth, dtype=float)
    if np.isfinite(truth).any():
        axes.plot(truth[:, 0], truth[:, 1], '--', color='tab:orange', linewidth=0.8, label='truth')
    if len(poses):
        _ends(axes, poses)
    axes.set(xlabel='x [m]', ylabel='y [m]', aspect='equal', xlim=extent[:2], ylim=extent[2:])
    axes.set_title(title, loc='left')
    for axis, side in ((axes.xaxis, width), (axes.yaxis, height)):
        axis.set_major_locator(MaxNLocator(max(int(side), 2), steps=[1, 2, 5, 10]))
    axes.grid(linewidth=0.3, alpha=0.5)
    _legend(axes)
    save(figure, path, 150)


def plot_world(path, segments, circles, way, routes=(), title=''):
    """Draw a floor plan of `segments` ``(S, 2, 2)`` and `circles` ``(C, 3)`` [m] with the `way` ``(N, 2)`` of a robot.

    `routes` ``(K, 2)`` [m] are those on which people walk.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    low, high = segments.min(axis=(0, 1)) - 0.5, segments.max(axis=(0, 1)) + 0.5
    width, height = high - low
    longer = max(width, height)
    figure = Figure(figsize=(2.0 + 10.0 * width / longer, 2.0 + 10.0 * height / longer), layout='constrained')
    axes = figure.add_subplot()
    axes.add_collection(LineCollection(segments, colors='black', linewidths=1.0))
    for x, y, radius in circles:
        axes.add_patch(Circle((x, y), radius, facecolor='0.7', edgecolor='black'))
    axes.plot(way[:, 0], way[:, 1], '-', color='tab:blue', linewidth=1.2, label='robot')
    for number, route in enumerate(routes):
        label = None if number else 'people'
        axes.plot(route[:, 0], route[:, 1], ':', color='tab:orange', linewidth=2.0, label=label)
    _ends(axes, way)
    axes.set(xlabel='x [m]', ylabel='y [m]', title=title, aspect='equal', xlim=(low[0], high[0]),
             ylim=(low[1], high[1]))
    _legend(axes)
    save(figure, path, 110, bbox_inches='tight')


def plot_differences(path, table, letter, names, size):
    """Draw the differences of the errors of a competitor and A, in per cent of those of A, with confidence intervals.

    `table` maps the name of a recording to a `Difference` for translation and one for rotation, `letter` denotes the
    competitor. `names` are those of A and of the competitor for the title, or None; `size` is in inches, None: by the
    number of recordings.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size or (10.0, 2.0 + 0.45 * len(table)), layout='constrained')
    panels = figure.subplots(1, 2, sharey=True)
    for column, (axes, title) in enumerate(zip(panels, ('translation', 'rotation'), strict=True)):
        for place, row in enumerate(table.values()):
            d = row[column]
            scale = 100.0 / d.a if d.a else 0.0
            mean = scale * (d.b - d.a)
            axes.errorbar(mean, place, xerr=[[mean - scale * d.low], [scale * d.high - mean]], color='black', capsize=5,
                          fmt='s' if d.worse else 'o', markerfacecolor='black' if d.worse or d.better else 'white')
        axes.axvline(0.0, color='0.5', linestyle='--')
        axes.set(title=title, xlabel=f'mean error over 1 m, {letter} against A [%]', ylim=(len(table) - 0.5, -0.5))
        axes.set_yticks(range(len(table)), table)
        axes.grid(axis='x', linewidth=0.3)
    if names:
        figure.suptitle(f'A: {names[0]}, {letter}: {names[1]}; filled: significant, square: {letter} worse')
    save(figure, path, 110)


def plot_trajectories(path, lines, title, size):
    """Draw several trajectories of one drive on a plan of a `size` [inch] or None.

    `lines` are names and positions ``(N, 2)`` [m], all in one frame; NaN interrupts a line.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size or (8.0, 8.0), layout='constrained')
    axes = figure.add_subplot()
    for number, (name, way) in enumerate(lines):
        axes.plot(*way.T, linestyle=LINES[number % len(LINES)], linewidth=1.2, label=name)
    axes.set(xlabel='x [m]', ylabel='y [m]', title=title)
    axes.set_aspect('equal', adjustable='datalim')
    axes.grid(linewidth=0.3)
    figure.legend(loc='outside lower center', ncols=2, frameon=False)
    save(figure, path, 110)


def _ends(axes, way):
    axes.plot(*way[0, :2], 'o', color='white', markeredgecolor='black', markersize=11, label='start')
    axes.plot(*way[-1, :2], 's', color='black', markeredgecolor='white', markersize=7, label='end')


def _legend(axes):
    from matplotlib.transforms import offset_copy

    below = offset_copy(axes.transAxes, axes.figure, y=-40.0, units='points')
    axes.legend(loc='upper left', bbox_to_anchor=(0.0, 0.0), bbox_transform=below, ncol=4, frameon=False,
                borderaxespad=0.0)


def _density(points, poses):
    """Return the `DensityMap` of points ``(P, 2)`` whose extent includes the poses ``(N, 3)``."""
    seen = np.concatenate((np.quantile(points, (0.001, 0.999), axis=0) if len(points) else np.zeros((0, 2)),
                           poses[:, :2], np.zeros((0 if len(poses) else 1, 2))))
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = 0.03 * (high - low).max() + 0.5
    low, high = low - margin, high + margin
    cell = (high - low).max() / CELLS
    shape = np.maximum(np.ceil((high - low) / cell).astype(int), 1)
    cells = np.floor((points - low) / cell).astype(np.int32)
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    counts = np.bincount(cells[:, 1] * shape[0] + cells[:, 0], minlength=shape.prod())
    full = np.quantile(counts[counts > 0], 0.95) if counts.any() else 1.0
    # In single precision: pictures of double precision take three times as long to draw.
    ink = np.minimum(np.log1p(counts.astype(np.float32)) / np.float32(np.log1p(full)), np.float32(1.0))
    return DensityMap(ink.reshape(shape[::-1]), (low[0], low[0] + shape[0] * cell, low[1], low[1] + shape[1] * cell))
