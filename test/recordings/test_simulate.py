# SPDX-License-Identifier: Apache-2.0
"""The command that simulates: what was asked for is measured back from the files."""
import numpy as np
import pytest
from bags import messages, needs_rosbags
from matplotlib.image import imread

from dbscan_reg_ros import simulation
from dbscan_reg_ros.commands.simulate import PRESETS, main
from dbscan_reg_ros.recordings import interpolate, open_recording
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import LIDARS

pytestmark = needs_rosbags

SHORT = '--world', 'corridor', '--speed', '2'


@pytest.fixture
def simulated(tmp_path):
    """``simulated('bag', ...) -> path`` of what was written."""
    def simulated(name, *words):
        assert main([str(tmp_path / name), *SHORT, *map(str, words)]) == 0
        return tmp_path / name
    return simulated


def test_a_bag_holds_scans_wheels_gyroscope_and_truth(simulated, capsys):
    bag = simulated('bag', '--lidar', 'hokuyo_urg04lx', '--mounting', 0.2, -0.1, 90)
    printed = capsys.readouterr().out
    recording = open_recording(bag)
    scans = list(recording.scans())
    assert recording.topic == '/scan' and f'{len(scans)} /scan, ' in printed
    assert scans[0].geometry == LIDARS['hokuyo_urg04lx'].geometry
    assert np.diff(recording.stamps()).tolist() == [10**8] * (len(scans) - 1)
    stamps, truth = recording.truth()
    assert stamps.tolist() == recording.stamps()
    np.testing.assert_allclose(truth[0], [1.5 + 0.2, -0.1, np.pi / 2], atol=1e-6)
    transform = messages(bag, '/tf_static')[0][2].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ('base_link', 'laser')
    assert (transform.transform.translation.x, transform.transform.translation.y) == (0.2, -0.1)
    assert transform.transform.rotation.z == pytest.approx(np.sqrt(0.5))
    assert len(recording.wheel_odometry()[0]) > 1.9 * len(scans)
    assert messages(bag, '/imu')[0][2].orientation_covariance[0] == -1.0
    twists = np.array([(m.twist.twist.linear.x, m.twist.twist.linear.y, m.twist.twist.angular.z)
                       for _, _, m in messages(bag, '/truth')])
    steps = relative(truth[:-1], truth[1:])
    mean = 0.5 * (twists[:-1] + twists[1:])
    np.testing.assert_allclose(0.1 * mean[:, 2], steps[:, 2], atol=0.01)
    np.testing.assert_allclose(0.1 * np.hypot(*mean[:, :2].T), np.hypot(*steps[:, :2].T), atol=0.01)
    assert abs(twists[:, 1]).max() > 2.0 * abs(twists[:, 0]).max()


def test_a_log_holds_the_same_scans_and_the_same_truth(simulated):
    bag, log = (open_recording(simulated(name, '--seed', 5)) for name in ('bag', 'a.log.gz'))
    for ours, other in zip(bag.scans(), log.scans(), strict=True):
        assert ours.stamp == other.stamp and np.array_equal(ours.ranges, other.ranges)
        assert ours.geometry.bearings == pytest.approx(other.geometry.bearings, abs=1e-6)
    np.testing.assert_allclose(bag.truth()[1], log.truth()[1], atol=1e-8)
    np.testing.assert_allclose(interpolate(*bag.wheel_odometry(), log.stamps()[:-1]), log.wheel_odometry()[1][:-1],
                               atol=1e-8)


def test_there_is_a_lidar_for_every_file_of_a_sensor(root):
    assert {path.stem for path in (root / 'config').glob('*.yaml')} - set(PRESETS) == {'scan_matcher', 'ekf'}


@pytest.mark.parametrize('name', ['bag', 'a.log.gz'])
def test_a_changing_number_of_beams_and_missing_returns_are_recorded(simulated, name):
    scans = list(open_recording(simulated(name, '--lidar', 'lds_03', '--seconds', 4, '--dropouts', 0.1)).scans())
    counts = {scan.geometry.size for scan in scans}
    assert len(counts) > 4 and max(counts) - min(counts) <= 8
    assert 0.85 < np.mean(np.concatenate([scan.valid for scan in scans])) < 0.95


def test_one_seed_gives_one_recording_and_another_another(simulated):
    first, same, other = (simulated(name, '--seed', seed, '--outliers', 0.1).read_bytes()
                          for name, seed in (('a.log', 1), ('b.log', 1), ('c.log', 2)))
    assert first == same != other


def test_noise_wheels_and_gyroscope_are_those_asked_for(simulated):
    laps = '--resolution', 0, '--laps', 2
    exact = open_recording(simulated('exact', '--noise', 0, *laps))
    bag = simulated('bag', *laps, '--noise', 0.02, '--dropouts', 0.1, '--outliers', 0.05, '--wheel-scale', 1.1, 0.9,
                    '--wheel-noise', 0, 0, '--slip', 5, 8, 1.5, '--gyro-bias', 0.03, '--gyro-noise', 0.01)
    recording = open_recording(bag)
    true, ranges = (np.concatenate([scan.ranges for scan in each.scans()]) for each in (exact, recording))
    assert (np.isinf(ranges) & np.isfinite(true)).sum() / np.isfinite(true).sum() == pytest.approx(0.1, abs=0.006)
    both = np.isfinite(ranges) & np.isfinite(true)
    error = ranges[both] - true[both]
    wild = np.abs(error) > 0.1
    assert wild.mean() == pytest.approx(0.05 / 0.9, abs=0.006)
    assert error[~wild].std() == pytest.approx(0.02, rel=0.05)

    stamps, wheels = recording.wheel_odometry()
    truth = interpolate(*recording.truth(), stamps)
    known = np.isfinite(truth).all(axis=1)
    seconds, wheels, truth = (stamps[known][1:] - stamps[0]) / 1e9, wheels[known], truth[known]
    steps, true_steps = relative(wheels[:-1], wheels[1:]), relative(truth[:-1], truth[1:])
    slipping, driving = (seconds > 5.1) & (seconds < 7.9), np.abs(true_steps[:, 0]) > 0.02
    rolling, turning = driving & ((seconds < 4.9) | (seconds > 8.1)), np.abs(true_steps[:, 2]) > 0.02
    for chosen, axis, ratio in ((slipping, 0, 1.65), (rolling, 0, 1.1), (turning, 2, 0.9)):
        assert np.median(steps[chosen, axis] / true_steps[chosen, axis]) == pytest.approx(ratio, abs=0.02)

    _, rates = recording.yaw_rates()
    assert np.median(rates) == pytest.approx(0.03, abs=0.002)
    low, high = np.percentile(rates[np.abs(rates) < 0.1], (16.0, 84.0))
    assert 0.5 * (high - low) == pytest.approx(0.01, rel=0.2)


