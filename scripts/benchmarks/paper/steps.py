# SPDX-License-Identifier: Apache-2.0
"""Figures 4 to 12 of the paper: its example step by step, on a scan that its own parameters solve."""
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.paper.divergence import divergences
from dbscan_reg_ros.core.paper.pipeline import KEY_CLUSTERS
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.figures.steps import Steps

from ..intel import Intel
from ..trials import run
from . import figure4
from .table3 import component_errors

PUBLISHED = {'turn_deg': 0.0, 'x_m': 0.00057, 'y_m': 0.00026, 'theta_deg': 0.0}
STEPS = {'paper': Steps.of_paper, 'dbscan': lambda *scans: Steps.of(*scans, Parameters())}


def add(report, methods, data):
    """Add the table: what each step of ours finds, then the errors of what comes out, for all methods."""
    trial = figure4.trial(Intel.below(data).scans[figure4.EXAMPLE])
    rows = {'published': PUBLISHED}
    for name, outcomes in run(methods, [trial], 'figures 4-12').items():
        x, y, theta = component_errors(outcomes)[0].tolist()
        steps = found(trial, STEPS[name](trial.reference, trial.current)) if name in STEPS else {}
        rows[name] = steps | {'x_m': x, 'y_m': y, 'theta_deg': math.degrees(theta)}
    report.add('figures 4-12', rows, {}, prefix='steps_')


def found(trial, steps) -> dict:
    """Metric -> number of the `Steps`, in the order of the figures.

    ``turn_deg`` is the error of the heaviest cluster of angle differences (6), ``samples_count`` the number of
    translations, ``true_m`` and ``opposite_m`` how far the clusters nearest to the true translation and to its opposite
    lie from them (8), ``..._kl`` the divergence of the scans as they are (9), turned (10), under the opposite
    translation (11) and under the true one (12).
    """
    phi, (x, y, theta) = steps.rotations.phi[0], trial.truth.as_array()
    key = steps.translations.transform[:KEY_CLUSTERS, :2]
    points = [scan.features.points for _, scan in steps.scans]
    poses = np.array([SE2().as_array(), (0.0, 0.0, phi), (-x, -y, phi), (x, y, phi)])
    names = 'before_kl', 'turned_kl', 'opposite_kl', 'true_kl'
    return {
        'turn_deg': math.degrees(abs(wrap(phi - theta))),
        'samples_count': len(steps.translations.samples),
        'true_m': float(np.hypot(*(key - (x, y)).T).min()),
        'opposite_m': float(np.hypot(*(key + np.array((x, y))).T).min()),
        **dict(zip(names, divergences(poses, *points).tolist(), strict=True)),
    }
