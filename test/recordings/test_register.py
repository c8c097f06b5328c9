# SPDX-License-Identifier: Apache-2.0
"""Register: one pair of scans, in numbers and in the figures of the paper."""
import itertools
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros import DbscanRegError, Odometry, ParameterError, Parameters, Scan, Status
from dbscan_reg_ros.commands.register import OF_A_DRIVE, _motion_during_scan, main
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.ring_band import Outcome
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.schema import ADVANCED
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.records import Registration
from dbscan_reg_ros.core.registration.status import failed
from dbscan_reg_ros.evaluation.known_motion import KnownMotion
from dbscan_reg_ros.figures.sheet import FIGURES, SIZE, Drawing, draw_figures
from dbscan_reg_ros.figures.steps import Steps
from dbscan_reg_ros.figures.texts import Timing, describe, fixed, heading_text
from dbscan_reg_ros.paths import parameter_file
from dbscan_reg_ros.recordings import open_recording, write_tum
from dbscan_reg_ros.recordings.files import replacing
from dbscan_reg_ros.recordings.snapshots import Snapshot, SnapshotUpdate, write_snapshot
from dbscan_reg_ros.recordings.truth import Relations
from dbscan_reg_ros.robot.parameter_files import read_parameters, write_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters

PICTURES = {f'{name}.png' for name in (*FIGURES, 'sheet')}
REFERENCE, CURRENT, TRUTH = 380, 390, (0.5697, -0.0126, -0.07692)
"""Two scans of the Intel log and the motion between them [m, m, rad]."""


@pytest.fixture(scope='module')
def pair(data):
    scans = list(itertools.islice(open_recording(data / 'intel' / 'intel.log.gz').scans(), CURRENT + 1))
    return scans[REFERENCE], scans[CURRENT]


@pytest.fixture
def intel(data, tmp_path):
    """``intel(*words) -> exit code``: into the test's folder."""
    return lambda *words: main(['intel/intel.log.gz', *map(str, words), '--data', str(data), '--out', str(tmp_path)])


@pytest.fixture(scope='module')
def updates(drive):
    odometry = Odometry()
    return [odometry.process(scan) for scan in drive.scans[:6]]


@pytest.fixture
def snapshot(updates, tmp_path):
    values = {name: list(value) if isinstance(value, tuple) else value for name,
              value in Parameters().flatten().items()}
    write_snapshot(tmp_path / 'kept.npz', Snapshot(values, [SnapshotUpdate.of(update) for update in updates]))
    return tmp_path / 'kept.npz'


def printed_motion(text, name='transform'):
    return [float(value) for value in re.search(rf'^{name} +x (\S+) m  y (\S+) m  theta (\S+) deg$', text,
                                                re.MULTILINE).groups()]


def ink(path):
    from PIL import Image
    return 1.0 - np.asarray(Image.open(path).convert('L'), dtype=np.float32) / 255.0


def check_pictures(folder):
    assert {file.name for file in folder.iterdir()} == PICTURES
    drawn = {name: ink(folder / name) for name in PICTURES}
    for name, shares in drawn.items():
        assert shares.shape[1] > 1000 and 0.005 < shares.mean() < 0.3, name
    assert drawn['sheet.png'].size > 4 * drawn['points.png'].size


def test_a_pair_of_a_recording_in_numbers_and_pictures(intel, pair, tmp_path, capsys):
    (tmp_path / 'rivals.yaml').write_text(
        '/**: {ros__parameters: {advanced.selection.min_support_ratio: 0.0, advanced.selection.max_score_gap: 2.0}}')
    assert intel(REFERENCE, CURRENT, '-v', '--params-file', tmp_path / 'rivals.yaml') == 0
    text = capsys.readouterr().out
    result = register(*map(extract_features, pair), read_parameters(tmp_path / 'rivals.yaml'))
    x, y, degrees = printed_motion(text)
    assert (x, y) == pytest.approx((result.transform.x, result.transform.y), abs=6e-5)
    assert math.hypot(x - TRUTH[0], y - TRUTH[1]) < 0.02 and degrees == pytest.approx(math.degrees(TRUTH[2]), abs=0.5)
    assert text.startswith(f'status      {result.status.value}\n')
    true = printed_motion(text, 'true')
    assert true == pytest.approx([*TRUTH[:2], math.degrees(TRUTH[2])], abs=2e-3)
    assert printed_error(text) == pytest.approx([math.dist((x, y), true[:2]), abs(degrees - true[2])], abs=2e-3)
    covariance = np.array([line.split() for line in text.split('covariance')[1].splitlines()[1:4]], dtype=float)
    np.testing.assert_allclose(covariance, result.covariance_in_reference, rtol=1e-4, atol=1e-12)
    assert len(re.findall(r'^ +score', text, re.MULTILINE)) == len(result.hypotheses) > 1
    latest = tmp_path / f'intel_{REFERENCE}_{CURRENT}' / 'latest'
    assert text.endswith(f'figures     {latest.resolve()}\n')
    check_pictures(latest)


