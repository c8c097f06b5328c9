# SPDX-License-Identifier: Apache-2.0
"""Confidence of registrations without a guess: its calibration, and the fit of the coefficients of its model."""
import itertools
import math
import os

import numpy as np

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.confidence.model import TERMS
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.registration.search import SearchStage
from dbscan_reg_ros.simulation import LIDARS

from ..intel import Intel
from ..report import Report
from ..trials import ROTATION_LIMIT, TRANSLATION_LIMIT, Trial
from .overlap import MOTIONS, NOISES, WORLDS, Cell, pairs

FITTED, HELD_OUT = (1, 2, 3), (4,)
"""Seeds of `overlap.pairs`: those that the coefficients are fitted to, and those that they are checked with."""
PAIRS = 6
"""Of each class, cell and seed."""
BINS = 10
REGULARISATION = 1.0
"""Inverse strength of the penalty on the coefficients of terms in units of their standard deviations."""
INTEL_PAIRS, INTEL_WEIGHT, INTEL_X, INTEL_Y = 1500, 3.0, 5.0, 2.0
"""Random pairs of the Intel log, half of them for the fit, their weight in it, and their largest distances [m]."""
FEWEST = 100
"""Pairs in a bin that is judged."""


def is_right(trial, transform) -> bool:
    """Whether a motion is within 0.10 m and 2 deg of the truth."""
    error = trial.truth.inverse() @ transform
    return math.hypot(error.x, error.y) <= TRANSLATION_LIMIT and abs(error.theta) <= ROTATION_LIMIT


def registrations(trial, fitting):
    """Yield the results for a `Trial`; for the fit those of the normal and of the wide search."""
    parameters = Parameters()
    try:
        reference, current = (extract_features(scan, parameters) for scan in (trial.reference, trial.current))
    except ScanError:
        return
    if fitting:
        normal = parameters.replace({'advanced.selection.wide_search_factor': 1})
        yield register(reference, current, normal)
        yield register(reference, current, parameters, first_stage=SearchStage.WIDE)
    else:
        yield register(reference, current, parameters)


def intel_pairs(intel, part) -> list:
    """Return `Trial`s of the Intel log that are x within 5 m and y within 2 m apart: the even or the odd ones."""
    rng, found = np.random.default_rng(0), []
    while len(found) < INTEL_PAIRS:
        i, j = rng.integers(len(intel.reference), size=2)
        truth = SE2.from_array(intel.reference[i]).inverse() @ SE2.from_array(intel.reference[j])
        if i != j and abs(truth.x) <= INTEL_X and abs(truth.y) <= INTEL_Y:
            found.append(Trial('intel', f'{i} {j}', intel.scans[i], intel.scans[j], truth))
    return found[part::2]


def table(cell, wanted, seed, fitting) -> list:
    """Return the `rows` of the pairs of a cell."""
    return rows(pairs(cell, wanted, seed), fitting)


def rows(trials, fitting) -> list:
    """Return (terms, confidence, right, OK) of each registration that found something."""
    return [([term(found.evidence) for term in TERMS.values()], found.confidence, is_right(trial, found.transform),
             found.status is Status.OK)
            for trial in trials for found in registrations(trial, fitting) if found.evidence]


def tables(args, seeds, fitting) -> tuple:
    """Join the tables of all cells and seeds as arrays."""
    from tqdm import tqdm

    from dbscan_reg_ros.commands.workers import workers
    cells = [Cell(*words) for words in itertools.product(LIDARS, WORLDS, MOTIONS, NOISES)]
    with workers(args.processes or os.cpu_count()) as executor:
        jobs = [executor.submit(table, cell, args.limit or PAIRS, seed, fitting)
                for cell in cells for seed in seeds]
        return joined(row for job in tqdm(jobs, 'confidence', unit=' cells', leave=False, disable=None)
                      for row in job.result())


def joined(found) -> tuple:
    """Join `rows` as arrays."""
    return tuple(np.array(part) for part in zip(*found, strict=True))


def fit(terms, right, weight) -> tuple:
    """Fit a logistic regression to weighted results; return the intercept and the coefficients of the terms."""
    from sklearn.linear_model import LogisticRegression

    mean, spread = terms.mean(axis=0), terms.std(axis=0)
    model = LogisticRegression(C=REGULARISATION, max_iter=2000).fit((terms - mean) / spread, right, weight)
    coefficients = model.coef_[0] / spread
    return float(model.intercept_[0] - coefficients @ mean), coefficients


def coefficient_lines(intercept, coefficients) -> str:
    """Format fitted coefficients as they stand in `confidence/model.py`."""
    return '\n'.join([f'INTERCEPT = {intercept:.3f}', 'COEFFICIENTS = {',
                      *(f'    {name!r}: {value:.3f},' for name, value in zip(TERMS, coefficients, strict=True)), '}'])


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
    report = Report()
    if args.fit:
        simulated, real = tables(args, FITTED, True), joined(rows(intel_pairs(Intel.below(args.data), 0), True))
        terms, right = (np.concatenate((simulated[k], real[k])) for k in (0, 2))
        weight = np.repeat((1.0, INTEL_WEIGHT), (len(simulated[0]), len(real[0])))
        report.tables.append(coefficient_lines(*fit(terms, right, weight)))
        return report
    report.metrics['dbscan'] = {}
    for name, found in (('simulated', tables(args, HELD_OUT, False)),
                        ('intel', joined(rows(intel_pairs(Intel.below(args.data), 1), False)))):
        metrics, text = summary(*found[1:])
        report.metrics['dbscan'].update({f'{name}_{key}': value for key, value in metrics.items()})
        report.tables.append(f'{name}\n{text}')
    return report


def summary(confidence, right, ok) -> tuple:
    """Return the metrics and the text of the `calibration`, of precision and of recall."""
    metrics, text = calibration(confidence, right)
    metrics |= {'right': float(right.mean()), 'precision': float(right[ok].mean()), 'recall': float(ok[right].mean())}
    return metrics, (f'{text}\n{len(right)} pairs: right {100 * metrics["right"]:.1f} %, of OK '
                     f'{100 * metrics["precision"]:.1f} %; right ones called OK {100 * metrics["recall"]:.1f} %')
