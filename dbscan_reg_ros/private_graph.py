# SPDX-License-Identifier: Apache-2.0
"""Private ROS graph for one process and its children, separated by a ROS domain that no other caller uses."""
import fcntl
import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

from .core.errors import DbscanRegError

DOMAINS = range(1, 102)
"""ROS domains to choose from: 0 is the default of all nodes, and Linux assigns the ports of ids above 101 to others."""


class NoFreeDomain(DbscanRegError):
    """Every ROS domain is in use."""


class ForeignFolder(DbscanRegError):
    """The folder with the domain locks belongs to another user."""


@contextmanager
def private_graph():
    """Use a ROS domain that no other caller uses, restricted to this machine, for this process and its children.

    A child process that inherits the file descriptors from `domain_locks` keeps the domain locked until the child has
    ended, even if this process is killed before.

    Yields
    ------
    int
        Number of the ROS domain; the environment variables are restored at the end of the ``with`` block.

    Raises
    ------
    NoFreeDomain, ForeignFolder
    """
    with _free_domain() as domain:
        variables = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        before = {name: os.environ.get(name) for name in variables}
        os.environ.update(variables)
        try:
            yield domain
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def domain_locks() -> tuple[int, ...]:
    """File descriptors of the domain locks that this process has open, to be passed on to child processes."""
    folder, descriptors = str(_lock_folder()), []
    for name in os.listdir('/proc/self/fd'):
        with suppress(OSError):
            if os.path.dirname(os.readlink(f'/proc/self/fd/{name}')) == folder:
                descriptors.append(int(name))
    return tuple(descriptors)


def _lock_folder() -> Path:
    return Path(tempfile.gettempdir()).resolve() / f'dbscan_reg_ros-domains-{os.getuid()}'


@contextmanager
def _free_domain():
    """Lock a ROS domain that no process has locked; begin with the one after the domain that was locked last."""
    folder = _lock_folder()
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise ForeignFolder(f'{folder}: belongs to another user; remove it, or set TMPDIR to a folder of your own')
    last = folder / 'last'
    start = int(last.read_text() or 0) if last.exists() else os.getpid()
    for offset in DOMAINS:
        domain = DOMAINS[(start + offset) % len(DOMAINS)]
        with open(folder / str(domain), 'a') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            last.write_text(str(DOMAINS.index(domain)))
            yield domain
            return
    raise NoFreeDomain(f'all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use; end some of the processes '
                       'that use them')
