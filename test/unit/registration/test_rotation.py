# SPDX-License-Identifier: Apache-2.0
"""Rotation: clusters of angle differences (Eq. 9)."""
import math

import numpy as np
import pytest
from rooms import L_ROOM, look, outline

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.records import Segments
from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.parameters.registration import RotationParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.clustering.rotation import estimate_rotations, pair_weights

DEFAULT = RotationParameters()


def lines(directions, lengths=None):
    """Segments with the given directions [rad], 1 m long where no lengths are given."""
    directions = np.asarray(directions, dtype=float)
    lengths = np.ones(len(directions)) if lengths is None else np.asarray(lengths, dtype=float)
    end = lengths[:, None] * np.stack((np.cos(directions), np.sin(directions)), axis=1)
    small = np.full(len(directions), 1e-3)
    return Segments(np.zeros_like(end), end, wrap(directions), lengths, small, small,
                    np.zeros((len(directions), 2), dtype=int), np.zeros((len(directions), 2), dtype=int))


def rotations(reference, current, parameters):
    return estimate_rotations(reference, current, pair_weights(reference, current, parameters), parameters)


def unweighted(reference, current, **changes):
    return estimate_rotations(reference, current, np.ones((len(reference), len(current))),
                              RotationParameters(**changes))


def segments_of(pose, **changes):
    return extract_features(look(outline(L_ROOM), pose, **changes), Parameters()).segments


@pytest.mark.parametrize('degrees', (-180, -90, -40, 0, 20, 100, 160))
def test_directed_lines_tell_every_rotation(degrees):
    """All the way round, half-turns included, without an initial guess."""
    phi = math.radians(degrees)
    found = rotations(segments_of(SE2()), segments_of(SE2(0.2, -0.1, phi), noise=0.005), DEFAULT)
    off = np.abs(wrap(found.phi - phi))
    assert off.min() < 0.01
    assert (np.diff(found.weight) <= 0.0).all()


def differences(values):
    """Two scans whose angle differences are the given ones."""
    return lines(values), lines([0.0])


def test_the_knee_lies_where_the_graph_turns_flat():
    """Twenty samples 0.01 apart, five far from everything: the graph falls steeply and then runs at 0.01."""
    values = np.concatenate(([-2.0, -1.2, 1.0, 1.9, 2.7], 0.01 * np.arange(20)))
    assert unweighted(*differences(values), eps=0.0).eps == pytest.approx(0.01)
    for least, few in ((0.02, [0.0, 0.02, 0.04, 0.06]), (0.04, [0.0, 0.04])):
        assert unweighted(*differences(few), eps=0.0).eps == pytest.approx(least)


def test_a_cluster_across_the_seam_is_one():
    values = [math.pi - 0.02, math.pi - 0.01, -math.pi + 0.005, -math.pi + 0.025]
    found = unweighted(*differences(values), eps=0.03)
    assert len(found.phi) == 1
    assert found.weight[0] == 4.0
    assert abs(wrap(found.phi[0] - math.pi)) < 1e-9


def test_a_chain_is_cut_where_a_width_is_given_and_never_without():
    """Two motions 0.1 rad apart and a bridge between them."""
    values = [0.0, 0.001, 0.002, 0.003, 0.035, 0.068, 0.1, 0.101, 0.102, 0.103]
    whole = unweighted(*differences(values), eps=0.04, max_width=0.0)
    assert len(whole.phi) == 1
    parts = unweighted(*differences(values), eps=0.04, max_width=0.05)
    np.testing.assert_allclose(np.sort(parts.phi[:2]), [0.0015, 0.1015], atol=1e-9)


def test_no_more_hypotheses_than_asked_for_heaviest_first():
    values = [0.0, 0.0, 0.0, 1.0, 1.0, 2.0]
    found = unweighted(*differences(values), max_hypotheses=2)
    np.testing.assert_allclose(found.phi, [0.0, 1.0])
    np.testing.assert_array_equal(found.weight, [3.0, 2.0])
    np.testing.assert_array_equal(found.labels[:, 0], [0, 0, 0, 1, 1, -1])
