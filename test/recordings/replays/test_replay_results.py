# SPDX-License-Identifier: Apache-2.0
"""What a replay writes even if its reports fail, and its summary of scans, distance and restarts."""
import dataclasses
import json
import math
import re

import numpy as np
import pytest
import yaml
from bags import SECOND, scan_bag

from dbscan_reg_ros import SE2
from dbscan_reg_ros.commands.replay import main
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.evaluation.metrics import duration, path_lengths
from dbscan_reg_ros.places.grid import Grid
from dbscan_reg_ros.places.map import Map
from dbscan_reg_ros.recordings import read_tum
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.in_map import grid_picture
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.replays.pairs_to_review import PairsToReview
from dbscan_reg_ros.robot.occupancy import FREE, OCCUPIED, UNKNOWN
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

pytest.importorskip('rosbags')


@pytest.fixture(scope='module')
def drive():
    """A robot with a rotating lidar: 10 Hz, each scan over the whole interval."""
    world = rooms(seed=1)
    lidar = Lidar(beams=360, angle_min=-math.pi + 0.01, duration=359 / 3600)
    return simulate(world, follow(world.tour[:4], speed=0.6), lidar, seed=1)


@pytest.fixture(scope='module')
def rotating(drive):
    """Scans from a robot that drives when they begin."""
    return drive.scans[15:75]


@pytest.fixture
def replay(tmp_path):
    """``replay(scans, *words) -> (exit code, folder of the results)``."""
    def replay(scans, *words):
        bag = scan_bag(tmp_path / 'drive', scans) if scans else tmp_path / 'drive'
        code = main([str(bag), '--out', str(tmp_path / 'out'), *words])
        return code, tmp_path / 'out' / 'drive' / 'latest'
    return replay


def moved_on(scans, seconds):
    return [dataclasses.replace(scan, stamp=scan.stamp + round(seconds * SECOND)) for scan in scans]


CLOCKS = {
    'steady': lambda scans: scans,
    'one stamp in the future': lambda scans: scans[:30] + moved_on(scans[30:31], 5.0) + scans[31:],
    'back': lambda scans: moved_on(scans[:30], 60.0) + scans[30:],
    'ten years': lambda scans: scans[:30] + moved_on(scans[30:], 3.2e8),
    'five seconds without scans': lambda scans: scans[:10] + moved_on(scans[40:], 2.0),
    'back twice': lambda scans: moved_on(scans[:20], 90.0) + moved_on(scans[20:40], 60.0) + scans[40:],
}


@pytest.mark.parametrize('clock', CLOCKS)
def test_pairs_to_review_name_scans_whatever_becomes_of_the_clock(rotating, clock):
    """A scan whose features are extracted again, once the motion is known, keeps its number."""
    scans = CLOCKS[clock](rotating)
    odometry, pairs, loops, references = Odometry(), PairsToReview(), Loops(), {}
    made_anew = 0
    for number, scan in enumerate(scans):
        update = odometry.process(scan)
        pairs.add(update)
        loops.add(update)
        assert update.number == number
        if update.reference is None:
            assert update.reference_number is None
        else:
            assert update.reference.scan.stamp == scans[update.reference_number].stamp
            made_anew += update.reference is not references.setdefault(update.reference_number, update.reference)
        references[number] = update.features
    assert made_anew >= 1
    assert pairs.found() and all(pair.reference_number < pair.number for pair in pairs.found())


def test_numbers_go_on_after_a_reset(rotating):
    odometry = Odometry()
    for scan in rotating[:5]:
        odometry.process(scan)
    odometry.reset(SE2(1.0, 2.0, 0.5))
    first, second = (odometry.process(scan) for scan in rotating[5:7])
    assert (first.number, first.reference_number) == (5, None)
    assert (second.number, second.reference_number) == (6, 5)


def broken(*_args, **_options):
    raise KeyError('a thing')


def whole(folder, count):
    """The trajectory and the measures are there."""
    stamps, poses = read_tum(folder / 'trajectory.tum')
    metrics = json.loads((folder / 'metrics.json').read_text())
    assert len(stamps) == len(poses) == metrics['scans'] - metrics['skipped'] == count
    return metrics


@pytest.mark.parametrize(('name', 'count', 'failed'), [
    ('two_scans', 2, 0), ('one_stamp_in_the_future', 60, 1), *(pytest.param(*case, marks=pytest.mark.long) for case in (
        ('four_seconds', 41, 0), ('simulated_3_hz_from_its_start', 7, 0), ('ten_scans_no_time_increment', 10, 0)))])
