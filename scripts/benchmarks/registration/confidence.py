# SPDX-License-Identifier: Apache-2.0
"""Confidence of registrations without a guess: its calibration, and the fit of the coefficients of its model."""
import itertools
import math

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.confidence.assessment import evidence_of
from dbscan_reg_ros.core.registration.confidence.evidence import evidence_terms
from dbscan_reg_ros.core.registration.confidence.model import (
    COEFFICIENTS,
    PLACE_COEFFICIENTS,
    PLACE_INTERCEPT,
    confidence,
)
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.problem import Problem, SearchStage
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.simulation import LIDARS

from ..intel import Intel
from ..report import Report
from ..trials import ROTATION_LIMIT, TRANSLATION_LIMIT, Trial
from . import gaps
from .gaps import intel_matches, simulated_matches
from .overlap import MOTIONS, NOISES, WORLDS, Cell, pairs

FITTED, HELD_OUT = (1, 2), (4,)
"""Seeds of `overlap.pairs`: those that the coefficients are fitted to, and those that they are checked with."""
PAIRS = 6
"""Of each class, cell and seed."""
BINS, FOLDS = 10, 4
REGULARISATION = 1.0
"""Strength of the penalty on the coefficients of terms in units of their standard deviations."""
INTEL_PAIRS, INTEL_WEIGHT, INTEL_X, INTEL_Y = 1500, 2.0, 5.0, 2.0
"""Random pairs of the Intel log, half of them for the fit, their weight in it, and their largest distances [m]."""
PLACES_FITTED, PLACES_HELD_OUT = range(6), range(20, 23)
"""Seeds of the drives with gaps."""
FEWEST = 100
"""Pairs in a bin that is judged."""


def is_right(trial, transform) -> bool:
    """Whether a motion is within 0.10 m and 2 deg of the truth."""
    error = trial.truth.inverse() @ transform
    return math.hypot(error.x, error.y) <= TRANSLATION_LIMIT and abs(error.theta) <= ROTATION_LIMIT


def features_of(trial):
    """Return the features of both scans of a `Trial`; None where one of them has too few returns."""
    try:
        return [extract_features(scan, Parameters()) for scan in (trial.reference, trial.current)]
    except ScanError:
        return None


def judged(trials) -> list:
    """Return (confidence, right, OK) of the registration of each of the `Trial`s."""
    results = []
    for trial in trials:
        features = features_of(trial)
        if features:
            found = register(*features)
            results.append((found.confidence, is_right(trial, found.transform), found.status is Status.OK))
    return results


def hypotheses(trials) -> list:
    """Return (terms, right) of the hypotheses of the wide search for each of the `Trial`s, ``(H, T)`` and ``(H,)``."""
    results = []
    for trial in trials:
        features = features_of(trial)
        found = register(*features, first_stage=SearchStage.WIDE).hypotheses if features else ()
        if found:
            candidates = np.array([each.transform.as_array() for each in found])
            evidence = evidence_of(Problem(*features, Parameters()), candidates)
            results.append((np.array([evidence_terms(each) for each in evidence]),
                            np.array([is_right(trial, each.transform) for each in found])))
    return results


def intel_pairs(intel, part) -> list:
    """Return `Trial`s of the Intel log that are x within 5 m and y within 2 m apart: the even or the odd ones."""
    rng, found = np.random.default_rng(0), []
    while len(found) < INTEL_PAIRS:
        i, j = rng.integers(len(intel.reference), size=2)
        truth = SE2.from_array(intel.reference[i]).inverse() @ SE2.from_array(intel.reference[j])
        if i != j and abs(truth.x) <= INTEL_X and abs(truth.y) <= INTEL_Y:
            found.append(Trial('intel', f'{i} {j}', intel.scans[i], intel.scans[j], truth))
    return found[part::2]


def of_cell(rows, cell, wanted, seed) -> list:
    """Return the `rows`, `judged` or `hypotheses`, of the pairs of a cell."""
    return rows(pairs(cell, wanted, seed))


