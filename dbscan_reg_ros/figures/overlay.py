# SPDX-License-Identifier: Apache-2.0
"""Overlay of the two scans, before and after the registration, and its uncertainty (Figures 14 to 16)."""
import math

import numpy as np

from ..core.geometry.se2 import SE2
from .style import (
    CURRENT,
    CURRENT_LANDMARKS,
    CURRENT_POINTS,
    MATCHED_CURRENT,
    MATCHED_REFERENCE,
    PALE,
    REFERENCE,
    REFERENCE_LANDMARKS,
    REFERENCE_POINTS,
    RIVAL_POINTS,
    TRUE_COLOR,
    draw_segments,
    draw_sensor,
    drawn,
    legend,
    panels,
    plane,
)
from .texts import heading_text

CONFIDENCE = 0.95
SMALL = 0.1
"""Reach [m] below which the ellipse is drawn in millimetres, so that the numbers beside its axes are short."""
THIN = {'linewidth': 0.9}
TRUE_POSE = {'color': 'none', 'markeredgecolor': TRUE_COLOR, 'markersize': 16.0}


def draw_overlay(figure, steps):
    """Draw both scans before and after the registration, the matched segments and the covariance ellipse."""
    registration = steps.registration
    axes = panels(figure, ['after', 'before'], ['after', 'ellipse'], widths=[2.2, 1.0])
    matched = registration.matches
    _draw_scans(axes['before'], steps, SE2(), matched)
    _draw_scans(axes['after'], steps, registration.transform, matched)
    _draw_rival(axes['after'], steps)
    if steps.truth is not None:
        draw_sensor(axes['after'], steps.truth, 'current: true pose', **TRUE_POSE)
    low, high = drawn(axes['before'], axes['after'])
    plane(axes['before'], 'before', low, high)
    confidence = f', confidence {registration.confidence:.2f}' if registration.evidence else ''
    fit = '' if steps.by_paper else f': {100.0 * registration.overlap:.0f} % of the points fit'
    title = f'after{confidence}{fit};\n{len(matched)} pairs of segments match'
    plane(axes['after'], title, low, high)
    _draw_ellipse(axes['ellipse'], registration, steps.truth)
    legend(axes['legend'], 4, axes['after'], axes['ellipse'])


def explain_overlay(steps):
    """Return the caption of the overlay."""
    landmarks = any(len(scan.landmarks) for _, scan in steps.scans)
    return ('Matched segments should lie on each other. Other points are visible in one scan only, or have moved.\n'
            'If the match is right, the ellipse (axes of the reference) contains the true position with a '
            'probability of 95 %, if the sensor hardly moved during each scan.'
            + ('\nLandmarks are small objects, used in the wide search only.' if landmarks else ''))


def _draw_rival(axes, steps):
    """Draw the points of the current scan moved by the best rival hypothesis, if there is one."""
    for rival in steps.registration.rivals[:1]:
        points = rival.transform.apply(dict(steps.scans)['current'].features.points)
        axes.plot(*points.T, **RIVAL_POINTS,
                  label=f'current: points, moved by the best rival (score {rival.score:.2f})')


def _draw_scans(axes, steps, moved, matched):
    for column, (name, points, lines, thick, around, motion) in enumerate((
            ('reference', REFERENCE_POINTS, REFERENCE, MATCHED_REFERENCE, REFERENCE_LANDMARKS, SE2()),
            ('current', CURRENT_POINTS, CURRENT, MATCHED_CURRENT, CURRENT_LANDMARKS, moved))):
        scan = dict(steps.scans)[name]
        features = scan.features
        axes.plot(*motion.apply(features.points).T, label=f'{name}: points', **points | PALE)
        own = np.isin(np.arange(len(features.segments)), matched[:, column])
        draw_segments(axes, features.segments, lines | THIN, f'{name}: other segments', ~own, motion)
        draw_segments(axes, features.segments, thick, f'{name}: matched segments', own, motion)
        if len(scan.landmarks):
            axes.plot(*motion.apply(scan.landmarks).T, label=f'{name}: landmarks', **around)
        draw_sensor(axes, motion, f'{name}: sensor', color=lines['color'])


def _draw_ellipse(axes, registration, truth):
    """Draw the 95 % confidence ellipse of the position minus that of the result, along the axes of the reference.

    The true position is drawn as well, unless `truth` is None.
    """
    covariance, transform = registration.covariance, registration.transform
    turn = transform.rotation()
    edge = ellipse(turn @ covariance[:2, :2] @ turn.T)
    off = np.array([(truth.x - transform.x, truth.y - transform.y)]) if truth is not None else np.empty((0, 2))
    reach = 1.2 * np.abs(np.vstack((edge, off))).max()
    unit, scale = ('mm', 1000.0) if reach < SMALL else ('m', 1.0)
    heading = heading_text(covariance[2, 2], 1.96)
    axes.plot(*scale * edge.T, color='black')
    axes.plot(0.0, 0.0, '+', color='black', markersize=12.0, label='ellipse: result')
    axes.plot(*scale * off.T, 'x', color=TRUE_COLOR, markersize=10.0, label='ellipse: true position')
    plane(axes, f'position minus result, 95 %;\n{heading}', np.full(2, -scale * reach), np.full(2, scale * reach))
    axes.set(xlabel=f'x [{unit}]', ylabel=f'y [{unit}]')
    axes.locator_params(axis='x', nbins=2)


def ellipse(covariance):
    """Return points ``(N, 2)`` on the confidence ellipse of a normal distribution with mean 0 and this `covariance`."""
    variance, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * math.pi, 121)
    circle = np.stack((np.cos(angle), np.sin(angle)), axis=1) * math.sqrt(-2.0 * math.log(1.0 - CONFIDENCE))
    return circle * np.sqrt(np.maximum(variance, 0.0)) @ axes.T
