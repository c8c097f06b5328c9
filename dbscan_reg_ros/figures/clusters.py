# SPDX-License-Identifier: Apache-2.0
"""Draw the clustered samples of the registration: angle differences (Figure 6) and translations (Figure 8)."""
import numpy as np

from .style import CLUSTERS, EPS, REST, RESULT, TRUE_COLOR, grid, legend, panels, plane

CLOSE_ANGLE = 8.0
"""Half the width [deg] of the enlarged plot of the angle differences."""
CLOSE = 0.4
"""Half the side [m] of the enlarged plot of the translations."""
TRUE = {'color': TRUE_COLOR, 'linestyle': ':', 'linewidth': 1.8}


def draw_rotation(figure, steps):
    """Draw the angle differences of all pairs of segments with their clusters, and the k-dist graph with eps."""
    rotations, result, truth = steps.rotations, np.degrees(steps.registration.transform.theta), steps.truth
    axes = panels(figure, ['all', 'all'], ['close', 'graph'])
    row = np.broadcast_to(np.arange(len(rotations.difference))[:, None], rotations.difference.shape)
    for panel in (axes['all'], axes['close']):
        for label, members, style in _clusters(rotations, range(len(rotations.phi)), rotations.labels, ' m'):
            panel.plot(np.degrees(rotations.difference[members]), row[members], label=label, **style)
        panel.axvline(result, label=_result(steps), **RESULT)
        if truth is not None:
            panel.axvline(np.degrees(truth.theta), label='true', **TRUE)
        panel.set(xlabel='angle difference [deg]', ylabel="reference's segment")
        grid(panel)
    title = (f'{rotations.difference.size} angle differences{_stage(steps)}; clusters followed: '
             f'{_count(len(rotations.phi))}')
    axes['all'].set(title=title, xlim=(-185.0, 185.0), xticks=range(-180, 181, 45))
    axes['close'].set(title='close to the result', xlim=(result - CLOSE_ANGLE, result + CLOSE_ANGLE))
    _k_distances(axes['graph'], steps)
    legend(axes['legend'], 4, axes['all'], axes['graph'])


def _k_distances(axes, steps):
    distances, k = steps.rotation_distances()
    eps = np.degrees(steps.rotations.eps)
    axes.plot(np.arange(1, len(distances) + 1), np.degrees(distances), color='black', linewidth=1.2)
    axes.axhline(eps, label='eps', **EPS)
    given = steps.by_paper or steps.parameters.rotation.eps
    origin = 'as given' if given else 'from the knee, within its bounds'
    axes.set(title=f'eps {eps:.2f} deg, {origin}', xlabel='rank by the distance to the k-th neighbour',
             ylabel=f'distance, k = {k} [deg]', ylim=(0.0, max(3.0 * eps, 0.1)))
    grid(axes)


def draw_translation(figure, steps):
    """Draw the translation samples from lines and end points, for the rotation hypothesis nearest to the result."""
    samples, result, truth = steps.translations, steps.registration.transform, steps.truth
    axes = panels(figure, ['all', 'close'])
    own = samples.rotation == steps.rotation
    ranked = np.unique(samples.labels[own & (samples.labels >= 0)])
    place = np.array([(result.x, result.y)])
    shown = np.concatenate((place, np.quantile(samples.samples[own], (0.05, 0.95), axis=0) if own.any() else place))
    middle, half = 0.5 * (shown.min(axis=0) + shown.max(axis=0)), 0.5 * np.ptp(shown, axis=0).max() + CLOSE
    inside = (np.abs(samples.samples - middle) <= half).all(axis=1)
    for panel in axes['all'], axes['close']:
        panel.plot(*samples.samples[~own].T, label='with another rotation', **REST | {'color': '#cccccc'})
        for label, members, style in _clusters(samples, ranked, np.where(own, samples.labels, -2)):
            outside = '' if inside[members].any() else ', outside'
            panel.plot(*samples.samples[members].T, label=f'{label}{outside}', **style)
        panel.axvline(result.x, label=_result(steps), **RESULT)
        panel.axhline(result.y, **RESULT)
        if truth is not None:
            panel.axvline(truth.x, label='true', **TRUE)
            panel.axhline(truth.y, **TRUE)
    rotation = '' if steps.rotation is None else f' {np.degrees(steps.rotations.phi[steps.rotation]):.2f} deg'
    title = (f'{np.count_nonzero(own)} translations{_stage(steps)}, rotation{rotation},\n'
             f'nearest to the result; clusters: {_count(len(ranked))}')
    plane(axes['all'], title, middle - half, middle + half)
    plane(axes['close'], f'close to the result; eps {samples.eps:.3f} m', place[0] - CLOSE, place[0] + CLOSE)
    legend(axes['legend'], 4, axes['all'])


def explain_translation(steps):
    """Return the caption of the translation samples."""
    ends = '' if steps.by_paper else ', and so does a pair of end points'
    return (f'Two pairs of lines give a sample{ends}. '
            'Near the true translation usually many samples agree.'
            + (' The divergences of the densities select one cluster.' if steps.by_paper else ''))


def _stage(steps):
    """Return the stage of the search that is drawn, as a text; the method of the paper has one stage."""
    return '' if steps.by_paper else ' of the normal search'


def _result(steps):
    """Return the name of the result in legends: the method of the paper does not refine it."""
    return 'result' if steps.by_paper else 'result, refined'


def _count(clusters):
    """Return the number of `clusters`, and how many of them have markers of their own, as a text."""
    return f'{clusters}, the heaviest {len(CLUSTERS)} marked' if clusters > len(CLUSTERS) else f'{clusters}'


def _clusters(hypotheses, ranked, labels, unit=''):
    """Yield (name, mask of samples, style) of the heaviest clusters, listed first in `ranked`, and of the rest."""
    leading = list(ranked)[:len(CLUSTERS)]
    yield 'other clusters', (labels >= -1) & ~np.isin(labels, leading), REST
    for rank, (number, style) in enumerate(zip(leading, CLUSTERS), 1):
        members = labels == number
        count = np.count_nonzero(members)
        weight = f'{hypotheses.weight[number]:.3g}{unit}'
        yield f'cluster {rank}: {count} sample{"" if count == 1 else "s"}, weight {weight}', members, style