def of_cells(rows, args, seeds) -> list:
    """Return the `rows`, `judged` or `hypotheses`, of all cells and seeds."""
    from tqdm import tqdm

    cells = [Cell(*words) for words in itertools.product(LIDARS, WORLDS, MOTIONS, NOISES)]
    with workers(args.processes) as executor:
        jobs = [executor.submit(of_cell, rows, cell, args.limit or PAIRS, seed) for cell in cells for seed in seeds]
        return [row for job in tqdm(jobs, 'confidence', unit=' cells', leave=False, disable=None)
                for row in job.result()]


def after_gaps(args, seeds, intel, half) -> list:
    """Return (terms, right) of first scans after gaps in simulated drives of these seeds, and in half of Intel."""
    with workers(args.processes) as executor:
        jobs = [executor.submit(simulated_matches, lidar, kind, seed)
                for lidar in gaps.SENSORS for kind in gaps.WORLDS for seed in seeds]
        return [row for job in jobs for row in job.result()] + intel_matches(intel, half)


def balanced(found):
    """Return weights with which right and wrong ones weigh the same."""
    right = np.array([some[0] for _, some in found])
    return np.where(right, 0.5 / right.mean(), 0.5 / (1.0 - right.mean()))


def fit(found, weight) -> tuple:
    """Fit the model of the confidence; return the intercept and the coefficients of the terms.

    The likelihood is that of the logistic regression, whether any hypothesis is right by the terms of the best one,
    times the probability of the right one among all, where there is one.

    Parameters
    ----------
    found : list of (terms, right)
        From `hypotheses`.
    weight : (N,) array
        Of each pair.
    """
    from scipy.optimize import minimize

    table = np.concatenate([terms for terms, _ in found])
    mean, spread = table.mean(axis=0), table.std(axis=0)
    scaled = [((terms - mean) / spread, right) for terms, right in found]

    def loss(values):
        total, gradient = 0.5 * REGULARISATION * values[1:] @ values[1:], REGULARISATION * values
        gradient[0] = 0.0
        for (terms, right), each in zip(scaled, weight, strict=True):
            odds = values[0] + terms @ values[1:]
            best, some = int(odds.argmax()), bool(right.any())
            slope = np.zeros(len(odds))
            total += each * np.logaddexp(0.0, -odds[best] if some else odds[best])
            slope[best] = 1.0 / (1.0 + np.exp(-odds[best])) - some
            if some:
                share = np.exp(odds - odds[best])
                total -= each * np.log(share[right].sum() / share.sum())
                slope += share / share.sum() - share * right / share[right].sum()
            gradient[0] += each * slope.sum()
            gradient[1:] += each * slope @ terms
        return total, gradient

    values = minimize(loss, np.zeros(1 + len(mean)), jac=True, method='L-BFGS-B').x
    coefficients = values[1:] / spread
    return float(values[0] - coefficients @ mean), coefficients


def cross_validated(found, weight) -> tuple:
    """Return confidence, right and OK of the best hypothesis of each pair, by a fit to the other folds of the pairs."""
    results, folds = [], np.arange(len(found)) * FOLDS // len(found)
    for fold in range(FOLDS):
        inside = folds == fold
        intercept, coefficients = fit([found[k] for k in np.flatnonzero(~inside)], weight[~inside])
        for k in np.flatnonzero(inside):
            terms, right = found[k]
            odds = intercept + terms @ coefficients
            best = int(odds.argmax())
            results.append((confidence(float(odds[best]), np.delete(odds, best).tolist()), right[best]))
    certainty, right = (np.array(part) for part in zip(*results, strict=True))
    return certainty, right, certainty >= Parameters().decision.min_confidence


