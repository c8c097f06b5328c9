# SPDX-License-Identifier: Apache-2.0
"""Records what the package found in one source tree says of drives and pairs of scans: run by ``bench fingerprint``.

    python fingerprint_recorder.py ROOT

``ROOT`` is the source tree whose package is used. Each line of standard input names an input and an output file, both .npz,
with a tab in between; one line of standard output answers each. The script runs with the package of any commit: it imports
nothing but that package's public names, and finds those that were renamed in the tables below.

An input holds the scans as plain arrays: ``stamps`` (N,) [ns], ``beams`` (N,), all ``ranges`` in a row, and ``angles`` (N, 5):
angle_min, angle_increment, range_min, range_max, time_increment. ``kind`` says what is done with them: ``odometry`` (optionally
with ``prior`` (N, 3) and ``prior_covariance`` (N, 3, 3)), ``register`` (with ``pairs`` (M, 2)) or ``node`` (with ``arguments``
and optionally ``places`` (N, 3), the laser on the base at each scan).
"""
import array
import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np

PACKAGE = 'dbscan_reg_ros'
HOMES = {
    'Odometry': ('', 'core.odometry', 'core.odometry.pipeline'),
    'Prior': ('', 'core.records', 'core.odometry.prediction', 'core.registration'),
    'SE2': ('', 'core.se2', 'core.geometry', 'core.geometry.se2'),
    'Scan': ('', 'core.scan'),
    'extract_features': ('', 'core.features', 'core.features.extraction', 'core.features.pipeline'),
    'register': ('', 'core.registration', 'core.registration.pipeline'),
}
"""Where each name has been defined, in the order in which it is looked for; '' is the package itself."""
FIELDS = {
    'pose': ('pose',), 'covariance': ('covariance',), 'twist': ('twist',), 'twist_covariance': ('twist_covariance',),
    'status': ('status',),
}
"""Of the answer of `Odometry.process`: what is recorded, by which name."""
REGISTRATION_FIELDS = {
    'pose': ('transform', 'pose', 'motion'), 'covariance': ('covariance',), 'status': ('status',), 'score': ('score',),
    'overlap': ('overlap',),
}
REFUSED = 'refused'
"""Status of a scan that raises an error of the package."""
PATIENCE = 30.0
"""A node that needs longer [s] to start, or to answer, is taken as failed."""
POLL = 0.02
BASE, LASER = 'base_link', 'laser'


def find(name):
    """The public object called `name` of the package, wherever this commit has it; AttributeError where it has none."""
    for home in HOMES[name]:
        with contextlib.suppress(ImportError, AttributeError):
            found = getattr(import_module(f'{PACKAGE}.{home}' if home else PACKAGE), name)
            if callable(found):
                return found
    raise AttributeError(f'{name}: not found in {PACKAGE} at {[home or PACKAGE for home in HOMES[name]]}; '
                         'add its new place to HOMES in fingerprint_recorder.py')


def read(record, names):
    """The first attribute of `record` among `names`."""
    for name in names:
        if hasattr(record, name):
            return getattr(record, name)
    raise AttributeError(f'{type(record).__name__} has none of {names}; add the new name to the tables of '
                         'fingerprint_recorder.py')


def as_numbers(value):
    """A pose, an array or a number as an array; a status as its text."""
    if hasattr(value, 'theta'):
        return np.array([value.x, value.y, value.theta])
    if hasattr(value, 'value') and isinstance(value.value, str):
        return value.value.lower()
    return np.array(value, dtype=float)


def message(given, k):
    """Scan `k` with the fields of a LaserScan message."""
    begin = int(given['beams'][:k].sum()) if k else 0
    low, step, near, far, increment = given['angles'][k].tolist()
    seconds, nanoseconds = divmod(int(given['stamps'][k]), 10**9)
    ranges = given['ranges'][begin:begin + int(given['beams'][k])]
    header = SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=LASER)
    return SimpleNamespace(header=header, ranges=ranges, angle_min=low, angle_increment=step,
                           angle_max=low + step * (len(ranges) - 1), range_min=near, range_max=far, time_increment=increment)


