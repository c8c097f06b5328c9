# SPDX-License-Identifier: Apache-2.0
"""Private ROS domains: none is given out while a process that got it still runs."""
import os
import signal
import subprocess
import sys
import tempfile
import time

import pytest

from dbscan_reg_ros.commands.processes import Process
from dbscan_reg_ros.private_graph import DOMAINS, private_graph

SLEEPER = [sys.executable, '-c', 'import time; time.sleep(60)']
KILLED = """
import os, signal, sys
from dbscan_reg_ros.private_graph import private_graph
from dbscan_reg_ros.commands.processes import Process
with private_graph() as domain:
    child = Process([sys.executable, '-c', 'import time; time.sleep(60)'], sys.argv[1])
    print(domain, child.pid, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def next_domain(tmp_path, monkeypatch):
    """``next_domain(first)``: the domain that is given out when `first` has its turn."""
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    monkeypatch.setenv('TMPDIR', str(tmp_path))

    def next_domain(first):
        [folder] = tmp_path.glob('dbscan_reg_ros-domains-*')
        (folder / 'last').write_text(str(DOMAINS.index(first) - 1))
        with private_graph() as domain:
            return domain
    return next_domain


def test_a_domain_stays_taken_while_a_child_process_runs(next_domain, tmp_path):
    with private_graph() as domain:
        child = Process(SLEEPER, tmp_path / 'child.log')
    assert next_domain(domain) == domain % len(DOMAINS) + 1
    child.stop(patience=1.0)
    assert next_domain(domain) == domain


def test_a_domain_stays_taken_when_its_owner_is_killed_and_a_child_goes_on(next_domain, tmp_path):
    owner = subprocess.run([sys.executable, '-c', KILLED, tmp_path / 'child.log'], stdout=subprocess.PIPE, text=True,
                           check=False)
    domain, child = map(int, owner.stdout.split())
    assert owner.returncode == -signal.SIGKILL
    try:
        assert next_domain(domain) == domain % len(DOMAINS) + 1
    finally:
        os.kill(child, signal.SIGKILL)
    deadline = time.monotonic() + 10.0
    while next_domain(domain) != domain:
        assert time.monotonic() < deadline