def printed_error(text):
    return [float(value) for value in re.search(r'^error +(\S+) m  (\S+) deg$', text, re.MULTILINE).groups()]


def test_a_relation_gives_the_true_motion_in_both_directions():
    motion = np.array([(0.3, 0.2, 0.1), (1.0, 0.0, 0.0)])
    known = KnownMotion(None, Relations(np.array([(10**9, 2 * 10**9), (2 * 10**9, 3 * 10**9)]), motion), None)
    forwards, backwards = known.between(10**9, 2 * 10**9), known.between(2 * 10**9, 10**9)
    np.testing.assert_allclose(forwards.as_array(), motion[0])
    np.testing.assert_allclose((forwards @ backwards).as_array(), 0.0, atol=1e-12)
    assert known.between(10**9, 3 * 10**9) is None and KnownMotion(None, None, None).between(1, 2) is None


def test_a_parameter_set_is_named_like_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert read_parameters('lds') == read_parameters(parameter_file('lds')) != NodeParameters()
    write_parameters('lds')
    assert read_parameters('lds') == NodeParameters(), 'a file of this name comes first'
    with pytest.raises(ParameterError, match=r'^ldss: cannot be read: No such file.*expected the path of a parameter '
                                             r'file, or the name of a ready-made one: hokuyo_urg04lx, .*, lds'):
        read_parameters('ldss')


def test_a_parameter_of_the_paper_leads_to_its_method(intel, tmp_path, capsys):
    (tmp_path / 'old.yaml').write_text('/**: {ros__parameters: {advanced: {rotation: {directed: false}}}}')
    assert intel(REFERENCE, CURRENT, '--params-file', tmp_path / 'old.yaml') == 2
    error = capsys.readouterr().err
    assert 'advanced.rotation.directed' in error and '--method paper' in error and error.count('\n') == 1
    (tmp_path / 'own.yaml').write_text('/**: {ros__parameters: {advanced: {rotation: {eps: 0.02}}}}')
    assert intel(REFERENCE, CURRENT, '--method', 'paper', '--params-file', tmp_path / 'own.yaml') == 2
    assert 'expected no parameters' in capsys.readouterr().err


def test_the_paper_to_the_letter_with_a_truth_of_ones_own(intel, data, tmp_path, capsys):
    stamps = open_recording(data / 'intel' / 'intel.log.gz').stamps()
    write_tum(tmp_path / 'own.tum', [stamps[CURRENT], stamps[REFERENCE]], [(0.0, 1.0, 0.0), (0.0, 0.0, math.pi / 2)])
    assert intel(REFERENCE, CURRENT, '--method', 'paper', '--truth', tmp_path / 'own.tum', '--no-figures') == 0
    text = capsys.readouterr().out
    x, y, degrees = printed_motion(text)
    assert math.dist((x, y), TRUTH[:2]) < 0.05 and '\nhypotheses  2, best first\n' in text
    assert text.startswith('status      found (the method of the paper has no check)\n') and 'covariance' not in text
    assert printed_motion(text, 'true') == pytest.approx((1.0, 0.0, -90.0), abs=1e-4)
    assert printed_error(text) == pytest.approx([math.dist((x, y), (1.0, 0.0)), degrees + 90.0], abs=2e-3)
    assert intel(REFERENCE, 700, '--truth', tmp_path / 'own.tum') == 2
    assert 'own.tum: has no pose at the stamps of both scans, ' in capsys.readouterr().err
    assert intel(REFERENCE, '--figure4', '--truth', tmp_path / 'own.tum') == 2
    assert capsys.readouterr().err.endswith('own.tum: expected two scans of a recording\n')


