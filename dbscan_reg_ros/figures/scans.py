# SPDX-License-Identifier: Apache-2.0
"""Draw the points of the scans (Figure 2), and their segments, breakpoints and ends (Figures 3 and 5)."""
import numpy as np

from ..core.features.records import EndKind
from ..core.features.ring_band import Outcome
from .style import BLUE, POINTS, REST, alike, draw_segments, draw_sensor, legend, panels, plane

OUTCOMES = {
    Outcome.SMOOTHED: ('before smoothing', {'color': '#007a5a', 'marker': 'o'}),
    Outcome.CORNER: ('corner, kept', {'color': '#0b5fa5', 'marker': 's'}),
    Outcome.REMOVED: ('removed', {'color': '#d55e00', 'marker': 'x'}),
}
ENDS = {
    EndKind.CORNER: ('corner', {'color': '#d55e00', 'marker': 's'}),
    EndKind.FREE: ('free end', {'color': '#007a5a', 'marker': 'o'}),
    EndKind.OCCLUSION: ('other end', {'color': '#8a3d7a', 'marker': 'v'}),
}
OPEN = {'linestyle': 'none', 'markersize': 7.0, 'markerfacecolor': 'none', 'markeredgewidth': 1.3}

NUMBERED = 5
"""Every segment whose number is a multiple of this has the number beside it."""


def draw_points(figure, steps):
    """Draw both scans after the ring band filter, and the points that it judged, each where it was measured."""
    axes = panels(figure, [name for name, _ in steps.scans])
    for name, scan in steps.scans:
        panel = axes[name]
        panel.plot(*scan.filtered.T, label='after the filter', **POINTS)
        for outcome, (label, style) in OUTCOMES.items():
            panel.plot(*scan.measured[scan.outcome == outcome].T, label=label, **OPEN | style)
        draw_sensor(panel)
        counts = [np.count_nonzero(scan.outcome == outcome) for outcome in OUTCOMES]
        plane(panel, '{}: {} smoothed, {} corners kept, {} removed'.format(name, *counts))
    both = [axes[name] for name, _ in steps.scans]
    alike(*both)
    legend(axes['legend'], 5, *both)


def draw_scan_segments(figure, steps):
    """Draw the segments of both scans, the breakpoints between surfaces, and the kind of each segment end."""
    axes = panels(figure, [name for name, _ in steps.scans])
    for name, scan in steps.scans:
        panel, segments, points = axes[name], scan.features.segments, scan.features.points
        panel.plot(*points.T, label='point', **REST)
        draw_segments(panel, segments, {'color': BLUE, 'linewidth': 2.0}, 'segment')
        torn = np.union1d(np.flatnonzero(scan.breaks), np.flatnonzero(scan.breaks) + 1)
        panel.plot(*points[torn].T, label='points beside a breakpoint',
                   **OPEN | {'color': 'black', 'marker': 'x', 'markersize': 5.0})
        for number in range(0, len(segments), NUMBERED):
            panel.annotate(str(number), segments.midpoint[number], (4.0, 4.0), textcoords='offset points')
        ends = np.concatenate((segments.start, segments.end))
        for kind, (label, style) in ENDS.items():
            panel.plot(*ends[segments.kinds.T.ravel() == kind].T, label=label, **OPEN | style)
        draw_sensor(panel)
        plane(panel, f'{name}: {len(segments)} segments, {np.count_nonzero(scan.breaks)} breakpoints')
    both = [axes[name] for name, _ in steps.scans]
    alike(*both)
    legend(axes['legend'], 7, *both)
