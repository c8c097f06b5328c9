"""What every test may use: the recordings, a ROS graph of its own, processes that never outlive the test."""
import fcntl
import itertools
import os
import pathlib
import tempfile

import pytest

from dbscan_reg_ros.commands.processes import Process, package_command

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOMAINS = range(1, 102)
"""Domain 0 is everybody's; ids above 101 lead to ports that Linux gives away to anyone."""

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ.setdefault('MPLBACKEND', 'Agg')

_start = os.getpid() % len(DOMAINS)
_domains = itertools.cycle([*DOMAINS[_start:], *DOMAINS[:_start]])


def pytest_ignore_collect(collection_path):
    """Without ROS, leave out the files that import it."""
    if collection_path.suffix == '.py' and not _ros_installed():
        return 'import rclpy' in collection_path.read_text() or None


def _ros_installed():
    import importlib.util
    return importlib.util.find_spec('rclpy') is not None


@pytest.fixture(scope='session')
def root():
    """The project's folder."""
    return ROOT


@pytest.fixture(scope='session')
def data():
    """The folder of real recordings (the one that holds ``intel/``)."""
    folder = pathlib.Path(os.environ.get('DBSCAN_REG_DATA', ROOT.parent / 'shared' / 'data'))
    if not (folder / 'intel').is_dir():
        pytest.skip(f'no recordings in {folder}; set DBSCAN_REG_DATA to the folder that holds intel/')
    return folder


@pytest.fixture
def domain_id(monkeypatch):
    """A ROS domain that no other test uses at the same time, set for this process and its children."""
    if not _ros_installed():
        pytest.skip('needs ROS 2 (rclpy)')
    folder = pathlib.Path(tempfile.gettempdir()) / f'dbscan_reg_ros-domains-{os.getuid()}'
    folder.mkdir(exist_ok=True)
    for domain in itertools.islice(_domains, len(DOMAINS)):
        with open(folder / str(domain), 'a') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
            yield domain
            return
    pytest.fail(f'all ROS domains {DOMAINS[0]} to {DOMAINS[-1]} are in use')


@pytest.fixture
def ros_environment(domain_id, monkeypatch, tmp_path):
    """A ROS graph of this test's own, for this process and its children: the domain's number.

    The children find the package, keep their logs in the test's folder, and stop at a numerical warning.
    """
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')])))
    monkeypatch.setenv('PYTHONWARNINGS', 'error::RuntimeWarning')
    return domain_id


@pytest.fixture
def start(tmp_path):
    """``start(*command, **environment) -> Process``; what still runs when the test ends is stopped."""
    processes = []

    def start(*command, **environment):
        process = Process(command, tmp_path / f'process_{len(processes)}.log', environment)
        processes.append(process)
        return process

    yield start
    for process in reversed(processes):
        process.stop()


@pytest.fixture
def start_command(ros_environment, start):
    """``start_command('scan_matcher', '--ros-args', ...) -> Process``: a command of the package, in this test's graph."""
    return lambda *words, **environment: start(*package_command(*words), **environment)
