# SPDX-License-Identifier: Apache-2.0
"""A ROS graph of its own for one process and its children."""
import fcntl
import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

from ..core.errors import DbscanRegError

DOMAINS = range(1, 102)
"""Domain 0 is the default of all nodes; ids above 101 lead to ports that Linux assigns to other programs."""


class NoFreeDomain(DbscanRegError):
    """Every ROS domain is in use."""


class ForeignFolder(DbscanRegError):
    """The folder belongs to another user."""


@contextmanager
def private_graph():
    """Use a ROS domain on this machine alone that no other caller has, for this process and its children.

    A child process that gets the descriptors of `domain_locks` keeps the domain taken until it has ended, even if this
    process is killed before.

    Yields
    ------
    int
        The domain's number; the environment is as before when the block ends.

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
    """Lock the first domain after the last one taken that no process has locked."""
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
    raise NoFreeDomain(f'all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use; end some of their users')
