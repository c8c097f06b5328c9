# SPDX-License-Identifier: Apache-2.0
"""``calibrate``: mounting and time offset of the second lidar of a simulated recording."""
import dataclasses
import json
import math
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from bags import needs_rosbags, scan_bag

from dbscan_reg_ros.commands.calibrate import main as calibrate
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.simulation import Lidar, Path, World, hall, simulate

pytestmark = needs_rosbags

FRONT, REAR = SE2(0.35, 0.25, math.radians(45.0)), SE2(-0.35, -0.25, math.radians(-135.0))
WRONG = SE2(-0.31, -0.28, math.radians(-132.0))
"""The mounting of the rear lidar, wrong by 5 cm and 3 deg."""
LATE = 60_000_000


TWO = ('/front', FRONT, 12.5, 0.0), ('/rear', REAR, 15.0, 0.019)
"""Topic, mounting, rate [Hz] and phase [s] of two lidars at opposite corners."""
LEFT = SE2(-0.35, 0.25, math.radians(135.0))


def scans_of(world, path, lidars=TWO, duration=0.0):
    """The scans of these lidars, each of a `duration` [s]: topic -> scans."""
    return {topic: simulate(world, path, Lidar(
                361, math.radians(-135.0), math.radians(0.75), 0.05, 20.0, rate, noise=0.01, mounting=at, phase=phase,
                frame_id=topic.strip('/'), duration=duration), seed).scans
            for seed, (topic, at, rate, phase) in enumerate(lidars)}


@pytest.fixture(scope='module')
def path():
    """Two rounds on a circle, with a speed that changes."""
    times = np.linspace(0.0, 12.0, 600)
    angle = math.pi * times / 3.0 - 0.5 * np.sin(math.pi * times / 2.0)
    positions = np.array([10.0, 7.0]) + np.column_stack((np.cos(angle), np.sin(angle)))
    return Path(times, np.column_stack((positions, angle + 0.5 * math.pi)))


@pytest.fixture(scope='module')
def drive(path):
    """Scans of a drive on this path in a hall."""
    return scans_of(hall(2), path)


def mountings(rear, **more):
    """Words that name all topics, and their mountings."""
    return [str(word) for topic, at in {'/front': FRONT, '/rear': rear, **more}.items()
            for word in ('--topic', topic, '--mounting', topic, at.x, at.y, math.degrees(at.theta))]


def test_a_wrong_mounting_and_late_stamps_are_found(drive, tmp_path, capsys):
    """The mounting is wrong by 5 cm and 3 deg, and the stamps by 60 ms: found to 5 mm, 0.1 deg and 5 ms."""
    rear = [dataclasses.replace(scan, stamp=scan.stamp + LATE) for scan in drive['/rear']]
    bag, file = scan_bag(tmp_path / 'bag', drive | {'/rear': rear}), tmp_path / 'out.json'
    assert calibrate([str(bag), *mountings(WRONG), '--json', str(file)]) == 0
    found, = json.loads(file.read_text())['lidars']
    assert math.hypot(found['x']['value'] - REAR.x, found['y']['value'] - REAR.y) < 0.005
    assert abs(math.remainder(found['yaw']['value'] - math.degrees(REAR.theta), 360.0)) < 0.1
    assert abs(found['time_offset']['value'] + 1e-9 * LATE) < 0.005
    # The joint that is printed has this mounting.
    printed = capsys.readouterr().out
    joint = ElementTree.fromstring(printed[printed.index('<joint'):])
    origin = joint.find('origin')
    assert joint.find('child').get('link') == 'rear' and joint.find('parent').get('link') == 'base_link'
    assert np.allclose([float(word) for word in origin.get('xyz').split()[:2]],
                       [found['x']['value'], found['y']['value']], atol=1e-4)
    assert float(origin.get('rpy').split()[2]) == pytest.approx(math.radians(found['yaw']['value']), abs=1e-5)
    assert 'not observable' not in printed
    assert 'from the given 0.0000\n' in printed
    verdict, = (line for line in printed.splitlines() if line.startswith('verdict'))
    assert re.search(r'off by \d[.]\d cm and [23][.]\d deg and its stamps are off by \d\d ms: set the values', verdict)


