# SPDX-License-Identifier: Apache-2.0
"""Translation: pairs of line equations (Eq. 10-15)."""
import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from rooms import FOUR_WALLS, L_ROOM, look, moved, outline
from rooms import segments_between as walls

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.records import EndKind, Segments
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.registration import RotationParameters, TranslationParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.clustering import translation
from dbscan_reg_ros.core.registration.clustering.rotation import estimate_rotations, pair_weights
from dbscan_reg_ros.core.registration.clustering.translation import estimate_translations, heaviest_motions

MOTION = SE2(0.4, -0.3, 0.2)
LINES_ONLY = TranslationParameters(end_weight=0.0)


ROOM = walls(*FOUR_WALLS)


def translations(reference, current, parameters, **rotation):
    chosen = RotationParameters(**({'eps': 0.01, 'max_hypotheses': 1} | rotation))
    weights = pair_weights(reference, current, chosen)
    rotations = estimate_rotations(reference, current, weights, chosen)
    return estimate_translations(reference, current, rotations, weights, parameters)


def shortest(reference, current):
    """The shortest motion (K, 3) that aligns the lines, for the heaviest of three rotations."""
    parameters = dataclasses.replace(Parameters(), rotation=RotationParameters(eps=0.01, max_hypotheses=3))
    return heaviest_motions(SimpleNamespace(parameters=parameters, reference=SimpleNamespace(segments=reference),
                                            current=SimpleNamespace(segments=current)))[1]


def test_the_signed_form_finds_the_motion_from_lines_alone():
    found = translations(ROOM, moved(ROOM, MOTION), LINES_ONLY)
    np.testing.assert_allclose(found.transform[0], MOTION.as_array(), atol=1e-9)
    # Four lines make six pairs, all of which cross.
    np.testing.assert_allclose(found.samples, np.tile((MOTION.x, MOTION.y), (6, 1)), atol=1e-9)


@pytest.mark.parametrize('seed', range(3))
def test_the_motion_is_among_the_heaviest_hypotheses_for_a_scanned_room(seed):
    parameters = Parameters()
    scans = [look(outline(L_ROOM), pose, noise=0.01, seed=seed + 10 * i) for i, pose in enumerate((SE2(), MOTION))]
    reference, current = (extract_features(scan).segments for scan in scans)
    weights = pair_weights(reference, current, parameters.rotation)
    rotations = estimate_rotations(reference, current, weights, parameters.rotation)
    found = estimate_translations(reference, current, rotations, weights, parameters.translation)
    off = np.abs(found.transform[:10] - MOTION.as_array())
    assert (np.maximum(off[:, 0], off[:, 1]) + off[:, 2]).min() < 0.05


def test_pairs_that_hardly_cross_give_no_sample(monkeypatch):
    """eps2 as the sine of the angle between them."""
    reference = walls(((0.0, 2.0), (3.0, 2.0)), ((0.0, -2.0), (3.0 * math.cos(0.3), -2.0 + 3.0 * math.sin(0.3))))
    for crossing, count in ((math.sin(0.3) + 1e-6, 0), (math.sin(0.3) - 1e-6, 1)):
        monkeypatch.setattr(translation, 'MIN_CROSSING_SINE', crossing)
        found = translations(reference, reference, TranslationParameters(end_weight=0.0), eps=0.05)
        assert len(found.samples) == count


def test_the_ends_of_a_corridor_place_it_where_the_lines_do_not():
    """Two walls of one direction that end in the open: their ends ask for the motion along it."""
    corridor = walls(((0.0, 1.0), (5.0, 1.0)), ((5.0, -1.0), (0.0, -1.0)), kind=EndKind.FREE)
    found = translations(corridor, moved(corridor, MOTION), TranslationParameters())
    np.testing.assert_allclose(found.transform[0], MOTION.as_array(), atol=1e-9)


def test_between_parallel_walls_the_shortest_translation_leads_across_them_only():
    turn = SE2(theta=0.7)
    corridor = moved(walls(((0.0, 1.0), (5.0, 1.0)), ((5.0, -1.0), (0.0, -1.0))), turn.inverse())
    across = turn @ SE2(0.0, 0.25)
    for along in (-0.4, 0.0, 1.3):
        seen = moved(corridor, turn @ SE2(along, 0.25, 0.2) @ turn.inverse())
        x, y, theta = shortest(corridor, seen)[0]
        assert math.hypot(x - across.x, y - across.y) < 0.02 * 0.25
        assert theta == pytest.approx(0.2, abs=1e-6)


def test_where_lines_cross_the_shortest_translation_is_the_motion_and_one_wrong_pair_does_not_count():
    elsewhere = walls([(4.0, 4.0), (5.0, 4.0)])
    one, two = (Segments(*(np.concatenate(parts) for parts in zip(room.__reduce__()[1], extra.__reduce__()[1])))
                for room, extra in ((ROOM, elsewhere), (moved(ROOM, MOTION), moved(elsewhere, MOTION @ SE2(0.0, 0.8)))))
    found = shortest(one, two)
    assert found.shape == (2, 3)
    np.testing.assert_allclose(found[0], MOTION.as_array(), atol=0.03)


def test_occluded_ends_have_little_weight():
    """A corner has the weight of ten hidden ends."""
    weights = {}
    for kind in (EndKind.CORNER, EndKind.OCCLUSION):
        room = walls(((0.0, 1.0), (5.0, 1.0)), kind=kind)
        weights[kind] = translations(room, room, TranslationParameters()).sample_weight.sum()
    assert weights[EndKind.OCCLUSION] == pytest.approx(0.1 * weights[EndKind.CORNER])
