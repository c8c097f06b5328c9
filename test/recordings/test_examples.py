# SPDX-License-Identifier: Apache-2.0
"""The examples of doc/examples run from any folder, on simulated and recorded scans, and print what they promise."""
import gzip
import itertools
import math
import re
import shutil
import subprocess
import sys

import pytest

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.recordings import open_recording, read_tum

LINES = 300
"""Of the Intel log."""


@pytest.fixture
def example(root, tmp_path, monkeypatch):
    """``example(name, *arguments)``: what the example prints when it is run in another folder."""
    monkeypatch.setenv('PYTHONPATH', str(root))

    def example(name, *arguments):
        command = [sys.executable, '-W', 'error', root / 'doc' / 'examples' / f'{name}.py', *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        progress = re.compile(r'(compare: [\w, :]+ \.\.\.\n)*')
        assert done.returncode == 0 and progress.fullmatch(done.stderr)
        return done.stdout
    return example


@pytest.fixture
def intel(data, tmp_path):
    """The beginning of the Intel log, with its relations."""
    log = tmp_path / 'short.log'
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as lines:
        log.write_text(''.join(itertools.islice(lines, LINES)))
    shutil.copy(next((data / 'intel').glob('*.relations')), log.with_suffix('.relations'))
    return log


def numbers(text):
    return [float(number) for number in re.findall(r'(?<![\w.])-?\d+\.\d+', text)]


def measures(text):
    """First word of each line -> measure -> value."""
    return {line.split()[0]: {name: float(value) for name, value in re.findall(r"'(\w+)': ([\d.]+)", line)}
            for line in text.splitlines()}


def test_two_scans_of_the_simulated_building(example):
    scan, motion, sigma, status = example('01_two_scans').splitlines()
    assert scan == ('Scan(180 beams from -90.0 to 89.0 deg, 180 returns at 1.08 to 20.44 m, '
                    'stamp 1700000001900000000 ns)')
    # The robot drives straight ahead: 0.32 m in the 0.9 s after it has set off with 0.8 m/s^2.
    assert numbers(motion) == pytest.approx([0.324, 0.0, 0.0], abs=0.01)
    assert all(0.0 < value < 0.05 for value in numbers(sigma)) and status == 'status OK'


def test_odometry_of_the_simulated_building(example):
    *_, end, statuses = example('02_odometry_of_a_log').splitlines()
    assert numbers(end)[:2] == pytest.approx([0.29, 0.0], abs=0.05)
    assert abs(numbers(end)[2]) == pytest.approx(180.0, abs=0.3)
    assert statuses == "statuses: {'OK': 927}"


def test_wheels_find_what_a_featureless_corridor_hides(example):
    """The robot drives 37.0 m, its wheels measure 2 % too much."""
    alone, fused, wheels = map(numbers, example('03_own_prior').splitlines())
    assert alone[0] < 10.0
    assert fused[0] == pytest.approx(37.0, abs=0.9) and wheels[0] == pytest.approx(37.0, abs=0.9)
    assert abs(fused[1]) < 0.05 < abs(wheels[1])


@pytest.mark.long
def test_a_matcher_of_ones_own_is_measured_beside_ours(example):
    found = measures(example('04_own_matcher_in_the_benchmark'))
    assert found['Ours']['rpe_1m_mean_m'] < 0.006 and found['Ours']['rpe_1m_mean_deg'] < 0.07
    assert 5.0 * found['Ours']['rpe_1m_mean_m'] < found['KeyFrames']['rpe_1m_mean_m'] < 0.3


@pytest.mark.long
@pytest.mark.parametrize(('name', 'begin'), [
    ('01_two_scans', 'Scan(180 beams from -90.0 to 89.0 deg, 166 returns at 1.05 to 17.14 m'),
    ('02_odometry_of_a_log', 'scan 0: x 0.0000 m, y 0.0000 m, theta 0.000 deg'),
    ('03_own_prior', ''), ('04_own_matcher_in_the_benchmark', 'Ours')])
def test_an_example_takes_a_recording(example, intel, name, begin):
    assert example(name, intel).startswith(begin)


@pytest.mark.long
def test_a_method_of_ones_own_is_compared_with_the_defaults(example):
    lines = example('05_own_method_for_compare').splitlines()
    assert 'A: defaults  B: 05_own_method_for_compare:align  B is worse in translation and worse in rotation.' in lines
    ours, own = (numbers(line) for line in lines if re.match(r'hall\.log +[AB] ', line))
    assert ours[5] < 0.01 < 0.1 < own[5] < 0.5, 'RPE [m]'


def test_parameters_of_a_file_are_those_of_its_lidars(example):
    assert example('06_parameters_of_a_file').splitlines() == [
        '/scan_front: mounting laser_pose (0.3, 0.2, 0.0), range_max 0.0 m',
        '/scan_rear: mounting laser_pose (-0.3, -0.2, 3.14), range_max 20.0 m', 'key frames: 40']
    assert example('06_parameters_of_a_file', 'lds').startswith('scan: mounting tf (0.0, 0.0, 0.0), range_max 8.0 m')


def test_a_recording_is_found_in_its_own_map(example, intel, tmp_path):
    assert replay([str(intel), '--out', str(tmp_path), '--map-out', str(tmp_path / 'map.npz')]) == 0
    *_, last = example('07_where_in_a_map', tmp_path / 'map.npz', intel).splitlines()
    assert last.startswith('Localization(localised, ')
    assert numbers(last)[:2] == pytest.approx([0.0, 0.0], abs=5.0)


def test_arrays_become_a_trajectory_a_picture_and_a_log(example, tmp_path):
    """The robot drives to the end and back to 6.8 m; its heading is on either side of pi."""
    printed = example('08_arrays_to_a_picture')
    x, y, theta = numbers(printed)
    assert printed.startswith('200 poses') and (x, y, abs(theta)) == pytest.approx((6.82, 0.0, math.pi), abs=0.015)
    assert len(read_tum(tmp_path / 'trajectory.tum')[0]) == 200 and (tmp_path / 'map.pdf').read_bytes()[:4] == b'%PDF'
    log = open_recording(tmp_path / 'drive.log')
    assert len(log) == 200 and len(log.truth()[1]) == 200