@pytest.mark.parametrize('number', [2152, pytest.param(4740, marks=pytest.mark.long)])
def test_the_example_of_the_paper_is_a_scan_and_its_own_points_moved(intel, capsys, number):
    assert intel(number, '--figure4', '--no-figures') == 0
    text = capsys.readouterr().out
    x, y, degrees = printed_motion(text)
    np.testing.assert_allclose((x, y, np.radians(degrees)), (-1.5, 0.8, 0.3), atol=2e-3)
    assert max(printed_error(text)) < 0.2


def test_the_last_scan_of_a_snapshot_as_the_node_registered_it(snapshot, updates, capsys):
    assert main([str(snapshot), '--no-figures']) == 0
    text, transform = capsys.readouterr().out, updates[-1].registration.transform
    assert text.startswith('status      ok\n')
    printed = printed_motion(text)
    assert printed == pytest.approx([transform.x, transform.y, math.degrees(transform.theta)], abs=6e-4)


def test_a_scan_of_a_snapshot_with_other_parameters_is_registered_again(snapshot, updates, tmp_path, capsys):
    (tmp_path
     / 'a.yaml').write_text('/**: {ros__parameters: {advanced.selection.top_candidates: 3, '
                            'advanced.selection.min_support_ratio: 0.0, advanced.selection.max_score_gap: 2.0}}')
    assert main([str(snapshot), '2', '--params-file', str(tmp_path / 'a.yaml'), '--no-figures']) == 0
    text, update = capsys.readouterr().out, updates[2]
    again = register(update.reference, update.features, read_parameters(tmp_path / 'a.yaml'))
    assert len(again.hypotheses) > len(update.registration.hypotheses)
    assert f'\nhypotheses  {len(again.hypotheses)}, best first\n' in text


def test_what_does_not_count_for_a_pair_is_named_and_changes_nothing(pair, intel, tmp_path, capsys):
    reference, current = map(extract_features, pair)
    own = Parameters()
    drive = [each for each in Parameters.describe()
             if each.name.removeprefix(ADVANCED).startswith(OF_A_DRIVE) and each.name != 'prior.source']
    others = own.replace({each.name: next(c for c in each.choices if c != each.default) if each.choices
                          else not each.default if each.type is bool else each.maximum for each in drive})
    found = register(reference, current, others)
    assert found.transform == register(reference, current, own).transform
    np.testing.assert_array_equal(found.covariance, register(reference, current, own).covariance)
    file = tmp_path / 'a.yaml'
    write_parameters(file,
                     NodeParameters().replace({**others.flatten(), 'mounting': 'laser_pose', 'scan.range_max': 20.0}))
    assert intel(3, 5505, '--params-file', file) == 2
    note, _ = capsys.readouterr().err.splitlines()
    names = ', '.join([*(each.name for each in drive), 'mounting'])
    assert note == f'register: {file}: these parameters have no effect in register: {names}'


@pytest.mark.parametrize(('words', 'complaint'), [
    ((), r'expected the numbers of two scans, REF and CUR, from 0; got \[\]'),
    ((1,), r'expected the numbers of two scans, REF and CUR, from 0; got \[1\]'),
    ((-1, 3), r'expected the numbers of two scans, REF and CUR, from 0; got \[-1, 3\]'),
    ((3, 5505), 'no scan 5505; the recording contains 5505 scans, numbered from 0'),
])
def test_scans_that_are_not_there_are_named(intel, tmp_path, capsys, words, complaint):
    assert intel(*words) == 2
    assert re.fullmatch(rf'register: \S+intel\.log\.gz: {complaint}\n', capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('words', 'complaint'), [
    (['0'], 'scan 0 was not registered; the registered scans of the snapshot: 1, 2, 3, 4, 5'),
    (['1', '2'], r'expected the number of one scan of the snapshot; got \[1, 2\]'),
])
def test_scans_that_a_snapshot_does_not_hold_are_named(snapshot, capsys, words, complaint):
    assert main([str(snapshot), *words]) == 2
    assert re.fullmatch(rf'register: \S+kept\.npz: {complaint}\n', capsys.readouterr().err)