def coefficient_lines(intercept, coefficients, names=COEFFICIENTS, prefix='') -> str:
    """Format fitted coefficients as they stand in `confidence/model.py`."""
    return '\n'.join([f'{prefix}INTERCEPT = {intercept:.3f}', f'{prefix}COEFFICIENTS = {{',
                      *(f'    {name!r}: {value:.3f},' for name, value in zip(names, coefficients, strict=True)),
                      '}'])


def calibration(confidence, right) -> tuple:
    """Compare expected and observed fractions of right results in bins of the confidence.

    Returns
    -------
    metrics : dict
        Of each bin: number of pairs, expected and observed fraction; and the largest difference of those with at least
        100 pairs.
    text : str
    """
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    metrics, lines, worst = {}, [f'{"confidence":12}{"pairs":>8}{"expected":>10}{"observed":>10}  [%]'], 0.0
    for k in range(BINS):
        inside = bins == k
        if inside.any():
            name = f'{k / BINS:.1f}-{(k + 1) / BINS:.1f}'
            expected, observed = confidence[inside].mean(), right[inside].mean()
            metrics |= {f'{name}_count': int(inside.sum()), f'{name}_expected': float(expected),
                        f'{name}_observed': float(observed)}
            lines.append(f'{name:12}{inside.sum():8d}{100 * expected:10.1f}{100 * observed:10.1f}')
            if inside.sum() >= FEWEST:
                worst = max(worst, abs(float(expected - observed)))
    return metrics | {'worst_difference': worst}, '\n'.join(lines)


def measure(args) -> Report:
    """Fit the coefficients, or check the confidence with pairs that they were not fitted to."""
    report, intel = Report(), Intel.below(args.data)
    if args.fit:
        simulated, real = of_cells(hypotheses, args, FITTED), hypotheses(intel_pairs(intel, 0))
        weight = np.repeat((1.0, INTEL_WEIGHT), (len(simulated), len(real)))
        places = after_gaps(args, PLACES_FITTED, intel, 0)
        report.tables += [coefficient_lines(*fit(simulated + real, weight)),
                          summary(*cross_validated(simulated + real, weight))[1],
                          coefficient_lines(*fit(places, balanced(places)), PLACE_COEFFICIENTS, 'PLACE_')]
        return report
    report.metrics['dbscan'] = {}
    for name, found in (('simulated', of_cells(judged, args, HELD_OUT)), ('intel', judged(intel_pairs(intel, 1)))):
        metrics, text = summary(*map(np.array, zip(*found, strict=True)))
        report.metrics['dbscan'].update({f'{name}_{key}': value for key, value in metrics.items()})
        report.tables.append(f'{name}\n{text}')
    metrics, text = places_summary(after_gaps(args, PLACES_HELD_OUT, intel, 1))
    report.metrics['dbscan'].update(metrics)
    report.tables.append(text)
    return report


def places_summary(found) -> tuple:
    """Return the metrics and the text of first scans after gaps: how many are taken to be from the place they fit."""
    terms, right = (np.concatenate(part) for part in zip(*found, strict=True))
    odds = PLACE_INTERCEPT + terms @ np.array([*PLACE_COEFFICIENTS.values()])
    believed = odds > 0.0
    metrics = {'place_recall': float(believed[right].mean()), 'place_wrong': float(believed[~right].mean())}
    return metrics, (f'first scans after gaps: {right.sum()} in the right place, of these believed '
                     f'{100 * metrics["place_recall"]:.1f} %; {(~right).sum()} wrong or from another place, of these '
                     f'{100 * metrics["place_wrong"]:.1f} %')


def summary(confidence, right, ok) -> tuple:
    """Return the metrics and the text of the `calibration`, of precision and of recall."""
    metrics, text = calibration(confidence, right)
    metrics |= {'right': float(right.mean()), 'precision': float(right[ok].mean()), 'recall': float(ok[right].mean())}
    return metrics, (f'{text}\n{len(right)} pairs: right {100 * metrics["right"]:.1f} %, of OK '
                     f'{100 * metrics["precision"]:.1f} %; right ones called OK {100 * metrics["recall"]:.1f} %')
