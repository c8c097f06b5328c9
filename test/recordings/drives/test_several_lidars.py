# SPDX-License-Identifier: Apache-2.0
"""Recordings of two lidars: simulated and replayed."""
import json
import math

import numpy as np
import pytest
from bags import needs_rosbags

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.bags.static_transforms import static_mounting
from dbscan_reg_ros.replays.sensor_mounting import turned

pytestmark = needs_rosbags

SCANNER = ('--lidar hokuyo_utm30lx --beams 361 --angle-increment 0.75 --duration 0.05 --at {} {} {} --rate {} '
           '--phase {}')
FRONT, REAR = (0.3, 0.2, 45.0), (-0.3, -0.2, -135.0)


@pytest.fixture(scope='module')
def pair(tmp_path_factory):
    """A bag of two lidars at opposite corners, 12.5 and 15 Hz, in a corridor."""
    bag = tmp_path_factory.mktemp('pair') / 'pair'
    front, rear = SCANNER.format(*FRONT, 12.5, 0.0), SCANNER.format(*REAR, 15, 0.019)
    assert simulate([str(bag), '--world', 'corridor', '--speed', '4', *front.split(), *rear.split()]) == 0
    return bag


def replayed(bag, out, *words):
    """Replay a bag; return the measures."""
    assert replay([str(bag), '--out', str(out), *words]) == 0
    return json.loads((out / bag.name / 'latest' / 'metrics.json').read_text())


def test_each_option_of_simulate_belongs_to_the_lidar_before_it(pair):
    first, second = (list(open_recording(pair, topic).scans()) for topic in ('/scan', '/scan_2'))
    assert (first[0].frame_id, second[0].frame_id) == ('laser', 'laser_2')
    assert second[0].stamp - first[0].stamp == 19_000_000
    assert np.diff([scan.stamp for scan in second]).mean() == pytest.approx(1e9 / 15)
    for frame, (x, y, degrees) in (('laser', FRONT), ('laser_2', REAR)):
        found = static_mounting(pair, 'base_link', frame)
        assert np.allclose(found.pose.as_array(), (x, y, math.radians(degrees))) and not found.upside_down
    assert static_mounting(pair, 'map', 'laser') is None


def test_a_replay_uses_both_lidars_and_names_them(pair, tmp_path, capsys):
    words = '--topic', '/scan', '--topic', '/scan_2'
    found = replayed(pair, tmp_path / 'both', *words)
    printed = capsys.readouterr().out
    assert 'poses are those of the lidar on /scan; ' in printed and 'scans of /scan_2 used besides' in printed
    assert found['scans'] == open_recording(pair, '/scan').count
    assert found['ok'] > 0.95 * found['scans'] and found['rpe_5m_mean_m'] < 0.01
    # The same mountings, given on the command line.
    given = [word for topic, mounting in (('/scan', FRONT), ('/scan_2', REAR))
             for word in ('--mounting', topic, *map(str, mounting))]
    again = replayed(pair, tmp_path / 'given', *words, *given)
    assert again['rpe_5m_mean_m'] == pytest.approx(found['rpe_5m_mean_m'], rel=1e-6)


@pytest.mark.parametrize('words, expected', [
    (('--topic', '/scan', '--topic', '/scan'), 'expected each topic once'),
    (('--topic', '/scan', '--topic', '/scan_3'), "no scans on '/scan_3'"),
    (('--topic', '/scan', '--mounting', '/scan', '1', '2'), 'expected NAME X Y DEG'),
    (('--topic', '/scan', '--mounting', '/scan', '1', '2', 'nan'), 'expected NAME X Y DEG')])
def test_what_cannot_be_used_is_named(pair, tmp_path, capsys, words, expected):
    assert replay([str(pair), '--out', str(tmp_path), *words]) == 2
    assert expected in capsys.readouterr().err


def test_a_lidar_whose_mounting_is_not_known_is_named(pair, tmp_path, capsys):
    file = tmp_path / 'parameters.yaml'
    file.write_text('/**: {ros__parameters: {base_frame: base_footprint}}')
    words = '--topic', '/scan', '--topic', '/scan_2', '--params-file', str(file)
    assert replay([str(pair), '--out', str(tmp_path), *words]) == 2
    assert "no transform from 'base_footprint' to 'laser' is on /tf_static" in capsys.readouterr().err


def test_an_upside_down_lidar_becomes_an_upright_one(pair):
    scan = next(open_recording(pair, '/scan').scans())
    g = scan.geometry
    reversed_beams = type(g)(-g.angle_min, -g.angle_increment, g.size, g.range_min, g.range_max)
    hanging = Scan(scan.stamp, scan.ranges, reversed_beams, scan.time_increment, scan.frame_id)
    mounting = Mounting(SE2(0.0, 0.0, 0.5), upside_down=True)
    upright, = turned([hanging], mounting.pose.theta, mounting.upside_down)
    expected, = turned([scan], 0.5)
    assert np.allclose(upright.points, expected.points, atol=1e-6, equal_nan=True)
