# SPDX-License-Identifier: Apache-2.0
"""The page of a replay: it opens in a real browser, shows everything, and loads nothing from the network."""
import dataclasses
import json
import re

import numpy as np
import pytest
from browser import Browser, find_browser

from dbscan_reg_ros import Odometry, Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.known_motion import KnownMotion
from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.pairs_to_review import PairsToReview, PairToReview
from dbscan_reg_ros.replays.report import Report, write_report
from dbscan_reg_ros.replays.trajectory import Trajectory
from dbscan_reg_ros.simulation import demo

STATUSES = {30: Status.DEGENERATE, 31: Status.DEGENERATE, 60: Status.AMBIGUOUS, 90: Status.FAILED}


@pytest.fixture(scope='module')
def simulation():
    return demo()


@pytest.fixture(scope='module')
def replayed(simulation):
    """A trajectory of 100 scans of which some are given bad statuses, and its pairs."""
    trajectory, pairs = Trajectory(), PairsToReview()
    for number, update in enumerate(trajectory.follow(simulation.scans[20:120], Odometry())):
        update.__dict__['status'] = trajectory.statuses[number] = STATUSES.get(number, Status.OK)
        pairs.add(update)
    return trajectory, pairs.found()


@pytest.fixture
def page(replayed, simulation, tmp_path):
    """``page(known, parameters) -> path`` of a report."""
    def page(known=KnownMotion(None, None, None), parameters=Parameters()):
        trajectory, pairs = replayed
        path = tmp_path / 'report.html'
        write_report(path, Report('a </script> <b>name</b>', [('scans', '100')], known, trajectory,
                                  density_map(simulation.scans[20:120], trajectory.poses), pairs, parameters,
                                  'show a.log'))
        return path
    return page


@pytest.fixture
def browser(tmp_path):
    if find_browser() is None:
        pytest.skip('needs a chromium on the PATH')
    browser = Browser(tmp_path / 'profile')
    yield browser
    browser.close()


