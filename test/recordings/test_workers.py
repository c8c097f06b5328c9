# SPDX-License-Identifier: Apache-2.0
"""Work for several processes: local ones and those of a Dask cluster do the same."""
import pytest
from bags import needs_rosbags

from dbscan_reg_ros.commands.replay import main as replay
from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.commands.workers import workers


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recordings')
    files = [folder / f'{name}.log' for name in 'abc']
    for seed, file in enumerate(files):
        assert simulate([str(file), '--world', 'corridor', '--speed', '4', '--rate', '5', '--seed', str(seed)]) == 0
    return files


def numerical_threads(_):
    """Threads of every numerical library of this process."""
    import scipy.linalg  # noqa: F401 - so that its library is there to be asked
    import sklearn.cluster  # noqa: F401
    from threadpoolctl import threadpool_info
    return [library['num_threads'] for library in threadpool_info()]


def results(recordings, out, *words):
    """What a replay leaves of each recording, but for times."""
    assert replay([*map(str, recordings), '--out', str(out), *words]) == 0
    return [(out / file.stem / 'latest' / 'trajectory.tum').read_bytes() for file in recordings]


@pytest.mark.long
def test_a_replay_is_the_same_in_one_process_in_two_and_on_a_cluster(recordings, tmp_path, cluster):
    one = results(recordings, tmp_path / 'one', '--processes', '1')
    assert one == results(recordings, tmp_path / 'two', '--processes', '2')
    assert one == results(recordings, tmp_path / 'cluster', '--scheduler', cluster.scheduler_address)


@pytest.mark.long
@needs_rosbags
def test_a_file_that_a_cluster_cannot_read_costs_no_other(recordings, tmp_path, cluster, capsys):
    words = ['absent.log', str(recordings[0]), '--out', str(tmp_path), '--scheduler', cluster.scheduler_address]
    assert replay(words) == 2
    printed = capsys.readouterr()
    assert 'absent.log: cannot be read' in printed.err and printed.err.count('\n') == 1
    assert (tmp_path / 'a' / 'latest' / 'report.html').exists()


def test_each_process_keeps_to_one_thread():
    with workers(2) as executor:
        for threads in executor.map(numerical_threads, range(2)):
            assert len(threads) >= 2 and set(threads) == {1}


@pytest.mark.long
def test_no_cluster_at_the_address_is_one_line(recordings, capsys):
    # First, for its defaults would be removed with what is set here.
    pytest.importorskip('distributed', reason='needs Dask (distributed)')
    dask = pytest.importorskip('dask')
    with dask.config.set({'distributed.comm.timeouts.connect': '1s'}):
        assert replay([str(recordings[0]), '--scheduler', 'tcp://127.0.0.1:1']) == 2
    assert 'no Dask scheduler answers' in capsys.readouterr().err
