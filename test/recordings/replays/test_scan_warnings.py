# SPDX-License-Identifier: Apache-2.0
"""Warnings about wrong scan metadata in recordings."""
import json

import pytest
from bags import needs_rosbags

from dbscan_reg_ros.commands import compare, replay, tune
from dbscan_reg_ros.recordings import open_recording


def kinds_of(path):
    return [sighting.warning.kind.value for sighting in open_recording(path).look_through().sightings]


@pytest.mark.parametrize('name, kinds', [
    ('replay_two_frames', ['frame']),
    ('millimetres/ranges_only', ['millimetres']),
    ('millimetres/ranges_and_range_max', ['millimetres']),
    ('replay_starts_in_motion/one_stamp_in_the_future', ['stamp_back']),
    ('replay_starts_in_motion/four_seconds', []),
    ('unclear_bag_messages/rlaser.log', []),
    ('carmen/equal_stamps.log', []),
    ('carmen/no_return_32.767_and_zero_stamps.log', []),
    ('covariance_explodes/kinect_55deg_25s', []),
    ('no_return/no_return_is_range_max', ['no_return']),
    ('no_return/no_return_is_range_max.log', ['no_return']),
    ('no_return/no_return_is_inf_control', []),
])
def test_faulty_recordings_are_reported_by_kind(cases, name, kinds):
    assert kinds_of(cases / name) == kinds


@pytest.mark.long
@pytest.mark.parametrize('path', ['intel/intel.log.gz', 'aces/aces.log.gz', 'ccny_demo/demo.bag', 'lms511/static',
                                  'urg04lx/exp1'])
def test_real_recordings_cause_no_warning(data, path):
    if not (data / path).exists():
        pytest.skip(f'{path} is not there')
    assert kinds_of(data / path) == []


@needs_rosbags
def test_replay_prints_warnings_once_and_keeps_them_in_the_measures_and_on_the_page(cases, tmp_path, capsys):
    assert replay.main(['--out', str(tmp_path), str(cases / 'replay_two_frames')]) == 0
    output = capsys.readouterr().out
    assert output.count("warning     the scans change from the frame 'front' to 'back': ") == 1
    assert output.count('give each laser a topic') == 1 and '(121 of 122 scans, first scan 1)' in output
    latest, = tmp_path.glob('*/latest')
    warning, = json.loads((latest / 'metrics.json').read_text())['warnings']
    assert (warning['kind'], warning['first_scan'], warning['scans']) == ('frame', 1, 121)
    assert (latest / 'report.html').read_text().count("the scans change from the frame 'front' to 'back'") == 1


@needs_rosbags
def test_compare_and_tune_say_it_before_they_begin(cases, tmp_path, capsys):
    path = cases / 'replay_two_frames'
    compare.main(['--processes', '1', '--out', str(tmp_path), 'defaults', 'identity', str(path)])
    tune.main(['--processes', '1', '--trials', '1', '--scans', '30', '--search', 'random', '--out',
               str(tmp_path / 'tune'), str(path)])
    lines = [line for line in capsys.readouterr().err.splitlines() if 'from the frame' in line]
    assert [line.split(': ')[0] for line in lines] == ['compare', 'tune']
    assert '(121 of 122 scans' in lines[0] and '(29 of 30 scans' in lines[1]
