# SPDX-License-Identifier: Apache-2.0
"""Trajectories of other programs and methods of the user's own in a comparison; measures equal to those of evo."""
import json
import os
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros import RecordingError, open_recording
from dbscan_reg_ros.commands.compare import main
from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.recordings import true_poses, write_csv, write_tum
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.recordings.truth import read_truth


@pytest.fixture(scope='module')
def truth(hall_recording):
    """Stamps and true poses of the scans."""
    opened = open_recording(hall_recording)
    stamps, poses = opened.truth()
    scans = np.array(opened.stamps())
    return scans, poses[np.searchsorted(stamps, scans)]


@pytest.fixture
def write(truth, tmp_path):
    """``write(name, noise, seed, kept) -> NAME=FILE``: the true trajectory with noise at each step."""
    def write(name, noise, seed=0, kept=None):
        stamps, poses = truth
        rng = np.random.default_rng(seed)
        steps = relative(poses[:-1], poses[1:]) + noise * rng.normal(size=(len(poses) - 1, 3)) * (1.0, 1.0, 0.3)
        found = [poses[:1]]
        for step in steps:
            found.append(compose(found[-1], step[None]))
        chosen = slice(None) if kept is None else kept(np.arange(len(stamps)))
        write_tum(tmp_path / f'{name}.tum', stamps[chosen], np.concatenate(found)[chosen])
        return f'{name}={tmp_path}/{name}.tum'
    return write


def test_trajectories_of_other_programs_are_compared_and_only_b_sets_the_exit_status(compare, write):
    a, b, c = write('a', 0.002), write('b', 0.002, seed=1), write('c', 0.02, seed=2)
    code, printed, content = compare(a, b, '--trajectory', c)
    assert code == 0 and 'B is neither better nor worse.' in printed.out
    assert 'A: a  C: c  C is worse in translation and worse in rotation.' in printed.out
    assert (content['a'], content['b'], [other['b'] for other in content['others']]) == ('a', 'b', ['c'])
    assert content['others'][0]['differences']['all']['m']['low'] > 0.01
    assert compare(a, b, '--trajectory', c, '--all')[0] == 1
    assert compare(c, a, '--trajectory', b, '--all')[0] == 0


def test_the_pose_of_the_sensor_on_the_body_is_taken_into_account(compare, write, truth, tmp_path):
    stamps, poses = truth
    mounting = np.array([[0.3, -0.1, np.pi / 2]])
    body = compose(poses, relative(mounting, np.zeros((1, 3))).repeat(len(poses), axis=0))
    write_tum(tmp_path / 'body.tum', stamps, body)
    _, _, content = compare(write('a', 0.0), f'body={tmp_path}/body.tum@0.3,-0.1,90')
    assert content['differences']['all']['m']['b'] < 1e-6 and content['differences']['all']['deg']['b'] < 1e-4
    assert len(content['table'][1]['notes']) == 1
    _, printed, content = compare(write('a', 0.01), f'body={tmp_path}/body.tum')
    assert content['differences']['all']['m']['b'] > 0.05
    assert [len(row['notes']) for row in content['table']] == [1, 2]
    assert 'hall, B: with the sensor at about 0.30,-0.10,90 on these poses the root mean' in printed.out


def test_the_odometry_in_a_map_is_compared_beside_the_others(compare, hall_recording, tmp_path, capsys):
    """The map is that of the drive itself, so that it is found again from the first scans on."""
    made = tmp_path / 'hall.npz'
    assert replay([str(hall_recording), '--map-out', str(made), '--out', str(tmp_path)]) == 0
    code, _, content = compare('defaults', f'map:{made}', '--method', 'identity')
    assert code in (0, 1) and content['b'] == f'map:{made}'
    assert content['coverage']['hall'] > 0.9
    measured = content['differences']['all']['m']
    assert measured['b'] < 0.05 < content['others'][0]['differences']['all']['m']['b']
    assert main(['defaults', 'map:absent.npz', str(hall_recording), '--processes', '1', '--out', str(tmp_path)]) == 2
    assert 'absent.npz' in capsys.readouterr().err


