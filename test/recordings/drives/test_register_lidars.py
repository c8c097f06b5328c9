# SPDX-License-Identifier: Apache-2.0
"""Register: pairs of scans of a recording of several lidars."""
import json
import math
import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from bags import needs_rosbags, scan_bag

from dbscan_reg_ros.commands.register import main as register
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.recordings import interpolate, open_recording, write_tum
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.replays.lidars import find_scans, turned
from dbscan_reg_ros.robot.scan_buffer import RecordedScans
from dbscan_reg_ros.simulation import Lidar, follow, rooms
from dbscan_reg_ros.simulation import simulate as simulated

FRONT, REAR = SE2(0.3, 0.2, math.radians(45.0)), SE2(-0.3, -0.2, math.radians(-135.0))
MOUNTINGS = '--mounting', '/front', '0.3', '0.2', '45', '--mounting', '/rear', '-0.3', '-0.2', '-135'
TOPICS = '--topic', '/front', '--topic', '/rear'
WIDE = {'beams': 361, 'angle_min': math.radians(-135.0), 'angle_increment': math.radians(0.75), 'noise': 0.005}


@pytest.fixture(scope='module')
def drives():
    """Two lidars of one robot that measure all beams at once, at 10 and 7 Hz: topic -> drive."""
    world = rooms(seed=3)
    path = follow(world.tour[:2], speed=1.0)
    return {topic: simulated(world, path, Lidar(mounting=mounting, rate=rate, phase=phase, **WIDE), seed=3)
            for topic, mounting, rate, phase in (('/front', FRONT, 10.0, 0.0), ('/rear', REAR, 7.0, 0.019))}


@pytest.fixture(scope='module')
def bag(drives, tmp_path_factory):
    return scan_bag(tmp_path_factory.mktemp('two') / 'two', {topic: drive.scans for topic, drive in drives.items()})


@pytest.fixture(scope='module')
def numbered(drives):
    """Topic and scan of each scan of both lidars, in the order of their stamps."""
    return sorted(((topic, scan) for topic, drive in drives.items() for scan in drive.scans),
                  key=lambda each: (each[1].stamp, each[0]))


def pairs(numbered):
    """A pair of numbers for each combination of lidars, in the middle of the drive and at most 9 scans apart."""
    middle, found = len(numbered) // 2, {}
    for reference in range(middle, middle + 9):
        for current in range(reference + 5, reference + 9):
            found.setdefault((numbered[reference][0], numbered[current][0]), (reference, current))
    assert len(found) == 4
    return found


def true_motion(drives, first, stamps):
    """The true motion of the lidar on the topic `first` between two stamps."""
    drive = drives[first]
    poses = interpolate(np.array([scan.stamp for scan in drive.scans]), drive.truth, np.array(stamps))
    return SE2.from_array(relative(poses[:1], poses[1:])[0])


def printed(text, name):
    found = re.search(rf'^{name} +x (\S+) m  y (\S+) m  theta (\S+) deg$', text, re.MULTILINE)
    x, y, degrees = map(float, found.groups())
    return SE2(x, y, math.radians(degrees))


def check_near(found, expected):
    error = expected.inverse() @ found
    assert math.hypot(error.x, error.y) < 0.015 and abs(error.theta) < math.radians(0.3)


@needs_rosbags
@pytest.mark.parametrize('first', ['/front', '/rear'])
def test_scans_of_two_lidars_are_numbered_and_registered_together(bag, drives, numbered, first, tmp_path, capsys):
    second, = {'/front', '/rear'} - {first}
    for (one, other), (reference, current) in pairs(numbered).items():
        words = str(bag), str(reference), str(current), '--topic', first, '--topic', second, *MOUNTINGS
        assert register([*words, '--no-figures', '--out', str(tmp_path)]) == 0
        text = capsys.readouterr().out
        assert f'\nreference   scan {reference}, of the lidar on {one}\n' in text
        assert f'\ncurrent     scan {current}, of the lidar on {other}\n' in text
        stamps = numbered[reference][1].stamp, numbered[current][1].stamp
        expected = true_motion(drives, first, stamps)
        assert f'\ntime        {1e-9 * (stamps[1] - stamps[0]):.3f} s from the reference' in text
        assert f' of the lidar on {first} between the stamps of both scans, in its frame at the first\n' in text
        check_near(printed(text, 'motion'), expected)
        mounted = {'/front': FRONT, '/rear': REAR}
        own, frames = mounted[first].inverse(), [mounted[one], mounted[other]]
        before, after = (own @ frame for frame in frames)
        check_near(printed(text, 'transform'), before.inverse() @ expected @ after)
        assert (f'            of the lidar on {other} at the current scan, in the frame of that on {one} at the '
                'reference') in text


@needs_rosbags
def test_the_truth_is_that_of_the_first_lidar(bag, drives, numbered, tmp_path, capsys):
    reference, current = pairs(numbered)['/front', '/rear']
    stamps = [numbered[number][1].stamp for number in (reference, current)]
    poses = compose(np.zeros((1, 3)), true_motion(drives, '/front', stamps).as_array()[None])
    write_tum(tmp_path / 'own.tum', stamps, np.vstack((np.zeros((1, 3)), poses)))
    words = str(bag), str(reference), str(current), *TOPICS, *MOUNTINGS, '--truth', str(tmp_path / 'own.tum')
    assert register([*words, '--out', str(tmp_path)]) == 0
    text = capsys.readouterr().out
    check_near(printed(text, 'true'), true_motion(drives, '/front', stamps))
    metres, degrees = re.search(r'^error +(\S+) m  (\S+) deg$', text, re.MULTILINE).groups()
    assert float(metres) < 0.015 and float(degrees) < 0.3
    assert (tmp_path / f'two_{reference}_{current}' / 'latest' / 'sheet.png').exists()


