# SPDX-License-Identifier: Apache-2.0
"""A drive of 100 scans and its page, in a browser."""
import pathlib
from typing import NamedTuple

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.known_motion import KnownMotion
from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.places.localizer import State
from dbscan_reg_ros.places.mapper import Mapper
from dbscan_reg_ros.replays.in_map import InMap, Moment
from dbscan_reg_ros.replays.page.report import ClosedMap, Report, write_report
from dbscan_reg_ros.replays.page.scan_history import ScanHistory
from dbscan_reg_ros.replays.pairs_to_review import PairsToReview
from dbscan_reg_ros.replays.trajectory import Trajectory
from dbscan_reg_ros.simulation import demo

STATUSES = {30: Status.DEGENERATE, 31: Status.DEGENERATE, 60: Status.AMBIGUOUS, 90: Status.FAILED}
UNKNOWN = KnownMotion(None, None, None)


class Replayed(NamedTuple):
    """What the odometry made of the scans."""

    trajectory: Trajectory
    pairs: list
    history: ScanHistory
    updates: list


@pytest.fixture(scope='session')
def simulation():
    return demo()


@pytest.fixture(scope='session')
def known(simulation):
    truth = simulation.stamps[20:120], simulation.truth[20:120]
    return KnownMotion(truth, None, truth)


@pytest.fixture(scope='session')
def replayed(simulation):
    """A drive of 100 scans of which some are given bad statuses."""
    trajectory, pairs, history, updates = Trajectory(), PairsToReview(), ScanHistory(), []
    for number, update in enumerate(trajectory.follow(simulation.scans[20:120], Odometry())):
        update.__dict__['status'] = trajectory.statuses[number] = STATUSES.get(number, Status.OK)
        pairs.add(update)
        history.add(update)
        updates.append(update)
    return Replayed(trajectory, pairs.found(), history, updates)


@pytest.fixture(scope='session')
def in_map(replayed, tmp_path_factory):
    """The drive in its own map; at scan 50 it may be at one of two places, at scan 51 at none."""
    mapper, path = Mapper(), tmp_path_factory.mktemp('map') / 'map.npz'
    for update in replayed.updates:
        mapper.process(update)
    mapper.map().save(path)
    found, nowhere = InMap(path, Parameters()), np.zeros((3, 3))
    for update in replayed.updates:
        found.add(update)
    found.moments[50] = Moment(State.AMBIGUOUS, nowhere, np.array([(1.0, 0.5, 0.2, 0.48), (3.0, -0.5, -2.0, 0.41)]))
    found.moments[51] = Moment(State.NOT_IN_MAP, nowhere, np.empty((0, 4)))
    return found


@pytest.fixture
def page(replayed, simulation, tmp_path):
    """``page(known, parameters, closed, in_map) -> path`` of a report."""
    def page(known=UNKNOWN, parameters=Parameters(), closed=False, in_map=None):
        trajectory, pairs, history, _ = replayed
        path = tmp_path / 'report.html'
        density = density_map(simulation.scans[20:120], trajectory.poses)
        moved = trajectory.pose_array() + np.array((0.0, 1.0, 0.0))
        map_closed = ClosedMap(moved, np.array([[3, 80], [5, 90]]), density_map(simulation.scans[20:120], moved))
        write_report(path, Report('a </script> <b>name</b>', [('scans', '100')], known, trajectory, density, pairs,
                                  parameters, 'show a.log', history, map_closed if closed else None,
                                  in_map=in_map))
        return path
    return page


@pytest.fixture
def browser(started_browser):
    """A page of its own in the browser."""
    yield started_browser
    started_browser.renew()


@pytest.fixture
def show(browser):
    """``show(path, width=1400, height=900, dark=False) -> browser`` with the page loaded and drawn."""
    def show(path, width=1400, height=900, dark=False):
        browser.screen(width, height, dark)
        browser.open(pathlib.Path(path).as_uri())
        browser.value('ready.then(() => 0)')
        browser.frame()
        return browser
    return show
