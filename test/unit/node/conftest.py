# SPDX-License-Identifier: Apache-2.0
"""The core of the node without DDS."""
import time

import pytest


@pytest.fixture
def start_core(monkeypatch):
    """``start_core(**parameters) -> Robot``: a core with a clock of its own."""
    pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
    from core_stand_in import Robot, StandIn

    def start_core(**parameters):
        node = StandIn()
        monkeypatch.setattr(time, 'monotonic', lambda: node.steady)
        return Robot(node, **parameters)
    return start_core