def test_a_recording_that_begins_on_the_move_gives_whole_results(cases, tmp_path, name, count, failed):
    assert main([str(cases / 'replay_starts_in_motion' / name), '--out', str(tmp_path)]) == 0
    folder = tmp_path / name / 'latest'
    metrics = whole(folder, count)
    assert (metrics['ok'], metrics['failed'], metrics['skipped']) == (count - failed, failed, 0)
    assert metrics['driven_m'] > 0.05
    assert {'map.png', 'report.html', 'bag'} <= {path.name for path in folder.iterdir()}


def test_a_map_of_key_frames_and_its_graph_are_written(cases, tmp_path, capsys):
    recording, file = str(cases / 'replay_starts_in_motion' / 'four_seconds'), tmp_path / 'map.npz'
    assert main([recording, '--out', str(tmp_path / 'out'), '--map-out', str(file), '--g2o']) == 0
    _, (first, *_) = read_tum(tmp_path / 'out' / 'four_seconds' / 'latest' / 'closed.tum')
    found = Map.load(file)
    assert found.graph.poses[0] == pytest.approx(first) and len(found.views) >= 1
    assert 'VERTEX_SE2 0' in (tmp_path / 'out' / 'four_seconds' / 'latest' / 'graph.g2o').read_text()
    capsys.readouterr()
    assert main([recording, recording, '--out', str(tmp_path), '--map-out', str(file)]) == 2
    assert capsys.readouterr().err == f'replay: --map-out {file}: expected one recording; 2 are given\n'


def test_a_drive_is_localised_in_the_map_of_another(tmp_path, capsys):
    """There, and back in the map of the way there."""
    world, lidar = rooms(seed=2), Lidar(beams=360, angle_min=-math.pi, rate=4.0)
    for name, way, seed in (('there', world.tour[2:7], 1), ('back', world.tour[6:2:-1], 2)):
        drive = simulate(world, follow(way), lidar, seed=seed)
        scan_bag(tmp_path / name, drive.scans)
    out, file = tmp_path / 'out', tmp_path / 'map.npz'
    assert main([str(tmp_path / 'there'), '--out', str(out), '--map-out', str(file)]) == 0
    capsys.readouterr()
    assert main([str(tmp_path / 'back'), '--out', str(out), '--map', str(file)]) == 0
    assert re.search(r'^in the map +localised after \d\.\d\d m, and at 100.0 % of the scans from then on; at the end '
                     'localised$', capsys.readouterr().out, re.MULTILINE)
    stamps, poses = read_tum(out / 'back' / 'latest' / 'in_map.tum')
    truth = relative(simulate(world, follow(world.tour[2:7]), lidar, seed=1).truth[:1].repeat(len(drive.truth), axis=0),
                     drive.truth)[np.searchsorted(drive.stamps, stamps)]
    assert len(stamps) > 20 and np.abs(relative(truth, poses)).max() < 0.1
    metrics = json.loads((out / 'back' / 'latest' / 'metrics.json').read_text())
    assert metrics['in_map_localised'] == len(stamps) and 0.0 <= metrics['in_map_first_m'] < 5.0
    states = [metrics[f'in_map_{state}'] for state in ('searching', 'localised', 'ambiguous', 'not_in_map')]
    assert sum(states) == metrics['scans']


def test_the_picture_of_a_turned_grid_has_its_walls_in_the_frame_of_the_map():
    """A wall along y = 1 of a grid that is turned by a quarter, and free cells on one side of it."""
    values = np.full((40, 60), UNKNOWN, dtype=np.int8)
    values[:20], values[20] = FREE, OCCUPIED
    density = grid_picture(Grid(values, SE2(2.0, -1.0, math.pi / 2.0), 0.05))
    left, right, bottom, top = density.extent
    assert (left, right, bottom, top) == pytest.approx((0.0, 2.0, -1.0, 2.0), abs=0.11)

    def ink(x, y):
        return density.ink[int((y - bottom) / 0.05), int((x - left) / 0.05)]

    assert ink(2.0 - 1.025, 0.5) == 1.0 and 0.0 < ink(1.5, 0.5) < 0.3 and ink(0.5, 0.5) == 0.0


PARTS = {
    'pairs to review': ('dbscan_reg_ros.replays.pairs_to_review.PairsToReview.add', {'report.html', 'map.png', 'bag'}),
    'bag': ('dbscan_reg_ros.replays.bag.odometry_fields', {'report.html', 'map.png'}),
    'map.png': ('dbscan_reg_ros.replays.results.draw_map', {'report.html', 'bag'}),
    'report.html': ('dbscan_reg_ros.replays.results.write_report', {'map.png', 'bag'}),
    'parameters.yaml': ('dbscan_reg_ros.robot.parameter_files.write_parameters', {'report.html', 'map.png', 'bag'}),
    'errors against the truth': ('dbscan_reg_ros.evaluation.known_motion.KnownMotion.measures',
                                 {'report.html', 'map.png', 'bag'}),
    'closed.tum': ('dbscan_reg_ros.replays.loops.Loops.poses', {'report.html', 'map.png', 'bag'}),
    'latest': ('dbscan_reg_ros.replays.result_folder.point_latest', {'report.html', 'map.png', 'bag'}),
}