def test_a_trajectory_that_leaves_out_the_hard_part_gets_no_verdict(compare, write):
    """Its poses are the true ones elsewhere."""
    def kept(numbers):
        return (numbers < 60) | (numbers >= 60 + 0.15 * len(numbers))
    code, printed, content = compare(write('a', 0.002), write('b', 0.0, kept=kept))
    assert content['judged'] is False and content['coverage']['hall'] == pytest.approx(0.85, abs=0.005)
    assert re.search(r'^hall +B has a pose for \d\d\.\d % of the scans with a pose of A$', printed.out, re.MULTILINE)
    assert code == 3 and 'B is not judged: it has poses for less than 90 % of the scans.' in printed.out
    assert 'better' not in printed.out and 'worse' not in printed.out


def test_scans_that_one_trajectory_lacks_are_left_out_of_both(compare, truth, tmp_path):
    """A is wrong only where B has no poses."""
    stamps, poses = truth
    wrong = poses.copy()
    wrong[100:110, :2] += 5.0
    rows = np.r_[0:99, 111:len(stamps)]
    write_tum(tmp_path / 'a.tum', stamps, wrong)
    write_tum(tmp_path / 'b.tum', stamps[rows], poses[rows])
    _, _, content = compare(f'a={tmp_path}/a.tum', f'b={tmp_path}/b.tum')
    assert content['differences']['all']['m']['a'] == content['differences']['all']['m']['b'] < 1e-6


