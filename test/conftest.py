# SPDX-License-Identifier: Apache-2.0
"""What every test may use: the recordings, a ROS graph of its own, processes that never outlive the test."""
import contextlib
import importlib.util
import itertools
import math
import os
import pathlib
import signal
from functools import partial

import hypothesis
import numpy as np
import pytest
from manifest import NOT_IN_THE_MANIFEST
from preloaded import ForkedProcess, Preloaded

from dbscan_reg_ros import SE2, RecordingError
from dbscan_reg_ros.commands.processes import Process, package_command
from dbscan_reg_ros.commands.simulate import main as simulate_command
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.private_graph import private_graph
from dbscan_reg_ros.recordings import data_folder
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

ROOT = pathlib.Path(__file__).resolve().parent.parent

os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(ROOT / 'test' / 'fastdds.xml')
os.environ.setdefault('MPLBACKEND', 'Agg')

hypothesis.settings.register_profile('bounded', derandomize=True, database=None, deadline=None, max_examples=15)
hypothesis.settings.register_profile('long', hypothesis.settings.get_profile('bounded'), max_examples=2000)


LIMIT = 16.3
"""One true motion in a thousand is farther off than this, as a squared Mahalanobis distance."""
LONG_FOLDERS = {('benchmarks',), ('documents',), ('fuzz',), ('long',)}
LONG_FIXTURES = {'started_browser', 'docs_python'}


def pytest_addoption(parser):
    parser.addoption('--long', action='store_true',
                     help='all tests, and as much of everything as doc/reliability.md says, not the bounded '
                     'form: it takes hours')


def pytest_configure(config):
    hypothesis.settings.load_profile('long' if config.getoption('--long') else 'bounded')
    # Under nohup or in the background a shell ignores signals, and children inherit that: a handler, they do not.
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda *_: None)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    if item.get_closest_marker('long') and not item.config.getoption('--long'):
        pytest.skip('with --long: takes long')
    with skipping_what_is_missing():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    with skipping_what_is_missing():
        return (yield)


@contextlib.contextmanager
def skipping_what_is_missing():
    """Skip a test that needs a package that the manifest does not name, where that is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (package := str(error.name).partition('.')[0]) not in NOT_IN_THE_MANIFEST:
            raise
        pytest.skip(f'needs the Python package {package}')


def pytest_collection_modifyitems(config, items):
    """Leave out what takes long, unless with ``--long`` or where its folder is named; of browsers alone."""
    def folder(path):
        path = (config.invocation_params.dir / path).resolve()
        return path.relative_to(ROOT / 'test').parts[:1] if path.is_relative_to(ROOT / 'test') else ()

    named = {folder(str(word).partition('::')[0]) for word in config.args} - {()}
    left_out = [item for item in items if not config.getoption('--long') and (
        (place := folder(item.path)) in LONG_FOLDERS - named
        or (LONG_FIXTURES & {*getattr(item, 'fixturenames', ())} and named != {place}))]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


def pytest_generate_tests(metafunc):
    """The number of the scan at which a fault strikes: one, with ``--long`` twenty."""
    if 'moment' in metafunc.fixturenames:
        count = 20 if metafunc.config.getoption('long') else 1
        metafunc.parametrize('moment', np.random.default_rng(8).integers(10, 50, count).tolist())


def pytest_ignore_collect(collection_path):
    """Without ROS, leave out the files that import it."""
    if collection_path.suffix == '.py' and not _ros_installed():
        return 'import rclpy' in collection_path.read_text() or None


def _ros_installed():
    return importlib.util.find_spec('rclpy') is not None


@pytest.fixture(scope='session')
def size(request):
    """``size(bounded, full)``: how much to try, without and with ``--long``."""
    return lambda bounded, full: full if request.config.getoption('--long') else bounded


@pytest.fixture(scope='session')
def root():
    """The project's folder."""
    return ROOT


@pytest.fixture(scope='session')
def data():
    """The folder of real recordings (the one that holds ``intel/``)."""
    try:
        return data_folder()
    except RecordingError as error:
        pytest.skip(str(error))


@pytest.fixture(scope='session')
def intel_log(data):
    """The Intel log with its references; it is read once."""
    from benchmarks.intel import Intel
    return Intel(data / 'intel')


@pytest.fixture(scope='session')
def beginning(data, tmp_path_factory):
    """A folder of data with the first 20 s of the bag ``urg04lx/exp1`` under its name."""
    pytest.importorskip('rosbags', reason='needs the Python package rosbags')
    from dbscan_reg_ros.recordings.conversion import Kept, convert
    folder = tmp_path_factory.mktemp('data')
    (folder / 'urg04lx').mkdir()
    convert(data / 'urg04lx' / 'exp1', folder / 'urg04lx' / 'exp1', Kept(end=20.0))
    return folder


@pytest.fixture(scope='session')
def cases():
    """The folder of small recordings that show a fault each."""
    folder = ROOT.parent / 'shared' / 'cases'
    if not folder.is_dir():
        pytest.skip(f'{folder}: no such folder of recordings')
    return folder


@pytest.fixture
def domain_id():
    """A ROS domain that no other test uses at the same time, set for this process and its children."""
    if not _ros_installed():
        pytest.skip('needs ROS 2 (rclpy)')
    with private_graph() as domain:
        yield domain


