# SPDX-License-Identifier: Apache-2.0
"""Style shared by all figures: items differ in marker or line style, never in colour alone."""
import math

import numpy as np

from ..core.geometry.se2 import SE2

GREY, BLUE = '#999999', '#0b3d66'
TRUE_COLOR = '#007a5a'
REFERENCE = {'color': GREY, 'linewidth': 5.0, 'alpha': 0.6, 'solid_capstyle': 'butt'}
CURRENT = {'color': BLUE, 'linewidth': 1.6, 'linestyle': (0, (4, 2))}
"""Line styles of the two scans, chosen so that both remain visible if the second lies on the first."""
REFERENCE_POINTS = {'color': GREY, 'marker': 'o', 'markersize': 3.5, 'markerfacecolor': 'none', 'linestyle': 'none'}
CURRENT_POINTS = {'color': BLUE, 'marker': '.', 'markersize': 3.0, 'linestyle': 'none'}
PALE = {'markersize': 2.0, 'alpha': 0.5}
MATCHED_REFERENCE = {'color': '#007a5a', 'linewidth': 7.0, 'alpha': 0.45, 'solid_capstyle': 'butt', 'zorder': 3.0}
MATCHED_CURRENT = {'color': '#007a5a', 'linewidth': 2.4, 'zorder': 3.1}
"""Line styles of the matched segments, drawn on top of all others."""
RIVAL_POINTS = {'color': '#d55e00', 'marker': 'x', 'markersize': 2.5, 'markeredgewidth': 0.5, 'linestyle': 'none'}
REFERENCE_LANDMARKS = {'color': GREY, 'marker': 'o', 'markersize': 13.0, 'markerfacecolor': 'none', 'linestyle': 'none'}
CURRENT_LANDMARKS = {'color': BLUE, 'marker': 'D', 'markersize': 9.0, 'markerfacecolor': 'none', 'linestyle': 'none'}
POINTS = {'color': BLUE, 'marker': '.', 'markersize': 3.0, 'linestyle': 'none'}
CLUSTERS = tuple({'color': color, 'marker': marker, 'markersize': 6.5, 'markerfacecolor': 'none', 'linestyle': 'none'}
                 for color, marker in (('#d55e00', 'o'), (BLUE, 's'), ('#007a5a', '^'), ('#8a3d7a', 'D')))
"""Marker styles of the heaviest clusters, in the order of their weight."""
REST = {'color': '#777777', 'marker': '.', 'markersize': 3.0, 'linestyle': 'none'}
SENSOR = {'color': 'black', 'markeredgecolor': 'white', 'markersize': 11.0, 'linestyle': 'none'}
RESULT = {'color': 'black', 'linestyle': (0, (6, 3)), 'linewidth': 1.2}
EPS = {'color': '#8a3d7a', 'linestyle': ':', 'linewidth': 1.8}


def panels(figure, *rows, widths=None) -> dict:
    """Return axes by name, laid out in `rows` of names, and below them a strip of axes named ``legend``."""
    heights = [1.0] * len(rows) + [0.1 * len(rows)]
    return figure.subplot_mosaic([*map(list, rows), ['legend'] * len(rows[0])],
                                 gridspec_kw={'height_ratios': heights, 'width_ratios': widths})


def legend(axes, columns, *sources):
    """Draw one legend of all that the axes `sources` show into the separate `axes`."""
    shown = {}
    for source in sources:
        for handle, label in zip(*source.get_legend_handles_labels(), strict=True):
            if np.isfinite(np.asarray(handle.get_xdata(), dtype=float)).any():
                shown.setdefault(label, handle)
    axes.axis('off')
    axes.legend(shown.values(), shown.keys(), loc='center', ncol=columns, frameon=False)


def plane(axes, title, low=None, high=None):
    """Give both axes of a plan the same scale, with limits around all that is drawn or from `low` to `high` [m]."""
    axes.set(title=title, xlabel='x [m]', ylabel='y [m]')
    if low is None:
        axes.set_aspect('equal', adjustable='datalim')
    else:
        axes.set_aspect('equal', adjustable='box')
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    grid(axes)


def alike(*axes):
    """Give all plans the same limits, which contain everything that is drawn in any plan."""
    corners = np.concatenate([each.dataLim.get_points() for each in axes])
    for each in axes:
        each.update_datalim(corners[np.isfinite(corners).all(axis=1)])
        each.autoscale_view()


def draw_sensor(axes, pose=SE2(), label='sensor', **style):
    """Draw a triangle at the `pose` of a sensor; its tip points along the x axis of the sensor."""
    axes.plot(pose.x, pose.y, marker=(3, 0, math.degrees(pose.theta) - 90.0), label=label, zorder=4.0, **SENSOR | style)


def drawn(*axes):
    """Return the lower left and the upper right corner ``(2,)`` of the area drawn in any plan, with a margin."""
    corners = np.concatenate([each.dataLim.get_points() for each in axes])
    corners = corners[np.isfinite(corners).all(axis=1)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.05 * (high - low).max()
    return low - margin, high + margin


def grid(axes):
    """Draw thin grid lines at the ticks of the axes."""
    axes.grid(linewidth=0.3, alpha=0.6)
    axes.locator_params(steps=(1, 2, 5, 10))
    axes.locator_params(axis='x', nbins=5)


def draw_segments(axes, segments, style, label, chosen=slice(None), moved=SE2()):
    """Draw the `chosen` line segments, transformed by the motion `moved`, with one entry in the legend."""
    start, end = segments.start[chosen], segments.end[chosen]
    ends = moved.apply(np.stack((start, end, np.full_like(end, np.nan)), axis=1))
    axes.plot(*ends.reshape(-1, 2).T, label=label, **style)