def test_people_stand_on_the_picture_and_in_the_scans(simulated):
    alone, visited = (simulated(f'bag{count}', '--people', count) for count in (0, 2))
    nearer = [np.nanmean(b.ranges < a.ranges - 0.2) for a, b in zip(
        open_recording(alone).scans(), open_recording(visited).scans(), strict=True)]
    assert 0.005 < np.mean(nearer) < 0.2
    picture = imread(visited.with_name('bag2.png'))[..., :3]
    assert 0.005 < 1.0 - picture.mean() < 0.2 and picture.shape[1] > 1000


def test_a_lidar_may_see_the_robot_itself(simulated):
    scans = list(open_recording(simulated('own', '--noise', 0, '--resolution', 0, '--seconds', 2, '--body', 20, 40, 0.3,
                                          '--body', -30.5, -20, 0.2)).scans())
    bearings = np.degrees(scans[0].geometry.bearings)
    for first, last, distance in ((20, 40, 0.3), (-30.5, -20, 0.2)):
        sector = (bearings > first) & (bearings < last)
        assert sector.sum() >= 10
        for scan in scans:
            np.testing.assert_allclose(scan.ranges[sector], distance, atol=1e-3)
            assert scan.ranges[~sector].max() > 0.5


@pytest.mark.parametrize(('seconds', 'laps'), [(3.0, ()), (40.0, ()), (40.0, ('--laps', 2))])
def test_a_drive_ends_after_the_given_time(simulated, seconds, laps):
    """The tour of the corridor takes 17 s; it is repeated until then, unless laps are given."""
    once, drive = (open_recording(simulated(name, *words)) for name, words in (
        ('once', ()), ('drive', ('--seconds', seconds, *laps))))
    (stamps, poses), (first, part) = drive.truth(), once.truth()
    assert np.allclose(poses[:len(first)], part[:len(poses)])
    ended = 1e-9 * (stamps[-1] - stamps[0])
    if laps:
        assert seconds > ended > 1.7e-9 * (first[-1] - first[0])
    else:
        assert seconds - 0.3 < ended <= seconds


@pytest.mark.parametrize(('words', 'duration'), [
    (('--rate', 20), 0.199 / 4), (('--rate', 2), 0.199), (('--rate', 20, '--duration', 0.03), 0.03),
])
def test_a_lidar_with_more_scans_per_second_turns_faster(simulated, words, duration):
    scan = next(open_recording(simulated('bag', '--seconds', 2, '--lidar', 'lds', *words)).scans())
    assert scan.time_increment * 359 == pytest.approx(duration, rel=1e-6)


@pytest.mark.parametrize(('words', 'says'), [
    (['bag', '--seconds', '0.5'], '--seconds 0.5: expected 1 to 86400'),
    (['bag', '--seconds', '2', '--phase', '3'], 'the drive of 2.0 s ends before the first scan'),
    (['bag', '--beams', '0'], 'a scan of 0 beams'), (['bag', '--dropouts', '2'], '--dropouts 2.0'),
    (['bag', '--laps', '0'], '--laps 0'), (['bag', '--rate', '5', '--duration', '0.3'], 'at most 0.2 s'),
    (['bag', '--range-min', '5', '--range-max', '2'], '--range-min 5: expected less than'),
    (['a.bag'], 'a.bag: expected NAME.log'),
])
def test_what_cannot_be_is_refused_in_one_line(tmp_path, capsys, words, says):
    name, *words = words
    assert main([str(tmp_path / name), *SHORT, *words]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count('\n') == 1 and list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(simulated, tmp_path, capsys):
    before = simulated('a.log').read_bytes()
    assert main([str(tmp_path / 'a.log'), *SHORT]) == 2
    assert 'a.log: exists already' in capsys.readouterr().err and (tmp_path / 'a.log').read_bytes() == before
    (tmp_path / 'b.log.png').write_text('mine')
    assert main([str(tmp_path / 'b.log'), *SHORT]) == 2
    assert 'b.log.png: exists already' in capsys.readouterr().err and not (tmp_path / 'b.log').exists()
    assert (tmp_path / 'b.log.png').read_text() == 'mine'


def test_the_demo_is_a_tour_of_60_to_100_metres_in_600_to_1000_scans():
    result = simulation.demo()
    assert 60.0 < result.path.length < 100.0
    assert 600 <= len(result.scans) <= 1000
    assert np.all(np.diff(result.stamps) == 100_000_000)
    assert min(np.count_nonzero(scan.valid) for scan in result.scans) > 150
    assert np.hypot(*(result.truth[0] - result.truth[-1])[:2]) < 0.5