def messages(given):
    """All scans, each with the fields of a LaserScan message."""
    ends = np.cumsum(given['beams'])
    for k, (end, size) in enumerate(zip(ends.tolist(), given['beams'].tolist(), strict=True)):
        one = {'beams': given['beams'][k:k + 1], 'angles': given['angles'][k:k + 1], 'stamps': given['stamps'][k:k + 1],
               'ranges': given['ranges'][end - size:end]}
        yield message(one, 0)


def record_odometry(given):
    """Rows of what `Odometry.process` says of each scan."""
    odometry, scan_type, pose_type = find('Odometry')(), find('Scan'), find('SE2')
    rows = {name: [] for name in FIELDS}
    for k, each in enumerate(messages(given)):
        prior = None
        if 'prior' in given and np.isfinite(given['prior'][k]).all():
            prior = find('Prior')(pose_type(*given['prior'][k].tolist()), given['prior_covariance'][k])
        row = dict.fromkeys(FIELDS)
        try:
            update = odometry.process(scan_type.from_message(each), prior)
            row = {name: as_numbers(read(update, names)) for name, names in FIELDS.items()}
        except Exception as error:
            if not type(error).__module__.startswith(PACKAGE):
                raise
        append(rows, row)
    return stacked(rows)


def record_registrations(given):
    """Rows of what `register` says of each pair, without a guess."""
    extract, register, scan_type = find('extract_features'), find('register'), find('Scan')
    features = [extract(scan_type.from_message(each)) for each in messages(given)]
    rows = {name: [] for name in REGISTRATION_FIELDS}
    for i, j in given['pairs'].tolist():
        result = register(features[i], features[j])
        append(rows, {name: as_numbers(read(result, names)) for name, names in REGISTRATION_FIELDS.items()})
    return stacked(rows)


SHAPES = {'pose': (3,), 'twist': (3,), 'covariance': (3, 3), 'twist_covariance': (3, 3), 'score': (), 'overlap': ()}


def append(rows, row):
    """Add a `row`, in which what is None was refused."""
    for name, values in rows.items():
        missing = REFUSED if name == 'status' else np.full(SHAPES.get(name, ()), math.nan)
        values.append(missing if row[name] is None else row[name])


def stacked(rows):
    return {name: np.array(values) for name, values in rows.items()}