def test_what_is_no_snapshot_and_what_is_nowhere_is_named(tmp_path, capsys):
    (tmp_path / 'a.npz').write_bytes(b'nonsense')
    assert main([str(tmp_path / 'a.npz')]) == 2 and main([str(tmp_path / 'b.log'), '0', '1']) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert 'a.npz: no snapshot' in first and second.endswith('b.log: cannot be read: No such file or directory')


def test_the_steps_are_those_of_the_registration(pair):
    steps = Steps.of(*pair, Parameters())
    for (_, scan), raw in zip(steps.scans, pair, strict=True):
        kept = np.isfinite(scan.filtered[:, 0])
        np.testing.assert_array_equal(scan.filtered[kept], scan.features.points)
        np.testing.assert_array_equal(np.isfinite(scan.measured[:, 0]), raw.valid)
        assert np.count_nonzero(scan.outcome == Outcome.REMOVED) == np.count_nonzero(raw.valid & ~kept) > 0
        assert len(scan.breaks) == len(scan.features.points) - 1 and scan.breaks.any()
    np.testing.assert_allclose(steps.registration.transform.as_array(),
                               register(*map(extract_features, pair)).transform.as_array(), atol=1e-9)
    assert steps.rotations.phi[steps.rotation] == pytest.approx(steps.registration.transform.theta, abs=0.02)
    distances, k = steps.rotation_distances()
    assert k == 1 and distances[-1] < steps.rotations.eps < distances[0]


def test_pictures_for_a_paper_have_no_titles(updates, tmp_path):
    """Their texts are in the fonts, or of the size, that journals ask for."""
    steps = Steps.of(updates[0].features.scan, updates[5].features.scan, Parameters())
    draw_figures(tmp_path, steps, 'a title', (6.0, 4.0), 'svg')
    assert {file.name for file in tmp_path.iterdir()} == {f'{name}.svg' for name in FIGURES}
    text = (tmp_path / 'overlay.svg').read_text()
    assert 'width="432pt" height="288pt"' in text and 'before' in text
    assert 'a title' not in text and 'Matched segments should' not in text
    draw_figures(tmp_path, steps, 'a title', (6.0, 4.0), 'pdf')
    assert b'/Type3' not in (tmp_path / 'overlay.pdf').read_bytes()
    with pytest.raises(DbscanRegError, match='2 x 2 inches has no room'):
        draw_figures(tmp_path, steps, '', (2.0, 2.0), 'pdf')


def test_scans_without_any_line_are_drawn_as_well(tmp_path):
    rng = np.random.default_rng(1)
    scans = [Scan.from_points(rng.uniform(2.0, 30.0, (60, 1)) * [(math.cos(a), math.sin(a)) for a in
                                                                   np.linspace(-3.0, 3.0, 60)]) for _ in range(2)]
    steps = Steps.of(*scans, Parameters().replace({'advanced.filter.test': 'off'}))
    assert not len(steps.reference.features.segments) and steps.rotation is None
    assert steps.registration.status is Status.FAILED
    draw_figures(tmp_path, steps, 'nothing')
    check_pictures(tmp_path)


def test_a_failed_registration_has_no_heading_and_no_minus_zero():
    steps = SimpleNamespace(registration=failed('nothing fits'), truth=None, by_paper=False)
    text = '\n'.join(describe(steps, Timing()))
    assert 'status      failed: nothing fits\n' in text and ' m  heading unknown, in the frame' in text
    assert '-0.0' not in text and 'deg' not in text.split('sigma')[1] and heading_text(16.0) == 'heading unknown'
    assert fixed(-1e-9, 2) == '0.00' and fixed(-0.006, 2) == '-0.01'