@pytest.mark.long
def test_a_folder_holds_a_trajectory_for_each_recording(compare, write, tmp_path, hall_recording, capsys):
    folder = tmp_path / 'theirs'
    folder.mkdir()
    shutil.copy(write('b', 0.002).partition('=')[2], folder / 'hall.tum')
    assert compare(write('a', 0.002), f'theirs={folder}')[0] == 0
    (folder / 'hall.tum').rename(folder / 'room.tum')
    assert main(['identity', f'theirs={folder}', str(hall_recording), '--processes', '1', '--out', str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f'compare: theirs: no such trajectory: {folder}/hall.tum; expected in the folder a file RECORDING.tum for each '
        'recording, its name without .log.gz, .log or .bag\n')


@pytest.mark.long
def test_a_recording_without_a_trajectory_is_not_judged_and_the_others_are(write, tmp_path, hall_recording, capsys):
    names, verdict = [write('a', 0.002), write('b', 0.02, seed=1)], 'worse in translation and worse in rotation'
    shutil.copytree(hall_recording, tmp_path / 'room')
    for folder, name, recordings in zip(('ours', 'theirs'), names, (('hall', 'room'), ('room',)), strict=True):
        (tmp_path / folder).mkdir()
        for recording in recordings:
            shutil.copy(name.partition('=')[2], tmp_path / folder / f'{recording}.tum')
    ours, theirs = (f'{name}={tmp_path}/{name}' for name in ('ours', 'theirs'))
    given = [str(hall_recording), str(tmp_path / 'room'), '--processes', '1', '--out', str(tmp_path)]
    assert main([ours, theirs, *given]) == 1
    printed = capsys.readouterr()
    missing = f'no such trajectory: {tmp_path}/theirs/hall.tum'
    assert printed.err.startswith(f'compare: theirs: {missing}; not judged on hall\ncompare: hall, ours ...\n')
    assert f'hall, B: {missing}\n' in printed.out
    assert re.search(r'^hall +B theirs +0 of \d+( +unknown){7}  not judged$', printed.out, re.MULTILINE)
    assert (f'B is {verdict} over room; it is not judged on hall, where it has poses for less than 90 % of the '
            'scans.\n') in printed.out
    content = json.loads((tmp_path / 'compare/latest/comparison.json').read_text())
    assert [row['verdict'] for row in content['table']] == ['', 'not judged', '', verdict]
    assert content['differences']['room'] == content['differences']['all'] and not content['judged']
    assert main([theirs, ours, *given]) == 2
    assert capsys.readouterr().err == (f'compare: theirs: {missing}; A needs one for each recording: add it, leave out '
                                       'the recording, or let another competitor be A\n')


@pytest.mark.parametrize(('words', 'says'), [
    (('x=absent.tum',), 'absent.tum: no such trajectory; expected a file in TUM format, or a folder of such files'),
    (('x=absent.tum@1,2',), 'absent.tum@1,2: expected FILE@X,Y,DEG with the pose of the sensor [m, m, deg]'),
    (('=a.tum',), '=a.tum: expected NAME=FILE.tum, NAME=FILE.tum@X,Y,DEG or NAME=FOLDER'),
    (('absent:align',), "method absent:align: No module named 'absent'; expected MODULE:FUNCTION, in the current "
                        'folder or installed, MODULE without .py'),
])
def test_a_wrong_competitor_is_one_line(hall_recording, capsys, words, says):
    assert main(['identity', *words, str(hall_recording)]) == 2
    assert capsys.readouterr().err == f'compare: {says}\n'


def test_an_error_in_a_method_of_ones_own_names_it_and_what_it_is_called_with(hall_recording, tmp_path, monkeypatch,
                                                                              capsys):
    (tmp_path / 'of_points.py').write_text('def match(reference, current, guess):\n    raise TypeError(1)\n')
    monkeypatch.chdir(tmp_path)
    assert main(['identity', 'of_points:match', str(hall_recording), '--processes', '1']) == 2
    assert capsys.readouterr().err.endswith(
        'of_points:match ...\ncompare: method of_points:match: TypeError: 1; it '
        'was called with two scans (Scan), reference and current, and a guess (SE2) (-v shows where)\n')


def test_the_truth_is_read_from_a_file(compare, write, truth, tmp_path):
    """That of the file counts, not that of the bag: all is twice as large in it."""
    stamps, poses = truth
    large = tmp_path / 'large.tum'
    write_tum(large, stamps, poses * (2.0, 2.0, 1.0))
    code, _, content = compare(f'large={large}', write('small', 0.0), '--truth', large)
    assert code == 1 and content['differences']['all']['m']['a'] < 1e-6
    assert content['differences']['all']['m']['b'] > 0.4


def test_one_table_has_all_competitors_printed_and_written(compare, write, tmp_path):
    a, b, c = write('a', 0.002), write('b', 0.01, seed=1), write('c', 0.05, seed=2)
    _, printed, content = compare(a, b, '--trajectory', c, '--method', 'identity')
    head, *rows = printed.out.splitlines()[1:6]
    assert [row.split()[:3] for row in rows] == [['hall', letter, name] for letter, name in zip(
        'ABCD', ('a', 'b', 'identity', 'c'), strict=True)]
    assert head.split()[:2] == ['recording', 'competitor']
    assert rows[3].endswith('worse in translation and worse in rotation')
    assert (tmp_path / 'compare/latest/table.txt').read_text() in printed.out
    assert [row['name'] for row in content['table']] == ['a', 'b', 'identity', 'c']
    for row, line in zip(content['table'], rows, strict=True):
        values = [row[name] for name in ('error_m', 'error_deg', 'error_5m_m', 'error_5m_deg', 'ape_m', 'rpe_m',
                                         'rpe_deg')]
        assert line.split()[3:6] == [str(row['poses']), 'of', str(row['scans'])]
        for value, digits, text in zip(values, (4, 3, 4, 3, 6, 6, 6), line.split()[6:], strict=False):
            assert text == ('unknown' if value is None else f'{value:.{digits}f}')
    assert content['table'][1]['error_m'] == content['differences']['hall']['m']['b']
    assert content['table'][2]['error_5m_m'] > 4.0
    assert content['table'][1]['error_m'] < content['table'][1]['error_5m_m']
    page = (tmp_path / 'compare/latest/index.html').read_text()
    assert all(f'{row["rpe_m"]:.6f}</td>' in page for row in content['table'])


@pytest.mark.long
def test_a_measure_that_cannot_be_computed_has_a_reason_instead_of_nan(compare, write, tmp_path):
    _, printed, content = compare(write('a', 0.002), 'identity')
    reason = ('no APE: the estimated or the true poses lie at one place or on one straight line, and evo does not '
              'align such poses')
    assert f'hall, B: {reason}\n' in printed.out and 'nan' not in printed.out.lower()
    assert content['table'][1]['ape_m'] is None and content['table'][1]['notes'] == [reason]
    assert content['table'][1]['rpe_m'] > 0.5
    assert f'<p>B: {reason}</p>' in (tmp_path / 'compare/latest/index.html').read_text()


def test_the_notes_count_which_stamps_match_and_why_others_do_not(compare, write, truth, tmp_path):
    """Every second pose is there, but the first 9 and 20 in the middle are not."""
    stamps, _ = truth
    kept = np.r_[9:79:2, 99:len(stamps):2]
    name = write('half', 0.002, kept=lambda numbers: kept)
    _, printed, content = compare(write('a', 0.0), name)
    count = len(stamps)
    assert content['table'][0]['notes'] == [f'{count} of {count} scans have the stamp of a pose']
    note = (f'{len(kept)} of {count} scans have the stamp of a pose; {count - len(kept) - 30} lie between two poses, '
            f'and their pose is interpolated; 30 have no pose: 9 before the first pose, {1e-9 * stamps[9]:.3f} s '
            'and 21 where successive poses are more than 0.750 s apart')
    assert content['table'][1]['notes'] == [note] and f'hall, B: {note}\n' in printed.out
    interpolated = count - len(kept) - 30
    assert content['table'][1]['interpolated'] == interpolated
    assert re.search(rf'^hall +B half +{len(kept)} \+ {interpolated} of {count} ', printed.out, re.MULTILINE)


def test_a_truth_of_another_clock_is_refused(write, truth, tmp_path, hall_recording, capsys):
    stamps, poses = truth
    write_tum(tmp_path / 'other.tum', stamps - stamps[0] + 10**9, poses)
    assert main([write('a', 0.0), 'identity', str(hall_recording), '--truth', str(tmp_path / 'other.tum'),
                 '--processes', '1', '--out', str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert f'compare: too few scans have a true pose: 0 of {len(stamps)} scans have the stamp of a pose; ' in error
    assert f'{len(stamps)} after the last pose, {1e-9 * (stamps[-1] - stamps[0]) + 1.0:.3f} s' in error
    assert f'the stamps of the scans go from {1e-9 * stamps[0]:.3f} to {1e-9 * stamps[-1]:.3f} s' in error
    assert 'in the trajectory file, in seconds' in error


def test_scans_outside_the_truth_and_in_its_holes_are_counted_and_not_judged(compare, write, truth, tmp_path):
    """B is wrong where the truth is unknown."""
    stamps, poses = truth
    known = np.ones(len(stamps), dtype=bool)
    known[[*range(5), *range(20, 32), *range(len(stamps) - 7, len(stamps))]] = False
    write_tum(tmp_path / 'known.tum', stamps[known], poses[known])
    wrong = poses.copy()
    wrong[25:28, :2] += 3.0
    write_tum(tmp_path / 'wrong.tum', stamps, wrong)
    words = write('a', 0.001), f'wrong={tmp_path}/wrong.tum', '--truth', tmp_path / 'known.tum'
    code, printed, content = compare(*words)
    assert code == 0 and content['table'][1]['error_m'] < 1e-6 and content['table'][1]['ape_m'] < 1e-6
    count = len(stamps)
    note = (f'true poses: {count - 24} of {count} scans have the stamp of a pose; 24 have no pose: 5 before the first '
            f'pose, {1e-9 * stamps[5]:.3f} s and 7 after the last pose, {1e-9 * stamps[-8]:.3f} s and 12 where '
            'successive poses are more than 0.750 s apart')
    assert content['table'][1]['notes'][1] == note
    assert f'hall, A, B: {note}\n' in printed.out
    assert f'<p>A, B: {note}</p>' in (tmp_path / 'compare/latest/index.html').read_text()
    assert '<a href="../index.html">' in (tmp_path / 'compare/latest/hall/report.html').read_text()


def test_the_truth_beside_a_recording_is_found(tmp_path):
    recording = SimpleNamespace(path=tmp_path / 'a.log', truth=lambda: None, stamps=lambda: [10, 20])
    assert true_poses(recording) is None
    write_csv(tmp_path / 'reference.csv', [(1.0, 2.0, 0.0), (3.0, 4.0, 0.0)])
    assert true_poses(recording)[1].tolist() == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]
    write_tum(tmp_path / 'truth.tum', [15], [(5.0, 6.0, 0.0)])
    stamps, poses = true_poses(recording)
    assert (stamps.tolist(), poses.tolist()) == ([15], [[5.0, 6.0, 0.0]])
    write_csv(tmp_path / 'long.csv', [(0.0, 0.0, 0.0)] * 3)
    with pytest.raises(RecordingError, match='scan 2; expected numbers below 2, the scans of '):
        read_truth(tmp_path / 'long.csv', recording)


def test_a_method_of_ones_own_is_a_function_of_two_scans(compare, write, tmp_path, monkeypatch):
    (tmp_path / 'own_method.py').write_text(
        'from dbscan_reg_ros import SE2\n\n\ndef stand(reference, current, guess):\n    return SE2()\n\n\n'
        'class Still:\n    def process(self, scan):\n        from dbscan_reg_ros.evaluation.trackers import Step\n'
        '        return Step(SE2())\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [*sys.path])
    code, printed, content = compare('identity', 'own_method:stand', '--method', 'own_method:Still', '--all')
    assert code == 0 and 'A: identity  C: own_method:Still  C is neither better nor worse.' in printed.out
    assert content['differences']['all']['m']['a'] == content['differences']['all']['m']['b'] > 0.5


@pytest.fixture
def evo(root, tmp_path):
    """``evo(command, *words) -> rmse``: what a command of evo prints."""
    path = os.pathsep.join([os.environ['PATH'], str(root / '.venv-evo' / 'bin')])
    if shutil.which('evo_ape', path=path) is None:
        pytest.skip('needs the commands of evo')
    (tmp_path / 'home').mkdir()

    def evo(command, *words):
        done = subprocess.run([shutil.which(command, path=path), 'tum', *map(str, words)], check=True, text=True,
                              capture_output=True, env=os.environ | {'HOME': str(tmp_path / 'home')}, timeout=120)
        return float(re.search(r'^\s*rmse\s+([\d.]+)$', done.stdout, re.MULTILINE)[1])
    return evo


@pytest.mark.long
def test_measures_are_those_of_evo(compare, write, evo, tmp_path):
    words = [write('a', 0.003), write('b', 0.01, seed=1)]
    _, printed, _ = compare(*words, '--trajectory', write('c', 0.05, seed=2, kept=lambda numbers: numbers % 9 != 4))
    rows = re.findall(r'^hall +([ABC]) \w+ .* (\d+\.\d{6}) +(\d+\.\d{6}) +(\d+\.\d{6})', printed.out, re.MULTILINE)
    assert [row[0] for row in rows] == ['A', 'B', 'C']
    for letter, *values in rows[1:]:
        files = [tmp_path / 'compare' / 'latest' / 'hall' / f'{name}{letter}.tum' for name in ('truth_of_', '')]
        pairs = '--delta', '1', '--delta_unit', 'm', '--all_pairs', '--pairs_from_reference', '--pose_relation'
        expected = [evo('evo_ape', *files, '--align'), evo('evo_rpe', *files, *pairs, 'trans_part'),
                    evo('evo_rpe', *files, *pairs, 'angle_deg')]
        assert [float(value) for value in values] == pytest.approx(expected, abs=1e-6)
