# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks soak, silent and node measure: a long drive, equal bits, wrong answers, a running node."""
import pytest
from benchmarks.node import soak, streams, two_lidars


@pytest.fixture(scope='module')
def soaked(size):
    """The figures of a drive, and the digest of its results."""
    return soak.in_a_process(soak.drive, size(3000, 150_000))


def test_memory_and_containers_do_not_grow(soaked):
    figures, _ = soaked
    assert figures['growth_mb'] < 5.0
    assert figures['items_count'] <= 100


def test_a_map_of_a_building_stops_growing(size):
    figures = soak.in_a_process(soak.drive_with_map, size(4000, 150_000))
    assert figures['growth_mb'] < 5.0 and figures['over_mb'] < 100.0


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


def test_the_bench_of_the_node_measures_a_running_node():
    pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
    figures = streams.run({'beams': 181, 'fov': 180.0, 'rate': 10.0}, 30)
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