@pytest.mark.long
@pytest.mark.parametrize('given', [SE2(), REAR @ SE2(theta=math.pi), REAR @ SE2(0.8, -0.6, math.radians(-25.0)),
                                   REAR @ SE2(0.0, 0.0, math.radians(90.0))], ids=str)
def test_the_guess_of_a_mounting_may_be_far_off(drive, tmp_path, given):
    bag, file = scan_bag(tmp_path / 'bag', drive), tmp_path / 'out.json'
    assert calibrate([str(bag), *mountings(given), '--json', str(file)]) == 0
    found, = json.loads(file.read_text())['lidars']
    assert math.hypot(found['x']['value'] - REAR.x, found['y']['value'] - REAR.y) < 0.005
    assert abs(math.remainder(found['yaw']['value'] - math.degrees(REAR.theta), 360.0)) < 0.1
    assert abs(found['time_offset']['value']) < 0.005


def test_replay_and_calibrate_take_three_lidars(drive, path, tmp_path, capsys):
    """The mounting of the second is wrong by 5 cm and 3 deg, that of the third is right: 6 s of the drive."""
    third = scans_of(hall(2), path.until(6.0), [('/left', LEFT, 14.0, 0.033)])
    end = max(scan.stamp for scan in third['/left'])
    scans = {topic: [scan for scan in each if scan.stamp < end] for topic, each in (drive | third).items()}
    bag, file = scan_bag(tmp_path / 'bag', scans), tmp_path / 'out.json'
    words = mountings(WRONG, **{'/left': LEFT})
    assert calibrate([str(bag), *words, '--json', str(file)]) == 0
    for found, true in zip(json.loads(file.read_text())['lidars'], (REAR, LEFT), strict=True):
        assert math.hypot(found['x']['value'] - true.x, found['y']['value'] - true.y) < 0.01
        assert abs(math.remainder(found['yaw']['value'] - math.degrees(true.theta), 360.0)) < 0.1
    printed = capsys.readouterr().out
    assert len(re.findall(r'verdict     its mounting is off by \d[.]\d cm and 3[.]0 deg: set', printed)) == 1
    assert printed.count('verdict     the given values fit: nothing to change') == 1
    assert replay([str(bag), '--out', str(tmp_path), *words]) == 0
    lidars = json.loads((tmp_path / 'bag' / 'latest' / 'metrics.json').read_text())['lidars']
    assert {topic: each['scans'] for topic, each in lidars.items()}.keys() == scans.keys()
    assert all(each['skipped'] == each['failed'] == 0 and each['scans'] > len(scans[topic]) - 3
               for topic, each in lidars.items())


def test_what_a_straight_corridor_does_not_determine_is_not_observable(tmp_path, capsys):
    walls = np.array([[(-30.0, -1.1), (40.0, -1.1)], [(-30.0, 1.1), (40.0, 1.1)]])
    world = World(walls, np.array([(0.0, 0.0), (6.0, 0.0)]))
    bag = scan_bag(tmp_path / 'bag', scans_of(world, Path(np.array([0.0, 6.0]), np.array([(0.0, 0.0, 0.0),
                                                                                          (5.0, 0.0, 0.0)]))))
    file = tmp_path / 'out.json'
    assert calibrate([str(bag), *mountings(REAR), '--json', str(file)]) == 0
    found, = json.loads(file.read_text())['lidars']
    assert found['x']['value'] is None is found['time_offset']['value'] and found['x']['sigma'] is None
    assert found['y']['value'] == pytest.approx(REAR.y, abs=0.005)
    assert capsys.readouterr().out.count('not observable') == 2


@pytest.mark.parametrize('words, expected', [
    (('--topic', '/front'), 'expected two topics or more'),
    (('--topic', '/front', '--topic', '/rear'), 'the mounting of the lidar on /front is not known')])
def test_what_cannot_be_calibrated_is_named(drive, tmp_path, capsys, words, expected):
    bag = scan_bag(tmp_path / 'bag', {topic: scans[:3] for topic, scans in drive.items()})
    assert calibrate([str(bag), *words]) == 2
    assert expected in capsys.readouterr().err
    assert calibrate([str(bag), *mountings(REAR)]) == 2
    assert 'only 0 scans of /rear could be compared' in capsys.readouterr().err