def record_node(given, root):
    """Rows of what the node, in a process of its own, publishes on ``odom`` for each scan."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, '-m', PACKAGE, 'scan_matcher', '--ros-args', '-p', 'publish_tf:=false', '-p',
                   'input.max_wait:=10.0', *given['arguments'].tolist()]
        log = Path(folder, 'node.log')
        with open(log, 'wb') as output:
            node = subprocess.Popen(command, cwd=root, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                                    env=os.environ | {'ROS_LOG_DIR': folder}, start_new_session=True)
        try:
            with Listener(given) as listener:
                return stacked(listener.play(given, node))
        except TimeoutError as error:
            raise TimeoutError(f'{error}: {log.read_text(errors="replace")[-500:]}') from error
        finally:
            end(node)


def end(process):
    """End a process that was started here, by force where it does not end by itself."""
    for number, patience in ((signal.SIGINT, 10.0), (signal.SIGKILL, None)):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience)
            return


class Listener:
    """A ROS node that publishes scans one by one, and takes the odometry of each."""

    def __init__(self, given):
        import rclpy
        from nav_msgs.msg import Odometry
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from sensor_msgs.msg import LaserScan
        self._context, self._heard = Context(), {}
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('fingerprint', context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._scans = self._node.create_publisher(LaserScan, 'scan', 10)
        self._node.create_subscription(Odometry, 'odom', self._hear, 10)
        self._transforms = None
        if 'places' in given:
            from tf2_msgs.msg import TFMessage
            self._transforms = self._node.create_publisher(TFMessage, '/tf', 100)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _hear(self, odometry):
        stamp = odometry.header.stamp
        self._heard[stamp.sec * 10**9 + stamp.nanosec] = odometry

    def play(self, given, process):
        """Rows of what the node in `process` answers to the scans."""
        self._meet(process)
        rows = {name: [] for name in ('pose', 'covariance', 'twist', 'twist_covariance')}
        for k, each in enumerate(messages(given)):
            stamp = int(given['stamps'][k])
            if self._transforms:
                later = min(k + 1, len(given['stamps']) - 1)
                self._transforms.publish(transforms(given['stamps'][[k, later]], given['places'][[k, later]]))
            # A scan whose mounting is not known yet is skipped, and may be sent again.
            deadline, asked = time.monotonic() + PATIENCE, 0.0
            while stamp not in self._heard:
                if time.monotonic() > deadline or process.poll() is not None:
                    raise TimeoutError(f'scan {k}: the node gave no odometry')
                if k == 0 and time.monotonic() > asked + 2.0 or not asked:
                    asked = time.monotonic()
                    self._scans.publish(laser_scan(each))
                self._executor.spin_once(POLL)
            append(rows, numbers(self._heard.pop(stamp)))
        return rows

    def _meet(self, process):
        """Wait until the node hears and is heard: it does when it has answered a call to a service of its own."""
        from rcl_interfaces.srv import GetParameters
        client = self._node.create_client(GetParameters, '/scan_matcher/get_parameters')
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline and process.poll() is None:
            known = self._scans.get_subscription_count() and self._node.count_publishers('odom')
            if known and (not self._transforms or self._transforms.get_subscription_count()) and client.service_is_ready():
                future = client.call_async(GetParameters.Request())
                self._executor.spin_until_future_complete(future, 1.0)
                if future.done():
                    self._node.destroy_client(client)
                    return
            else:
                self._executor.spin_once(POLL)
        raise TimeoutError('the node is not ready')


def laser_scan(fields):
    """The LaserScan message with the `fields`."""
    from sensor_msgs.msg import LaserScan
    made = LaserScan()
    made.header.stamp.sec, made.header.stamp.nanosec = fields.header.stamp.sec, fields.header.stamp.nanosec
    made.header.frame_id = fields.header.frame_id
    for name in ('angle_min', 'angle_max', 'angle_increment', 'range_min', 'range_max', 'time_increment'):
        setattr(made, name, getattr(fields, name))
    made.ranges = array.array('f', fields.ranges.tobytes())
    return made


def transforms(stamps, places):
    """The TFMessage with the laser's `places` on the base (K, 3) at `stamps` [ns]."""
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage
    made = []
    for stamp, (x, y, yaw) in zip(stamps.tolist(), places.tolist(), strict=True):
        each = TransformStamped()
        each.header.stamp.sec, each.header.stamp.nanosec = divmod(stamp, 10**9)
        each.header.frame_id, each.child_frame_id = BASE, LASER
        each.transform.translation.x, each.transform.translation.y = x, y
        each.transform.rotation.z, each.transform.rotation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        made.append(each)
    return TFMessage(transforms=made)


def numbers(odometry):
    """What an Odometry message says, as numbers."""
    plane = np.ix_([0, 1, 5], [0, 1, 5])
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
    return {'pose': np.array([position.x, position.y, 2.0 * math.atan2(turn.z, turn.w)]),
            'covariance': odometry.pose.covariance.reshape(6, 6)[plane], 'twist': np.array([linear.x, linear.y, angular.z]),
            'twist_covariance': odometry.twist.covariance.reshape(6, 6)[plane]}


def record(source, target, root):
    """Read an input, write what the package says of it."""
    with np.load(source, allow_pickle=False) as file:
        given = {name: file[name] for name in file.files}
    kind = str(given['kind'])
    rows = record_node(given, root) if kind == 'node' else {
        'odometry': record_odometry, 'register': record_registrations}[kind](given)
    part = Path(f'{target}.part.npz')
    np.savez(part, **rows)
    part.replace(target)


def main():
    """Answer each line of standard input with ``done``, or with what went wrong."""
    root = os.path.realpath(sys.argv[1])
    sys.path[0] = root
    found = os.path.realpath(import_module(PACKAGE).__file__)
    if not found.startswith(root + os.sep):
        sys.exit(f'{PACKAGE} was imported from {found}, expected it in {root}')
    for line in sys.stdin:
        source, target = line.rstrip('\n').split('\t')
        try:
            record(source, target, root)
            print('done', flush=True)
        except Exception as error:  # noqa: BLE001 another commit may fail in any way, and the next drive is still recorded
            traceback.print_exc()
            print(f'{type(error).__name__}: {error}'.replace('\n', ' '), flush=True)


if __name__ == '__main__':
    main()