@needs_rosbags
def test_a_lidar_may_be_upside_down_and_stamp_late(drives, numbered, tmp_path, capsys):
    """Its scans are mirrored and their stamps 30 ms late: the parameters of the rear lidar correct both."""
    hanging = [Scan(scan.stamp + 30_000_000, scan.ranges, scan.geometry, scan.time_increment, scan.frame_id)
               for scan in turned(drives['/rear'].scans, 0.0, upside_down=True)]
    bag = scan_bag(tmp_path / 'hanging', {'/front': drives['/front'].scans, '/rear': hanging})
    file = tmp_path / 'sensors.yaml'
    file.write_text('/**: {ros__parameters: {sensors: [front, rear], front.topic: /front, rear.topic: /rear, '
                    'front.laser_pose: [0.3, 0.2, 0.785398], rear.laser_pose: [-0.3, -0.2, -2.356194], '
                    'rear.upside_down: true, rear.time_offset: [-0.03]}}')
    reference, current = pairs(numbered)['/front', '/rear']
    assert register([str(bag), str(reference), str(current), '--params-file', str(file), '--no-figures']) == 0
    output = capsys.readouterr()
    assert output.err == '' and f'current     scan {current}, of the lidar on /rear\n' in output.out
    stamps = [numbered[number][1].stamp for number in (reference, current)]
    check_near(printed(output.out, 'motion'), true_motion(drives, '/front', stamps))


@needs_rosbags
def test_the_command_that_the_report_of_two_lidars_names_shows_the_pair(bag, numbered, tmp_path):
    named = shutil.copytree(bag, tmp_path / "the robot's")
    assert replay([str(named), '--out', str(tmp_path), *TOPICS, *MOUNTINGS]) == 0
    page = (tmp_path / "the robot's" / 'latest' / 'report.html').read_text()
    found = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1])
    pair = found['pairs'][-1]
    assert [numbered[pair[name]][0] for name in ('on', 'scan')] == ['/front', '/front'] and pair['on'] < pair['scan']
    environment = {name: value for name, value in os.environ.items() if name not in ('PYTHONPATH', 'VIRTUAL_ENV')}
    ended = subprocess.run(f'{found["register"]} {pair["on"]} {pair["scan"]}', shell=True, cwd=tmp_path,
                           env=environment, check=True, timeout=120, capture_output=True, text=True)
    interval = 1e-9 * (numbered[pair['scan']][1].stamp - numbered[pair['on']][1].stamp)
    assert f'\nreference   scan {pair["on"]}, of the lidar on /front\n' in ended.stdout
    assert f'\ntime        {interval:.3f} s from the reference to the current scan\n' in ended.stdout
    shown = tmp_path / 'results' / f"the robot's_{pair['on']}_{pair['scan']}" / 'latest'
    assert (shown / 'sheet.png').exists()


def scans_at(*stamps):
    geometry = ScanGeometry(0.0, 0.1, 3, 0.0, 10.0)
    return [Scan(stamp, np.ones(3, dtype=np.float32), geometry, 0.0, '') for stamp in stamps]


def test_the_order_is_that_of_the_stamps_and_equal_stamps_begin_with_the_first_lidar():
    streams = scans_at(10, 20, 20, 15, 40), scans_at(5, 20, 30), scans_at(20, 50)
    order = [(each.scan.stamp, each.lidar, each.own) for each in RecordedScans(streams).before()]
    assert order == [(5, 1, 0), (10, 0, 0), (20, 0, 1), (20, 0, 2), (15, 0, 3), (20, 1, 1), (20, 2, 0), (30, 1, 2),
                     (40, 0, 4), (50, 2, 1)]
    found = find_scans(streams, [2, 7])
    assert {number: each[:2] for number, each in found.scans.items()} == {2: (0, 1), 7: (1, 2)}
    assert [sorted(own) for own in found.around] == [[0, 1, 2], [1, 2], []] and found.read == 10
    assert find_scans(streams, [1]).read == 3


@needs_rosbags
@pytest.mark.parametrize(('words', 'complaint'), [
    (['0', '1'], 'choose one of its 2 topics of scans: /front, /rear (--topic; most commands take it more than once, '
     'for several lidars)'),
    (['0', '1', *TOPICS], "the mounting of the lidar on /front is not known: no transform from 'base_link' to 'laser'"),
    (['0', '999999', *TOPICS, *MOUNTINGS], 'no scan 999999; the recording contains {} scans, numbered from 0'),
    (['0', '1', '--topic', '/front', *MOUNTINGS[:5]], '--mounting /front 0.3 0.2 45: expected --topic of several '
     'lidars; the motion of a single lidar is that of its own frame'),
    (['0', '--figure4', *TOPICS, *MOUNTINGS], '--figure4: expected the topic of one lidar; got /front, /rear'),
])
def test_what_cannot_be_registered_is_named(bag, numbered, words, complaint, capsys):
    assert register([str(bag), *words]) == 2
    assert complaint.format(len(numbered)) in capsys.readouterr().err


@needs_rosbags
def test_a_single_topic_keeps_its_own_numbers(bag, drives, capsys):
    assert open_recording(bag, '/rear').count == len(drives['/rear'].scans)
    assert register([str(bag), '10', '13', '--topic', '/rear', '--no-figures']) == 0
    text = capsys.readouterr().out
    stamps = [drives['/rear'].scans[number].stamp for number in (10, 13)]
    check_near(printed(text, 'transform'), true_motion(drives, '/rear', stamps))
    assert 'of the lidar on' not in text and '\nmotion' not in text