def test_bad_stretches_begin_a_pair_each_and_the_least_sure_scans_are_others(replayed):
    _, pairs = replayed
    bad = [(pair.number, pair.status) for pair in pairs if pair.status is not Status.OK]
    assert bad == [(30, Status.DEGENERATE), (60, Status.AMBIGUOUS), (90, Status.FAILED)]
    sure = [pair for pair in pairs if pair.status is Status.OK]
    assert sorted(pair.number // 50 for pair in sure) == [0, 1]
    assert [pair.number for pair in pairs] == sorted(pair.number for pair in pairs)


def test_a_pair_to_review_shows_the_scan_where_the_odometry_lays_it(simulation):
    odometry, pairs = Odometry(), PairsToReview()
    for scan in simulation.scans[20:40]:
        update = odometry.process(scan)
        pairs.add(update)
    for pair in pairs.found():
        gaps = np.linalg.norm(pair.current[:, None] - pair.reference, axis=-1).min(axis=1)
        assert isinstance(pair, PairToReview) and np.median(gaps) < 0.05
        current, reference = (lines[:, 1] - lines[:, 0] for lines in (pair.current_lines, pair.reference_lines))
        cosines = (current * reference).sum(axis=1) / np.hypot(*current.T) / np.hypot(*reference.T)
        assert len(cosines) > 3 and np.abs(cosines).min() > 0.99


def test_a_pair_knows_the_scan_that_was_its_reference(simulation):
    odometry, pairs, numbers = Odometry(), PairsToReview(), {}
    for number, scan in enumerate(simulation.scans[20:80]):
        update = odometry.process(scan)
        pairs.add(update)
        numbers[number] = update.reference and simulation.scans[20:80].index(update.reference.scan)
    assert len({pair.reference_number for pair in pairs.found()}) > 1
    assert all(numbers[pair.number] == pair.reference_number for pair in pairs.found())


def test_the_page_opens_without_a_network_and_without_a_complaint(browser, page, simulation):
    truth = simulation.stamps[20:120], simulation.truth[20:120]
    path = page(KnownMotion(truth, None, truth))
    browser.open(path.as_uri())
    assert browser.value('document.body.dataset.ready') == 'yes'
    assert browser.complaints == []
    assert {re.match(r'\w+:', address)[0] for address in browser.requests} <= {'file:', 'data:'}
    assert browser.value('document.querySelector("h1").textContent') == 'a </script> <b>name</b>'
    assert browser.value('[...document.querySelectorAll("#map .line")].map(x => x.className.baseVal)') == [
        'line trajectory', 'line truth', 'line wheels'] * 2
    assert browser.value('document.querySelector("#map image").getBBox().width') > 500
    assert browser.value('[...document.querySelectorAll("#errors p")].map(p => p.textContent)') == [
        'Error of the motion over the next metre, against the truth: translation.',
        'Error of the motion over the next metre, against the truth: rotation.']
    for chart in ('map', 'errors', 'statuses', 'pair', 'times'):
        words = browser.value(f'document.querySelector("#{chart} svg[role=img]").textContent')
        assert re.search(r'\[(m|ms)\]', words), chart
        width, height = browser.value(f'''(() => {{
            const box = document.querySelector("#{chart} svg[role=img]").getBoundingClientRect();
            return [box.width, box.height];
        }})()''')
        assert width > 400 and height > 150, chart


def test_where_nothing_moves_all_is_shown_over_the_scans(browser, simulation, tmp_path):
    path, trajectory, scan = tmp_path / 'rest.html', Trajectory(), simulation.scans[20]
    scans = [dataclasses.replace(scan, stamp=scan.stamp + k * 100_000_000) for k in range(20)]
    for _ in trajectory.follow(scans, Odometry()):
        pass
    truth = np.array(trajectory.stamps), np.zeros((20, 3))
    density = density_map(scans, trajectory.poses)
    write_report(path, Report('rest', [], KnownMotion(truth, None, None), trajectory, density, [], Parameters()))
    browser.open(path.as_uri())
    assert browser.value('document.querySelector("#statuses svg[role=img]").textContent').endswith('scan')
    box = browser.value('document.querySelector("#statuses [clip-path] path").getBBox().width')
    assert box == pytest.approx(932.0, abs=5.0)
    assert 'No part of the trajectory is long enough for a comparison with the known motion.' in \
        browser.value('document.body.innerText')
    assert browser.complaints == []


def test_the_page_is_no_wider_than_a_narrow_screen_and_its_words_keep_their_size(browser, page, simulation):
    browser.call('Emulation.setDeviceMetricsOverride', width=400, height=900, deviceScaleFactor=1, mobile=True)
    browser.open(page(KnownMotion((simulation.stamps[20:120], simulation.truth[20:120]), None, None)).as_uri())
    assert browser.value('document.documentElement.scrollWidth') == 400
    scales = browser.value('[...document.querySelectorAll("svg[role=img]")]'
                           '.map(x => x.getBoundingClientRect().width / x.viewBox.baseVal.width)')
    assert len(scales) == 6 and min(scales) > 0.99


def test_a_click_on_a_pair_shows_its_pair(browser, page):
    browser.open(page().as_uri())
    pairs = json.loads(browser.value('JSON.stringify(data.pairs.map(pair => [pair.scan, pair.on, pair.status]))'))
    for section in ('#statuses', '#map'):
        for index, (scan, reference, status) in enumerate(pairs):
            browser.click(f'{section} .pair[data-pair="{index}"]')
            chosen = browser.value('[...document.querySelectorAll(".chosen")].map(x => x.dataset.pair)')
            if section == '#statuses':
                assert chosen == [str(index)] * 2
                assert browser.value('document.getElementById("which").textContent').startswith(
                    f'{index + 1} of {len(pairs)}: scan {scan} on scan {reference}, after ')
                shown = browser.value('document.getElementById("register").textContent')
                assert shown == f'show a.log {reference} {scan}'
                assert status in browser.value('document.getElementById("which").textContent')
            else:
                assert len(chosen) == 2
            dots = browser.value('[...document.querySelectorAll("#overlay .dots")]'
                                 '.map(x => x.getAttribute("d").length)')
            assert len(dots) == 2 and min(dots) > 500
            walls = browser.value('[...document.querySelectorAll("#overlay .wall")].map(x => x.getAttribute("d"))')
            assert len(walls) == 2 and walls[0].count('M') == walls[1].count('M') > 1
    browser.click('#next')
    assert browser.complaints == []


def test_circles_that_lie_on_each_other_are_reached_with_the_buttons(browser, page):
    browser.open(page().as_uri())
    seen = []
    for _ in range(browser.value('data.pairs.length')):
        seen.append(browser.value('document.getElementById("which").textContent').split()[0])
        browser.click('#next')
    assert seen == [str(number + 1) for number in range(len(seen))] and len(seen) == 5
    assert browser.value('document.getElementById("which").textContent').split()[0] == '1'


def test_changed_parameters_stand_out(browser, page):
    browser.open(page(parameters=Parameters().replace({'rotation.eps': 0.02})).as_uri())
    assert browser.value('document.getElementById("changes").textContent') == '1 not at the default, in bold.'
    assert browser.value('document.querySelector("#parameters .changed").textContent').startswith(
        'rotation.eps0.02 raddefault 0.0')
    assert browser.value('document.querySelectorAll("#parameters tr").length') == len(Parameters.describe())


def test_an_empty_page_states_that_nothing_is_known(browser, tmp_path):
    path = tmp_path / 'empty.html'
    unknown = KnownMotion(None, None, None)
    write_report(path, Report('nothing', [], unknown, Trajectory(), density_map([], []), [], Parameters()))
    browser.open(path.as_uri())
    assert browser.complaints == [] and browser.value('document.body.dataset.ready') == 'yes'
    words = browser.value('document.body.innerText')
    assert all(text in words for text in ('The true motion is unknown.', 'There is nothing to look at.',
                                          'No scan could be used.', 'All at their defaults.'))
