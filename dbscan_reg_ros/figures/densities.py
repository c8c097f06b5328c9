# SPDX-License-Identifier: Apache-2.0
"""Draw the densities of x and y in four states of the registration, with their divergences (Figures 9 to 12)."""
import numpy as np

from ..core.geometry.se2 import SE2
from ..core.geometry.tolerance import SIGMAS
from ..core.paper.divergence import log_density, shifted_divergences, silverman
from .style import BLUE, GREY, grid, legend, panels

PLACES = 400


def draw_densities(figure, steps):
    """Draw the kernel densities of the x and y coordinates of both scans in the four states of the paper's figures."""
    states = _states(steps.registration.transform)
    axes = panels(figure, *([f'{state} {name}' for state in states] for name in 'xy'))
    for state, motion in states.items():
        moved, total = motion.apply(steps.current.features.points), 0.0
        for name, reference, current in zip('xy', steps.reference.features.points.T, moved.T):
            panel, bandwidth = axes[f'{state} {name}'], silverman(reference)
            divergence, = shifted_divergences(reference, current, np.zeros(1), bandwidth)
            total += divergence
            _draw(panel, reference, current, bandwidth)
            panel.set(title=f'K-L divergence {divergence:.3f}', xlabel=f'{name} [m]')
            grid(panel)
        top = axes[f'{state} x']
        top.set_title(f'{state}: sum {total:.3f}\n{top.get_title()}')
    for place, panel in axes.items():
        if place != 'legend':
            panel.set_ylabel('density [1/m]')
    legend(axes['legend'], 2, axes['before x'])


def _states(result: SE2) -> dict[str, SE2]:
    """Return the motions of the current scan for which Figures 9 to 12 show the densities, by name."""
    return {'before': SE2(), 'rotated': SE2(0.0, 0.0, result.theta),
            'opposite': SE2(-result.x, -result.y, result.theta), 'after': result}


def _draw(axes, reference, current, bandwidth):
    both, margin = np.concatenate((reference, current)), SIGMAS * bandwidth
    at = np.linspace(both.min() - margin, both.max() + margin, PLACES)
    curves = [np.exp(log_density(samples, bandwidth, at)) for samples in (reference, current)]
    step = 0.07 * max(curve.max() for curve in curves)
    for row, (name, samples, curve, style) in enumerate((
            ('reference', reference, curves[0], {'color': GREY, 'linewidth': 3.5}),
            ('current', current, curves[1], {'color': BLUE, 'linewidth': 1.4, 'linestyle': '--'})), 1):
        axes.plot(at, curve, label=f'{name}: density, and below it the points', **style)
        axes.plot(samples, np.full(len(samples), -row * step), '|', color=style['color'], markersize=6.0)