@pytest.fixture
def ros_environment(domain_id, monkeypatch, tmp_path):
    """A ROS graph of this test's own, for this process and its children: the domain's number.

    The children find the package, keep their logs in the test's folder, and stop at a numerical warning, but not when a
    caller of a service is not there any more: rclpy warns of that in the same category.
    """
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')])))
    monkeypatch.setenv('PYTHONWARNINGS', 'error::RuntimeWarning,default:failed to send response:RuntimeWarning')
    return domain_id


@pytest.fixture
def start(tmp_path):
    """``start(*command, **environment) -> Process``; what still runs when the test ends is stopped."""
    processes = []

    def start(*command, kind=Process, **environment):
        process = kind(command, tmp_path / f'process_{len(processes)}.log', environment)
        processes.append(process)
        return process

    yield start
    for process in reversed(processes):
        process.stop()


@pytest.fixture(scope='session')
def preload():
    """``preload() -> Preloaded``: the process that nodes are forked from, which is started once."""
    started = []

    def preload():
        if not started:
            started.append(Preloaded())
        return started[0]

    yield preload
    for process in started:
        process.close()


@pytest.fixture
def start_command(ros_environment, start, preload):
    """``start_command('scan_matcher', '--ros-args', ...) -> Process``: a command, in this test's graph.

    Forked where that makes no difference; ``start(*package_command(...))`` starts an interpreter.
    """
    def start_command(*words, **environment):
        if preload().serves(environment):
            return start(*words, kind=partial(ForkedProcess, preload()), **environment)
        return start(*package_command(*words), **environment)
    return start_command


@pytest.fixture
def start_node(start_command):
    """``start_node(*ros_arguments) -> Process``: scan_matcher with the laser as the base, unless they say otherwise."""
    return lambda *words, **environment: start_command('scan_matcher', '--ros-args', '-p', 'mounting:=none', *words,
                                                       **environment)


@pytest.fixture
def node(start_node):
    """A running scan_matcher."""
    return start_node()


@pytest.fixture
def player(ros_environment):
    from dbscan_reg_ros.node.playback.player import Player
    with Player() as player:
        yield player


@pytest.fixture
def peer(ros_environment):
    from ros_helpers import Peer
    with Peer() as peer:
        yield peer


@pytest.fixture
def without_tf2_msgs(tmp_path, ros_environment):
    """An environment in which tf2_msgs cannot be imported."""
    package = tmp_path / 'hidden' / 'tf2_msgs'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text("raise ModuleNotFoundError('hidden', name='tf2_msgs')")
    return {'PYTHONPATH': os.pathsep.join([str(package.parent), os.environ['PYTHONPATH']])}


@pytest.fixture(scope='module')
def cluster():
    """A Dask cluster of two local workers."""
    distributed = pytest.importorskip('distributed', reason='needs Dask (distributed)')
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=':0') as cluster:
        yield cluster


@pytest.fixture(scope='session')
def started_browser(tmp_path_factory):
    """A browser that is started once: a start takes longer than most tests of a page."""
    from benchmarks.page.browser import Browser, find_browser
    if find_browser() is None:
        pytest.skip('needs a chromium on the PATH')
    with contextlib.closing(Browser(tmp_path_factory.mktemp('profile'))) as browser:
        yield browser


@pytest.fixture(scope='session')
def hall_recording(tmp_path_factory):
    """A simulated drive through a hall as a bag, of 45 s."""
    pytest.importorskip('rosbags', reason='needs the Python package rosbags')
    target = tmp_path_factory.mktemp('recording') / 'hall'
    assert simulate_command([str(target), '--world', 'hall', '--speed', '2', '--rate', '4', '--seconds', '45', '--seed',
                             '4']) == 0
    return target


@pytest.fixture
def tf_type():
    return pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)').TFMessage


@pytest.fixture(scope='session')
def drive():
    """Eight seconds through a room's door and along its furniture, at 10 Hz."""
    world = rooms(seed=1)
    return simulate(world, follow(world.tour[:4], speed=1.0), Lidar(beams=360, angle_min=-math.pi + 0.01), seed=1)


@pytest.fixture(scope='session')
def scans(drive):
    return drive.scans[:80]


@pytest.fixture(scope='session')
def truth(drive):
    """Pose of the sensor at each scan, in the frame of the first."""
    start = SE2.from_array(drive.truth[0]).inverse()
    return [start @ SE2.from_array(pose) for pose in drive.truth[:80]]


@pytest.fixture(scope='session')
def scans_and_truth(scans, truth):
    return scans, truth


@pytest.fixture
def steady(scans, truth):
    """``steady(messages)``: no motion between two answers is farther from the true one than their covariance allows."""
    from ros_helpers import squared_distance
    true = {scan.stamp: pose for scan, pose in zip(scans, truth, strict=True)}

    def steady(messages):
        poses = [true[in_nanoseconds(message.header.stamp)] for message in messages]
        for (before, after), (p, q) in zip(itertools.pairwise(messages), itertools.pairwise(poses), strict=True):
            assert squared_distance(before, after, p.inverse() @ q) < LIMIT
        assert len(messages) > 10

    return steady