@pytest.mark.parametrize('part', [part if k % 2 else pytest.param(part, marks=pytest.mark.long)
                                  for k, part in enumerate(PARTS)])
def test_a_fault_of_the_reporting_is_one_line_and_costs_no_result(replay, rotating, tmp_path, capsys, monkeypatch,
                                                                  part):
    place, others = PARTS[part]
    monkeypatch.setattr(place, broken)
    code, _ = replay(rotating[:20], *(['--close-loops'] if part == 'closed.tum' else []))
    said = capsys.readouterr()
    folder, = (path for path in (tmp_path / 'out' / 'drive').iterdir() if not path.is_symlink())
    assert code == 3
    assert whole(folder, 20)['ok'] >= 18
    assert others <= {path.name for path in folder.iterdir()}
    assert said.err == f"replay: {tmp_path}/drive: {part} not written: internal error: 'a thing' (-v shows where)\n"
    assert re.search(r'^scans +20 skipped 0 ok', said.out, re.MULTILINE)


def test_a_damaged_truth_costs_the_errors_against_it_not_the_result(data, tmp_path, capsys):
    import gzip
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as log:
        (tmp_path / 'a.log').write_text(''.join(line for line, _ in zip(log, range(40))))
    (tmp_path / 'a.relations').write_text('1 2 three\n')
    assert main([str(tmp_path / 'a.log'), '--out', str(tmp_path)]) == 3
    assert 'relations_all_mean_m' not in whole(tmp_path / 'a' / 'latest', json.loads(
        (tmp_path / 'a' / 'latest' / 'metrics.json').read_text())['scans'])
    assert (f'errors against the truth not written: {tmp_path}/a.relations:1: expected t1 t2 x y z roll pitch yaw'
            in capsys.readouterr().err)


