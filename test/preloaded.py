# SPDX-License-Identifier: Apache-2.0
"""Processes of commands, forked from one process that has imported most of what a node imports.

The imports take more than half the processor time of a start. Nothing else is shared: the forked process has its own
session, environment and output, begins where ``python -m dbscan_reg_ros`` begins, and ends as that does.
"""
import contextlib
import ctypes
import importlib
import inspect
import os
import runpy
import signal
import subprocess
import sys
import time
from multiprocessing.connection import Connection, Pipe

from dbscan_reg_ros.commands.processes import Process

OWN = 'ROS_', 'PYTEST_'
"""How the names of environment variables begin that differ between tests and that no import reads."""
IMPORTED = ('dbscan_reg_ros.core.odometry.pipeline', 'dbscan_reg_ros.node.scan_matcher',
            'dbscan_reg_ros.recordings.checks.scan_checks', 'dbscan_reg_ros.recordings.snapshots',
            'dbscan_reg_ros.robot.parameters', 'dbscan_reg_ros.robot.point_cloud', 'diagnostic_msgs.msg',
            'geometry_msgs.msg', 'nav_msgs.msg', 'rcl_interfaces.msg', 'rcl_interfaces.srv', 'rosidl_generator_py',
            'sensor_msgs.msg', 'std_msgs.msg', 'std_srvs.srv', 'type_description_interfaces.msg',
            'visualization_msgs.msg', 'yaml')
"""What a node imports, but for rclpy, whose libraries start threads."""
ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
"""As a node sets them itself before it imports numpy."""
POLL = 0.005
PR_SET_PDEATHSIG = 1
"""A node that outlived its test would go on in a ROS domain that is given to another test."""


class Preloaded:
    """The process that the others are forked from; it ends when it is closed."""

    def __init__(self):
        self._connection, theirs = Pipe()
        self._environment = of_imports(os.environ)
        with theirs:
            self._process = subprocess.Popen([sys.executable, __file__, str(theirs.fileno())], stdin=subprocess.DEVNULL,
                                             stdout=subprocess.DEVNULL, pass_fds=[theirs.fileno()],
                                             env=self._environment | ONE_THREAD)

    def serves(self, environment):
        """Whether a process with this environment would import the same, and its branches are not counted."""
        environment = of_imports(os.environ | environment)
        return environment == self._environment and not any(name.startswith('COVERAGE_') for name in environment)

    def ask(self, *request):
        """The answer to ``'forked'`` with the arguments of `run`: its number; or to ``'status'`` with that number."""
        self._connection.send(request)
        return self._connection.recv()

    def close(self):
        self._connection.close()
        self._process.wait()


def of_imports(environment):
    return {name: value for name, value in environment.items() if not name.startswith(OWN)}


class ForkedProcess(Process):
    """A command of the package with the `words`, forked from `preloaded`."""

    def __init__(self, preloaded, words, log, environment):
        self._preloaded = preloaded
        super().__init__(words, log, environment)

    def _started(self, _output, environment):
        return Child(self._preloaded, self.command, os.path.abspath(self.log), environment)


class Child:
    """What `subprocess.Popen` offers, of a child of another process."""

    def __init__(self, preloaded, *arguments):
        self._preloaded, self._status = preloaded, None
        self.pid = preloaded.ask('forked', os.getcwd(), *arguments)

    def poll(self):
        if self._status is None:
            self._status = self._preloaded.ask('status', self.pid)
        return self._status

    def wait(self, timeout=float('inf')):
        deadline = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(POLL)
        return self._status

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)


def serve(connection):
    """Answer requests until the other end is closed, then kill what still runs; in a forked process, its arguments."""
    running = set()
    while True:
        try:
            name, *arguments = connection.recv()
        except EOFError:
            for pid in running:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(pid, signal.SIGKILL)
            return None
        if name == 'forked':
            if not (pid := os.fork()):
                connection.close()
                return arguments
            running.add(pid)
            connection.send(pid)
        else:
            pid, = arguments
            ended, code = os.waitpid(pid, os.WNOHANG)
            running.discard(ended)
            connection.send(os.waitstatus_to_exitcode(code) if ended else None)


def run(folder, words, log, environment):
    """Run the command in this process, as if it had been started with `words` in `folder`."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.setsid()
    output = os.open(log, os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(output, stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv[1:], sys.path[0] = words, folder
    runpy.run_module('dbscan_reg_ros', run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    for module in IMPORTED:
        importlib.import_module(module)
    # rclpy looks for the module of each caller of its loggers: those imported until now are found once.
    inspect.getmodule(inspect.currentframe())
    assert len(os.listdir('/proc/self/task')) == 1, 'a process with threads cannot be forked'
    request = serve(Connection(int(sys.argv[1])))
    if request:
        run(*request)
