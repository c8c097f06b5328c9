# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks soak, silent and node measure: a long drive, equal bits, wrong answers, a running node."""
import numpy as np
import pytest
from benchmarks.node import running_node, soak, streams, two_lidars
from benchmarks.odometry import silent
from benchmarks.odometry.courses import Course
from benchmarks.odometry.drift import Drive

from dbscan_reg_ros import SE2, Status
from dbscan_reg_ros.evaluation.trackers import Step


@pytest.fixture(scope='module')
def soaked(size):
    """The figures of a drive, and the digest of its results."""
    return soak.in_a_process(soak.drive, size(3000, 150_000))


def test_memory_and_containers_do_not_grow(soaked):
    figures, _ = soaked
    assert figures['growth_mb'] < 5.0
    assert figures['items_count'] <= 100


def test_three_runs_are_equal_to_the_last_bit(soaked, size):
    _, blocks = soaked
    for seed in range(1, size(3, 4)):
        _, again = soak.in_a_process(soak.drive, 1000, hash_seed=seed, threads=seed)
        assert again == blocks[:1]


def test_the_node_says_the_same_to_the_last_bit(soaked, size):
    pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
    count = size(2000, 150_000)
    figures = soak.drive_node(count, soaked[1])
    assert (figures['scans_count'], figures['lost_count'], figures['differ_count']) == (count, 0, 0)
    assert figures['growth_mb'] < 5.0


def test_memory_that_comes_and_goes_is_not_taken_for_growth():
    held = [100.0, 120.0, 101.0, 118.0] * 20
    assert soak.growth(held) == 0.0
    assert soak.growth([memory + 0.1 * k for k, memory in enumerate(held)]) == pytest.approx(7.2)


def test_digests_differ_if_one_bit_of_a_result_differs():
    one, other = soak.Blocks(), soak.Blocks()
    for blocks, value in ((one, 1.0), (other, np.nextafter(1.0, 2.0))):
        for k in range(2000):
            blocks.add([0.5, value if k == 1500 else 1.0])
    assert one.digests[0] == other.digests[0]
    assert soak.differing(one.digests, other.digests) == 1


def test_scans_to_and_fro_go_on_in_time(scans):
    stream = running_node.to_and_fro(scans[:4], rate=10.0)
    taken = [next(stream) for _ in range(8)]
    for scan, k in zip(taken, (0, 1, 2, 3, 2, 1, 0, 1), strict=True):
        assert scan.ranges.tobytes() == scans[k].ranges.tobytes()
    assert set(np.diff([scan.stamp for scan in taken])) == {100_000_000}


def driven(statuses, error):
    """A `Drive` of half a metre a scan, that is `error` [m] too far from its fourth scan on."""
    reference = np.zeros((len(statuses), 3))
    reference[:, 0] = 0.5 * np.arange(len(statuses))
    result = Drive(Course([None] * len(statuses), reference=reference))
    for k, (pose, status) in enumerate(zip(reference, statuses, strict=True)):
        result.steps.append(Step(SE2(float(pose[0]) + error * (k >= 3), 0.0, 0.0), status))
    return result


def test_a_wrong_motion_that_is_called_ok_is_counted():
    counts, lines = silent.silent(driven([Status.OK] * 8, 0.3))
    assert (counts['step_silent_count'], counts['1m_silent_count']) == (1, 2)
    assert counts['step_worst_m'] == pytest.approx(0.3)
    assert lines[0] == 'step from scan 2 to 3: 0.300 m 0.00 deg'


@pytest.mark.parametrize(('status', 'error'), [(Status.OK, 0.19), (Status.AMBIGUOUS, 0.3), (Status.FAILED, 0.3)])
def test_small_errors_and_those_that_are_admitted_are_not_counted(status, error):
    statuses = [Status.OK] * 8
    statuses[3] = status
    counts, lines = silent.silent(driven(statuses, error))
    assert (counts['step_silent_count'], counts['1m_silent_count'], lines) == (0, 0, [])
    assert counts['ok'] == pytest.approx(1.0 if status is Status.OK else 7 / 8)


def test_counts_of_several_drives_add_up_and_the_greatest_error_counts():
    rows = [{'ok': 1.0, 'step_silent_count': 1, 'step_worst_m': 0.1},
            {'ok': 0.5, 'step_silent_count': 2, 'step_worst_m': 0.4}]
    assert silent.total(rows) == {'ok': 0.75, 'step_silent_count': 3, 'step_worst_m': 0.4}


def test_the_bench_of_the_node_measures_a_running_node():
    pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
    figures = streams.run(beams=181, fov=180.0, rate=10.0, count=30)
    assert figures['lost_count'] < 15
    assert 0.0 < figures['ms_p50'] <= figures['ms_p99'] < 2000.0
    assert 0.0 < figures['core'] < 4.0
    assert abs(figures['growth_mb']) < 100.0


def test_the_bench_of_the_node_compares_two_lidars_with_one():
    pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
    figures = two_lidars.compare(seconds=7.0, rounds=1)
    assert set(figures) == set(two_lidars.BOUNDS) and all(set(two_lidars.BOUNDS[name]) <= set(row)
                                                          for name, row in figures.items())
    # The second lidar is used after ten comparisons.
    assert 0.3 < figures['pair_all']['used'] < 1.0
    assert all(0.5 < figures[name]['ratio_core'] < 3.0 for name in two_lidars.STREAMS)
    assert all(0.0 < row['ms_p50'] <= row['ms_p99'] < 2000.0 and row['lost_count'] < 100 for row in figures.values())
