# SPDX-License-Identifier: Apache-2.0
"""The pose that is kept over a restart."""
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node import state_file
from dbscan_reg_ros.node.state_file import StateFile
from dbscan_reg_ros.robot.base_state import BaseState
from dbscan_reg_ros.robot.parameters import NodeParameters

COVARIANCE = np.diag((0.04, 0.09, 0.01))


@pytest.fixture
def clock(monkeypatch):
    """Both clocks of the module, in seconds."""
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(state_file, 'time', SimpleNamespace(time=lambda: clock.now, monotonic=lambda: clock.now))
    return clock


@pytest.fixture
def opened(tmp_path):
    """``opened(**parameters) -> StateFile``, which appends warnings to its `said`."""
    def opened(**parameters):
        said = []
        node = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=said.append, info=lambda _: None))
        file = StateFile(node, NodeParameters().replace({'state_file': str(tmp_path / 'pose.json'), **parameters}))
        file.said = said
        return file
    return opened


def state(x, stamp):
    return BaseState(stamp, SE2(x, 2.0, 0.5), COVARIANCE, np.zeros(3), np.eye(3))


def test_the_last_pose_is_read_with_the_covariance_of_the_time_without_the_node(opened, clock):
    opened().write(state(1.0, 1))
    clock.now += 10.0
    found = opened().load()
    assert found.pose == SE2(1.0, 2.0, 0.5)
    # Of a velocity with a standard deviation of 0.5 m/s and a time constant of 5 s, over 10 s.
    lasting = 5.0 * (1.0 - math.exp(-2.0))
    expected = 0.25 * (10.0 * (10.0 - lasting) - lasting ** 2) + NodeParameters().prior.unknown_sigma ** 2
    assert np.diag(found.covariance - COVARIANCE)[:2] == pytest.approx([expected] * 2)
    clock.now += 100.0
    assert opened().load().covariance[0, 0] > found.covariance[0, 0]


def test_it_is_written_every_five_seconds_at_most(opened, clock, tmp_path):
    file = opened()
    for second in range(12):
        clock.now += 1.0
        file.keep(state(float(second), second))
    assert json.loads((tmp_path / 'pose.json').read_text(encoding='utf-8'))['pose'][0] == 10.0


@pytest.mark.parametrize('content', ['', '{"pose": [1, 2]}', '[]', '{"odom_frame": "odom", "base_frame": "base_link", '
                                     '"time": 1000, "pose": [NaN, 0, 0], "covariance": [[1,0,0],[0,1,0],[0,0,1]]}'])
def test_a_damaged_file_is_named_and_not_used(opened, clock, tmp_path, content):
    (tmp_path / 'pose.json').write_text(content, encoding='utf-8')
    file = opened()
    assert file.load() is None
    assert len(file.said) == 1 and 'pose.json' in file.said[0]


def test_a_pose_of_other_frames_or_of_long_ago_is_not_used(opened, clock):
    opened().write(state(1.0, 1))
    assert opened(odom_frame='other').load() is None
    clock.now += 2.0 * state_file.OLDEST
    assert opened().load() is None


def test_what_cannot_be_written_is_said_once(opened, clock, tmp_path):
    (tmp_path / 'file').touch()
    file = opened(state_file=str(tmp_path / 'file' / 'pose.json'))
    for second in range(20):
        clock.now += 1.0
        file.keep(state(0.0, second))
    assert len(file.said) == 1
