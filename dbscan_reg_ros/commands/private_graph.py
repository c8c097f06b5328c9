# SPDX-License-Identifier: Apache-2.0
"""A ROS graph that nobody else takes part in."""
import fcntl
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import DbscanRegError

DOMAINS = range(1, 102)
"""Domain 0 is everybody's; ids above 101 lead to ports that Linux gives away to anyone."""


class NoFreeDomain(DbscanRegError):
    """Every ROS domain is in use."""


class ForeignFolder(DbscanRegError):
    """Somebody else would decide what is written where."""


@contextmanager
def private_graph():
    """A ROS domain on this machine alone that no other caller has, for this process and its children.

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


@contextmanager
def _free_domain():
    """The first domain after the last one taken here that nobody holds the lock of."""
    folder = Path(tempfile.gettempdir(), f'dbscan_reg_ros-domains-{os.getuid()}')
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise ForeignFolder(f'{folder}: belongs to somebody else; remove it, or set TMPDIR to a folder of your own')
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