def test_a_recording_that_failed_decides_the_status_before_one_in_part(rotating, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('dbscan_reg_ros.replays.results.draw_map', broken)
    bags = [str(scan_bag(tmp_path / name, rotating[:count])) for name, count in (('a', 5), ('b', 1))]
    out = ['--out', str(tmp_path / 'out'), '--processes', '1']
    assert main([bags[0], *out]) == 3
    assert main([*bags, *out]) == 2
    assert main([*reversed(bags), *out]) == 2


def test_v_shows_where_a_fault_of_the_reporting_comes_from(replay, rotating, capsys, monkeypatch):
    monkeypatch.setattr('dbscan_reg_ros.replays.results.draw_map', broken)
    assert replay(rotating[:5], '-v')[0] == 3
    said = capsys.readouterr().err
    assert said.startswith('Traceback') and said.count('Traceback') == 1 and 'in broken' in said


def test_an_odometry_that_breaks_off_leaves_what_it_found_until_then(replay, rotating, capsys, monkeypatch):
    process, left = Odometry.process, iter(range(12))

    def breaks_off(self, scan, *further):
        if next(left, None) is None:
            raise ZeroDivisionError('by zero')
        return process(self, scan, *further)

    monkeypatch.setattr(Odometry, 'process', breaks_off)
    code, folder = replay(rotating[:20])
    assert code == 1
    whole(folder, 12)
    assert {'map.png', 'report.html', 'bag'} <= {path.name for path in folder.iterdir()}
    assert 'the results end before scan 12: internal error: by zero (-v shows where)\n' in capsys.readouterr().err


@pytest.mark.parametrize(('part', 'says'), [
    (slice(3, 4), 'contains one scan; expected at least two, '),
    (slice(6), 'only one of 6 scans could be used; scan 0 not used: ')])
def test_fewer_than_two_usable_scans_are_one_clear_line(replay, rotating, tmp_path, capsys, part, says):
    scans = [scan if k == 3 else dataclasses.replace(scan, ranges=np.full_like(scan.ranges, np.inf))
             for k, scan in enumerate(rotating[:6])]
    code, _ = replay(scans[part])
    error, = capsys.readouterr().err.splitlines()
    assert code == 2 and error.startswith(f'replay: {tmp_path}/drive: {says}')


def test_without_truth_distance_time_and_end_points_are_reported(replay, drive, rotating, capsys):
    """What could not be used and what could not be registered have two names."""
    blind = dataclasses.replace(rotating[20], ranges=np.full_like(rotating[20].ranges, np.inf))
    code, folder = replay([*rotating[:20], blind, *rotating[21:]])
    metrics = whole(folder, 59)
    assert code == 0
    driven, seconds, metres, degrees = map(float, re.search(
        r'^driven +([\d.]+) m in ([\d.]+) s, the end is ([\d.]+) m and ([\d.]+) deg from the start$',
        capsys.readouterr().out, re.MULTILINE).groups())
    assert driven == pytest.approx(path_lengths(drive.truth[15:75])[-1], rel=0.02) and seconds == 5.9
    _, poses = read_tum(folder / 'trajectory.tum')
    assert metres == pytest.approx(np.hypot(*poses[-1, :2]), abs=1e-3)
    assert degrees == pytest.approx(abs(math.degrees(poses[-1, 2])), abs=0.1)
    assert (metrics['skipped'], metrics['failed'], metrics['restarts']) == (1, 0, 0)
    assert metrics['driven_m'] == pytest.approx(driven, abs=0.01) and metrics['duration_s'] == pytest.approx(5.9)


def test_a_restart_is_counted_and_the_jump_of_the_clock_is_no_driving_time(replay, rotating, capsys):
    code, folder = replay(CLOCKS['ten years'](rotating))
    metrics = whole(folder, 60)
    assert code == 0 and (metrics['stamp_jumps'], metrics['duration_s']) == (1, pytest.approx(5.8))
    printed = capsys.readouterr().out
    assert 'in 5.8 s (jumps of the stamps left out: 1), the end is' in printed
    assert metrics['restarts'] == len(re.findall('restarts 1$', printed, re.MULTILINE))


@pytest.mark.parametrize(('stamps', 'seconds', 'jumps'), [
    ([], 0.0, 0), ([5], 0.0, 0), ([0, 1, 2, 3], 3.0, 0), ([0, 1, 0.5, 3], 3.0, 0), ([0, 1, 2, 100, 3, 4], 3.0, 2),
    ([7, 7, 7], 0.0, 0), ([0, 5, 10, 15, 20], 20.0, 0), ([0, 5, 10, 100, 105], 15.0, 1), ([3, 2, 1], 0.0, 0)])
def test_jumps_of_the_stamps_are_not_time_that_passed(stamps, seconds, jumps):
    assert duration([round(stamp * SECOND) for stamp in stamps], 2.0) == (seconds, jumps)


def loaded(folder):
    """Values 0, 100, -1 of the cells, by row of y, the corner and the resolution, as map_server of nav2 loads them."""
    fields = yaml.safe_load((folder / 'map.yaml').read_text())
    kind, sides, depth, pixels = (folder / fields['image']).read_bytes().split(b'\n', 3)
    width, height = map(int, sides.split())
    assert (kind, depth, len(pixels)) == (b'P5', b'255', width * height)
    assert (fields['mode'], fields['negate'], fields['origin'][2]) == ('trinary', 0, 0.0)
    occupancy = 1.0 - np.frombuffer(pixels, np.uint8).reshape(height, width)[::-1] / 255.0
    values = np.where(occupancy > fields['occupied_thresh'], 100, np.where(occupancy < fields['free_thresh'], 0, -1))
    return values, np.array(fields['origin'][:2]), fields['resolution']


@pytest.mark.parametrize('words', [(), ('--close-loops',)])
def test_the_grid_of_a_replay_is_loaded_as_the_rooms_that_were_seen(replay, drive, rotating, words):
    code, folder = replay(rotating, '--grid', '0.1', *words)
    assert code == 0
    values, corner, resolution = loaded(folder)
    assert resolution == 0.1 and set(values.ravel()) == {-1, 0, 100}
    values = np.pad(values, 1, constant_values=-1)

    def at(points):
        x, y = np.floor((points - corner) / resolution).astype(int).T + 1
        return values[y, x]

    # The map is that of the poses that the replay writes.
    _, poses = read_tum(folder / ('closed.tum' if words else 'trajectory.tum'))
    assert (at(poses[:, :2]) == 0).all()
    scan = drive.scans[15]
    beside = np.stack([at(scan.points[scan.valid] + resolution * np.array((dx, dy)))
                       for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    assert (beside.max(axis=0) == 100).mean() > 0.85


def test_a_grid_with_too_many_cells_is_named_and_all_else_is_written(replay, rotating, capsys):
    code, folder = replay(rotating[:20], '--grid', '0.001')
    assert code == 3 and 'use a larger resolution' in capsys.readouterr().err
    assert (folder / 'report.html').exists() and not (folder / 'map.yaml').exists()


def test_a_grid_of_no_size_is_refused(replay, rotating, capsys):
    with pytest.raises(SystemExit):
        replay(rotating[:2], '--grid', '0')
    assert "'0': expected the side of a cell, 0.001 to 10 m" in capsys.readouterr().err
