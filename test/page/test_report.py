# SPDX-License-Identifier: Apache-2.0
"""The page of a replay: it opens in a real browser, shows everything, and loads nothing from the network."""
import dataclasses
import re

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.known_motion import KnownMotion
from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.page.report import Report, write_report
from dbscan_reg_ros.replays.page.scan_history import ScanHistory
from dbscan_reg_ros.replays.pairs_to_review import PairsToReview, PairToReview
from dbscan_reg_ros.replays.trajectory import Trajectory

UNKNOWN = KnownMotion(None, None, None)


def text(browser, name):
    return browser.value(f'document.getElementById("{name}").textContent')


def test_bad_stretches_begin_a_pair_each_and_the_least_sure_scans_are_others(replayed):
    bad = [(pair.number, pair.status) for pair in replayed.pairs if pair.status is not Status.OK]
    assert bad == [(30, Status.DEGENERATE), (60, Status.AMBIGUOUS), (90, Status.FAILED)]
    sure = [pair for pair in replayed.pairs if pair.status is Status.OK]
    assert sorted(pair.number // 50 for pair in sure) == [0, 1]
    assert [pair.number for pair in replayed.pairs] == sorted(pair.number for pair in replayed.pairs)


def test_a_pair_to_review_shows_the_scan_where_the_odometry_lays_it(simulation):
    odometry, pairs = Odometry(), PairsToReview()
    for scan in simulation.scans[20:40]:
        pairs.add(odometry.process(scan))
    for pair in pairs.found():
        gaps = np.linalg.norm(pair.current[:, None] - pair.reference, axis=-1).min(axis=1)
        assert isinstance(pair, PairToReview) and np.median(gaps) < 0.05
        current, reference = (lines[:, 1] - lines[:, 0] for lines in (pair.current_lines, pair.reference_lines))
        cosines = (current * reference).sum(axis=1) / np.hypot(*current.T) / np.hypot(*reference.T)
        assert len(cosines) > 3 and np.abs(cosines).min() > 0.99


@pytest.mark.parametrize('dark', [False, True])
@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1400, 900)])
def test_the_page_opens_without_a_network_and_without_a_complaint(show, page, known, width, height, dark):
    browser = show(page(known, closed=True), width, height, dark)
    assert browser.value('document.body.dataset.ready') == 'yes' and browser.complaints == []
    assert {re.match(r'\w+:', address)[0] for address in browser.requests} <= {'file:', 'data:'}
    assert browser.value('document.querySelector("h1").textContent') == 'a </script> <b>name</b>'
    assert browser.value('document.documentElement.scrollWidth') == width
    assert browser.value('[...document.querySelectorAll(".plot p")].map(p => p.textContent)')[:3] == [
        'Error over the next metre: translation, against the truth',
        'Error over the next metre: rotation, against the truth', 'Status']
    plots = browser.value('''[...document.querySelectorAll(".plot svg[role=img]")].map(plot => {
        const box = plot.getBoundingClientRect();
        return [plot.getAttribute("aria-label"), box.width, box.height, box.width / plot.viewBox.baseVal.width]; })''')
    assert len(plots) == 4 and all(w > 300 and h > 100 and scale == 1.0 for _, w, h, scale in plots)
    assert plots[2][0] == 'Status over distance driven [m]: 96 OK, 2 degenerate, 1 ambiguous, 1 failed'
    assert re.fullmatch(r'Error over the next metre: translation over distance driven \[m\]: median [\d.]+ m, '
                        r'largest [\d.]+ m at scan \d+', plots[0][0])
    layers = browser.value('[...document.querySelectorAll("#layers input")].map(box => [box.id.slice(6), box.checked])')
    assert layers == [['scan', True], ['segments', False], ['covariance', True], ['trajectory', True], ['truth', True],
                      ['wheels', False], ['keyframes', False], ['loops', False], ['marks', True], ['follow', False],
                      ['closed', False]]


def test_where_nothing_moves_all_is_shown_over_the_scans(show, simulation, tmp_path):
    path, trajectory, history, scan = tmp_path / 'rest.html', Trajectory(), ScanHistory(), simulation.scans[20]
    scans = [dataclasses.replace(scan, stamp=scan.stamp + k * 100_000_000) for k in range(20)]
    for update in trajectory.follow(scans, Odometry()):
        history.add(update)
    truth = np.array(trajectory.stamps), np.zeros((20, 3))
    density = density_map(scans, trajectory.poses)
    write_report(path, Report('rest', [], KnownMotion(truth, None, None), trajectory, density, [], Parameters(),
                              history=history))
    browser = show(path)
    assert browser.value('data.drive.along.label') == 'scan' and browser.value('[...drive.along]') == list(range(20))
    assert ('No part of the trajectory is long enough for a comparison with the known motion.'
            in text(browser, 'nothing'))
    assert browser.complaints == []


