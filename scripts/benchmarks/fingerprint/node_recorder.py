# SPDX-License-Identifier: Apache-2.0
"""Odometry that the node of a source tree publishes, for `recorder`, which lies beside it when it runs."""
import array
import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scan_messages import LASER, append, messages, stacked

PACKAGE = 'dbscan_reg_ros'
PATIENCE = 30.0
"""A node that needs longer [s] to start, or to answer, is taken as failed."""
POLL = 0.02
BASE = 'base_link'


def record_node(given, root):
    """Rows of what the node, in a process of its own, publishes on ``odom`` for each scan."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, '-m', PACKAGE, 'scan_matcher', '--ros-args', '-p', 'publish_tf:=false', '-p',
                   'advanced.input.max_wait:=10.0', *given['arguments'].tolist()]
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
                if (k == 0 and time.monotonic() > asked + 2.0) or not asked:
                    asked = time.monotonic()
                    self._scans.publish(laser_scan(each))
                self._executor.spin_once(POLL)
            append(rows, numbers(self._heard.pop(stamp)))
        return rows

    def _meet(self, process):
        """Wait until both sides have discovered each other: when the node has answered a call to a service."""
        from rcl_interfaces.srv import GetParameters
        client = self._node.create_client(GetParameters, '/scan_matcher/get_parameters')
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline and process.poll() is None:
            known = self._scans.get_subscription_count() and self._node.count_publishers('odom')
            if known and (not self._transforms
                          or self._transforms.get_subscription_count()) and client.service_is_ready():
                future = client.call_async(GetParameters.Request())
                self._executor.spin_until_future_complete(future, 1.0)
                if future.done():
                    self._node.destroy_client(client)
                    return
            else:
                self._executor.spin_once(POLL)
        raise TimeoutError('the node is not ready')


def laser_scan(fields):
    """Return the LaserScan message with the `fields`."""
    from sensor_msgs.msg import LaserScan
    made = LaserScan()
    made.header.stamp.sec, made.header.stamp.nanosec = fields.header.stamp.sec, fields.header.stamp.nanosec
    made.header.frame_id = fields.header.frame_id
    for name in ('angle_min', 'angle_max', 'angle_increment', 'range_min', 'range_max', 'time_increment'):
        setattr(made, name, getattr(fields, name))
    made.ranges = array.array('f', fields.ranges.tobytes())
    return made


def transforms(stamps, places):
    """Return the TFMessage with the laser's `places` on the base (K, 3) at `stamps` [ns]."""
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
    """Return the numbers of an Odometry message."""
    plane = np.ix_([0, 1, 5], [0, 1, 5])
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
    return {'pose': np.array([position.x, position.y, 2.0 * math.atan2(turn.z, turn.w)]),
            'covariance': odometry.pose.covariance.reshape(6, 6)[plane],
            'twist': np.array([linear.x, linear.y, angular.z]),
            'twist_covariance': odometry.twist.covariance.reshape(6, 6)[plane]}
