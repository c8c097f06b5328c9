# SPDX-License-Identifier: Apache-2.0
"""When our transform is sent, and when it gives way to that of another node."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.serialization import deserialize_message
from ros_helpers import needs_tf2_msgs, transform

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.frames import transform_sender
from dbscan_reg_ros.node.frames.transform_sender import WAIT, TransformSender
from dbscan_reg_ros.node.interfaces.topics import TF
from dbscan_reg_ros.robot.parameters import NodeParameters

pytestmark = needs_tf2_msgs
SECOND = 1_000_000_000


class Graph:
    """The nodes that publish on /tf, without ROS: time, and what each node has sent."""

    def __init__(self, monkeypatch):
        self.now, self.endpoints, self.senders = 100.0, {}, []
        monkeypatch.setattr(transform_sender.time, 'monotonic', lambda: self.now)
        monkeypatch.setattr(transform_sender, 'publishers', lambda node, topic: dict(self.endpoints))
        monkeypatch.setattr(transform_sender, 'is_scan_matcher', lambda node, each: each.node_name.startswith('scan'))
        monkeypatch.setattr(transform_sender, 'publisher', self._publisher)

    def _publisher(self, node, topic):
        self.endpoints[node.gid] = SimpleNamespace(node_name=node.name, node_namespace='/')
        return node

    def start(self, name='scan_matcher', gid=b'b', **parameters):
        """A sender on a node with this name, whose publisher has this gid."""
        node = SimpleNamespace(name=name, gid=gid, sent=[], logged=[], get_fully_qualified_name=lambda: f'/{name}',
                               destroy_publisher=lambda publisher: self.endpoints.pop(publisher.gid))
        node.publish = node.sent.append
        node.get_logger = lambda: SimpleNamespace(error=lambda text: node.logged.append((LoggingSeverity.ERROR, text)),
                                                  info=lambda text: node.logged.append((LoggingSeverity.INFO, text)))
        self.senders.append(TransformSender(node, NodeParameters(**parameters)))
        return self.senders[-1], node

    def other(self, name='wheels', gid=b'z'):
        """A node that publishes on /tf, too."""
        self.endpoints[gid] = SimpleNamespace(node_name=name, node_namespace='/')

    def wait(self, seconds):
        """Let time pass; every sender has its timer once a second."""
        for _ in range(round(seconds)):
            self.now += 1.0
            for sender in self.senders:
                sender.on_timer()


@pytest.fixture
def graph(monkeypatch):
    return Graph(monkeypatch)


def sends(sender, node, stamp=None):
    """Whether the transform of a scan is sent."""
    count = len(node.sent)
    sender.send(SimpleNamespace(stamp=stamp or SECOND * (1 + count), pose=SE2(1.0, 2.0, 0.3)))
    return len(node.sent) > count


def test_stamps_that_are_not_newer_are_not_sent_and_one_of_the_far_future_ends_nothing(graph):
    sender, node = graph.start()
    assert [sends(sender, node, stamp * SECOND // 10) for stamp in (10, 12, 11, 12, 13, 9000, 14, 15)] == [
        True, True, False, False, True, True, True, True]


def test_the_inverse_is_sent_where_asked_for(graph):
    sender, node = graph.start(invert_tf=True, odom_frame='laser_odom')
    assert sends(sender, node)
    [sent] = deserialize_message(node.sent[0], TF.kind).transforms
    assert (sent.header.frame_id, sent.child_frame_id) == ('base_link', 'laser_odom')
    t, q = sent.transform.translation, sent.transform.rotation
    off = SE2(t.x, t.y, 2.0 * math.atan2(q.z, q.w)) @ SE2(1.0, 2.0, 0.3)
    assert off.as_array() == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def foreign(parent='wheel_odom'):
    return transform(parent, 'base_link', SE2(5.0))


def test_one_that_is_alone_or_beside_other_kinds_of_nodes_sends_at_once(graph):
    graph.other(gid=b'a')
    assert sends(*graph.start())


def test_it_is_silent_while_another_node_sends_and_five_seconds_longer(graph):
    graph.other()
    sender, node = graph.start()
    assert sends(sender, node)
    for _ in range(100):
        sender.on_transform(foreign(), '/tf')
        assert not sends(sender, node)
        graph.wait(1.0)
    assert "too, from 'wheel_odom'; publishers on /tf: /wheels" in sender.conflict
    graph.wait(WAIT - 2.0)
    assert not sends(sender, node)
    graph.wait(1.0)
    assert sends(sender, node) and not sender.conflict
    assert [severity for severity, _ in node.logged] == [LoggingSeverity.ERROR, LoggingSeverity.INFO]


def test_transforms_to_other_frames_and_our_own_do_not_matter(graph):
    sender, node = graph.start()
    assert sends(sender, node, SECOND)
    sender.on_transform(transform('base_link', 'laser'), '/tf')
    own = transform('odom', 'base_link', SE2(1.0, 2.0, 0.3), stamp=SECOND)
    sender.on_transform(own, '/tf')
    assert sends(sender, node)
    sender.on_transform(own, '/tf')
    assert not sends(sender, node)


def test_names_of_nodes_that_are_discovered_late_are_added(graph):
    sender, node = graph.start()
    sender.on_transform(foreign(), '/tf')
    assert 'an unnamed node' in sender.conflict
    graph.other()
    graph.wait(1.0)
    [(severity, text)] = node.logged
    assert severity is LoggingSeverity.ERROR and '/wheels' in text and '/wheels' in sender.conflict


def test_a_static_transform_counts_until_its_publisher_has_gone(graph):
    graph.other()
    sender, node = graph.start()
    sender.on_transform(foreign('map'), '/tf_static')
    graph.wait(60.0)
    assert not sends(sender, node)
    del graph.endpoints[b'z']
    graph.wait(WAIT)
    assert not sends(sender, node)
    graph.wait(1.0)
    assert sends(sender, node)


def test_publish_tf_sends_at_once_and_withdraws(graph):
    graph.other('scan_matcher_2', b'a')
    sender, node = graph.start()
    heard = []
    sender.subscribe_static = lambda: heard.append(True)
    assert not sends(sender, node)
    sender.reconfigure(NodeParameters(), insist=True)
    assert sends(sender, node) and heard
    sender.on_transform(foreign(), '/tf')
    assert not sends(sender, node)
    sender.reconfigure(NodeParameters(publish_tf=False), insist=True)
    assert not sends(sender, node) and not sender.active and sender.publisher is None and not sender.conflict


@pytest.mark.parametrize('seed', range(3))
def test_of_several_nodes_of_this_package_one_sends_and_when_it_ends_the_next_one_with_the_lowest_gid(graph, seed):
    """All receive the same scans, at 10 Hz; each has its timer at its own phase."""
    rng = np.random.default_rng(seed)
    names = {b'a': 'scan_1', b'b': 'scan_2', b'c': 'scan_3'}
    order = map(bytes, rng.permutation(list(names)))
    running = {gid: graph.start(names[gid], gid, odom_frame=names[gid]) for gid in order}
    phases = {gid: rng.integers(10) for gid in names}
    for lowest in sorted(names):
        who = []
        for k in range(200):
            graph.now += 0.1
            senders = [gid for gid, each in running.items() if sends(*each, SECOND + round(graph.now * 1e9))]
            for gid in senders:
                for other, (sender, _) in running.items():
                    if other != gid:
                        sender.on_transform(foreign(names[gid]), '/tf')
            for gid, (sender, _) in running.items():
                if k % 10 == phases[gid]:
                    sender.on_timer()
            assert len(senders) <= 1
            who += senders
        assert set(who) == {lowest} and len(who) > 120
        del running[lowest], graph.endpoints[lowest]