def test_scans_that_last_are_noted_where_the_sensor_moves():
    found = Registration(SE2(0.2, 0.0, math.radians(20.0)), np.diag((1e-6, 1e-6, 1e-6)), Status.OK)
    steps = SimpleNamespace(registration=found, truth=None, by_paper=False)
    for moved, text in (((0.025, math.radians(2.5)), 'up to 0.025 m and 2.50 deg'),
                        (None, 'at 90 deg/s it would be 9.0')):
        line, = (each for each in describe(steps, Timing(0.4, 0.1, moved)) if each.startswith('note'))
        assert 'each scan lasts 0.10 s' in line and text in line
    for timing in (Timing(0.4), Timing(0.4, 0.1, (1e-4, 1e-4))):
        assert not any(each.startswith('note') for each in describe(steps, timing))


def test_the_motion_during_a_scan_is_that_of_the_neighbours_not_of_the_pair(drive):
    """Of two scans far apart the sensor rotates at one only: the mean motion from scan to scan is much less."""
    stamps = np.array([scan.stamp for scan in drive.scans]) * 1e-9
    turn_rate = np.abs(np.diff(np.unwrap(drive.truth[:, 2]))) / np.diff(stamps)
    straight, turning = 1 + int(np.argmin(turn_rate[1:-1])), 1 + int(np.argmax(turn_rate[1:-1]))
    scans = dict(enumerate(drive.scans))
    distance, angle = _motion_during_scan(scans, (straight, turning), 0.1, Parameters())
    assert angle == pytest.approx(0.1 * turn_rate[turning], rel=0.1) and 0.0 <= distance < 0.15
    alone = {number: scans[number] for number in (straight, turning)}
    assert _motion_during_scan(alone, (straight, turning), 0.1, Parameters()) is None


@pytest.mark.parametrize('name', FIGURES)
@pytest.mark.parametrize('steps_of', [lambda *pair: Steps.of(*pair, Parameters()), Steps.of_paper],
                         ids=['dbscan', 'paper'])
def test_no_words_of_a_figure_lie_on_others(pair, name, steps_of):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=SIZE, layout='constrained')
    steps = steps_of(*pair)
    FIGURES[name].draw(figure, steps)
    figure.supxlabel(FIGURES[name].caption(steps), fontsize='medium')
    FigureCanvasAgg(figure).draw()
    boxes = [(text.get_text(), text.get_window_extent()) for text in words_of(figure)]
    page = figure.bbox
    for text, box in boxes:
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= page.x1 and box.y1 <= page.y1, text
    for (one, first), (two, second) in itertools.combinations(boxes, 2):
        assert not first.overlaps(second), (one, two)
    for axes in figure.axes:
        assert not axes.axison or (re.search(r'\[.+\]|segment|rank', axes.get_xlabel()) and axes.get_ylabel())


def words_of(figure):
    """Every text to be seen in a figure that was drawn."""
    if figure.get_supxlabel():
        yield figure._supxlabel
    for axes in figure.axes:
        if axes.get_legend():
            yield from axes.get_legend().get_texts()
        if not axes.axison:
            continue
        yield from (text for text in (axes.title, axes.xaxis.label, axes.yaxis.label) if text.get_text())
        for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            yield from (label for place, label in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
                        if low <= place <= high)


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / 'a.png'
    path.write_bytes(b'before')
    with pytest.raises(KeyboardInterrupt), replacing(path, binary=True) as file:
        file.write(b'half')
        raise KeyboardInterrupt
    assert path.read_bytes() == b'before' and list(tmp_path.iterdir()) == [path]
    with replacing(path, binary=True) as file:
        file.write(b'whole')
    assert path.read_bytes() == b'whole' and list(tmp_path.iterdir()) == [path]


def test_an_interrupted_drawing_leaves_whole_pictures(intel, tmp_path, monkeypatch, capsys):
    def interrupted(figure, steps):
        raise KeyboardInterrupt

    monkeypatch.setitem(FIGURES, 'densities', Drawing('', interrupted, ''))
    assert intel(REFERENCE, CURRENT) == 130
    folder, = (tmp_path / f'intel_{REFERENCE}_{CURRENT}').iterdir()
    assert sorted(file.name for file in folder.iterdir()) == ['points.png', 'rotation.png', 'segments.png',
                                                              'translation.png']
    assert all(ink(file).any() for file in folder.iterdir())
    assert capsys.readouterr().err == 'register: interrupted\n'