def test_changed_parameters_stand_out(show, page):
    browser = show(page(parameters=Parameters().replace({'advanced.rotation.eps': 0.02})))
    assert text(browser, 'changes') == '1 not at the default, in bold.'
    assert browser.value('document.querySelector("#parameters .changed").textContent').startswith(
        'advanced.rotation.eps0.02 raddefault 0.0')
    assert browser.value('document.querySelectorAll("#parameters tr").length') == len(Parameters.describe())


@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1400, 900)])
def test_an_empty_page_states_that_nothing_is_known(show, tmp_path, width, height):
    path = tmp_path / 'empty.html'
    write_report(path, Report('nothing', [], UNKNOWN, Trajectory(), density_map([], []), [], Parameters()))
    browser = show(path, width, height)
    assert browser.complaints == [] and browser.value('document.body.dataset.ready') == 'yes'
    assert text(browser, 'nothing') == 'The true motion is unknown.'
    assert text(browser, 'hint') == 'There is nothing to review.'
    assert text(browser, 'changes') == 'All at their defaults.'


def test_the_page_holds_what_the_odometry_found(show, page, known, replayed):
    """Poses, statuses, covariances, returns and segments of a scan, as the script reads them."""
    browser = show(page(known))
    assert browser.value('drive.count') == 100
    np.testing.assert_allclose(browser.value('[...drive.pose]'), replayed.trajectory.pose_array().ravel(), atol=1e-5)
    update = replayed.updates[42]
    points, segments = browser.value('''[[...drive.points.subarray(2 * drive.firstPoint[42], 2 * drive.firstPoint[43])],
        [...drive.segments.subarray(4 * drive.firstSegment[42], 4 * drive.firstSegment[43])]]''')
    scan, found = update.features.scan, update.features.segments
    np.testing.assert_allclose(0.005 * np.reshape(points, (-1, 2)), scan.points[scan.valid], atol=0.0026)
    np.testing.assert_allclose(0.005 * np.reshape(segments, (-1, 4)), np.hstack((found.start, found.end)), atol=0.0026)
    long, short, direction, turn = browser.value('[...drive.sigma.subarray(168, 172)]')
    c, s = np.cos(direction), np.sin(direction)
    axes = np.array(((c, -s), (s, c)))
    covariance = axes @ np.diag((long**2, short**2)) @ axes.T
    np.testing.assert_allclose(covariance, update.covariance[:2, :2], rtol=1e-3, atol=1e-9)
    assert turn == pytest.approx(np.sqrt(update.covariance[2, 2]), rel=1e-5)
    numbers = browser.value('[...drive.status].map(level => data.drive.statusNames[level])')
    assert numbers == [status.value for status in replayed.trajectory.statuses]
    assert browser.value('drive.reference[42]') == update.reference_number
    errors = browser.value('[...drive.plots[0].values].map(value => isNaN(value) ? -1 : value)')
    assert 0.0 < np.max(errors) < 0.1


def test_the_page_holds_where_the_drive_is_in_a_given_map(show, page, in_map, replayed):
    browser = show(page(in_map=in_map))
    names = browser.value('[...drive.inMap.state].map(level => data.drive.inMap.stateNames[level])')
    assert names == [moment.state.value for moment in in_map.moments] and names[-1] == 'localised'
    np.testing.assert_allclose(browser.value('[...drive.inMap.pose.subarray(297)]'),
                               replayed.trajectory.pose_array()[99], atol=0.05)
    np.testing.assert_allclose(browser.value('[...drive.inMap.places(50)]'),
                               (1.0, 0.5, 0.2, 0.48, 3.0, -0.5, -2.0, 0.41), rtol=1e-6)
    long, short, *_ = browser.value('[...drive.inMap.sigma.subarray(396, 400)]')
    assert long**2 + short**2 == pytest.approx(np.trace(in_map.moments[99].covariance[:2, :2]), rel=1e-5)
    assert browser.value('[...drive.inMap.pose.subarray(153, 156)].every(Number.isNaN)')
    left, right, bottom, top = browser.value('data.knownMap.extent')
    x, y, _ = replayed.trajectory.pose_array().T
    assert left < x.min() and x.max() < right and bottom < y.min() and y.max() < top
    counts = ', '.join(f'{names.count(state)} {state.replace("this ", "")}' for state in (
        'searching', 'localised', 'ambiguous', 'not in this map'))
    assert browser.value('document.querySelector("#plot-in-map svg").getAttribute("aria-label")') == (
        f'State in the given map over distance driven [m]: {counts}')
