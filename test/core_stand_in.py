# SPDX-License-Identifier: Apache-2.0
"""The core of the node on a stand-in for rclpy's Node: no DDS, no other process, and time that passes when a test says.

Topics, services, timers and callback groups behave as those of rclpy, as far as the core uses them.
"""
import inspect
import itertools
import math
from types import SimpleNamespace

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time

from dbscan_reg_ros import Scan
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.node.node_core import NodeCore
from dbscan_reg_ros.robot.parameters import NodeParameters

STEP = 0.1
"""In which time passes, at most [s]."""


class Timer:
    def __init__(self, node, period, callback, group):
        self.timer_period_ns, self.callback, self._node, self._group = int(1e9 * period), callback, node, group
        group.add_entity(self)
        self.reset()

    def cancel(self):
        self.due = math.inf

    def reset(self):
        self.due = self._node.steady + 1e-9 * self.timer_period_ns

    def is_ready(self):
        return self.due <= self._node.steady and self._group.can_execute(self)

    def execute(self):
        self.reset()
        self.callback()


class Subscription:
    """Its own `handle`, from which messages are taken, too."""

    def __init__(self, node, kind, name, callback, quality, group):
        self.msg_type, self.topic_name, self.qos_profile = kind, node.resolve_topic_name(name), quality
        self.handle, self._callback, self._group, self.queue = self, callback, group, []
        group.add_entity(self)
        self._with_info = len(inspect.signature(callback).parameters) == 2

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def take_message(self, *_):
        return self.queue.pop(0) if self.queue else None

    def is_ready(self):
        return self.queue and self._group.can_execute(self)

    def execute(self):
        message, info = self.take_message()
        self._callback(*(message, info)[:1 + self._with_info])


class Publisher:
    def __init__(self, node, kind, name, quality):
        self.msg_type, self.topic_name, self.qos_profile = kind, node.resolve_topic_name(name), quality
        self._node, self.sent = node, []

    def publish(self, message):
        message = deserialize_message(message if isinstance(message, bytes) else serialize_message(message),
                                      self.msg_type)
        self.sent.append(message)
        self._node.deliver(self.topic_name, message)

    def get_subscription_count(self):
        return self.topic_name not in self._node.unwatched


def endpoint(node, kind, quality=10):
    """What rmw tells of a publisher of another node, given by its full name, with messages of a type."""
    namespace, _, name = node.rpartition('/')
    quality = QoSProfile(depth=quality) if isinstance(quality, int) else quality
    return SimpleNamespace(node_name=name, node_namespace=namespace or '/', qos_profile=quality,
                           topic_type=f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}',
                           endpoint_gid=node.encode())


class StandIn:
    """A node that is alone but for the `others`: topic -> endpoints of publishers.

    `said` are the lines of its log, `steady` and `now` its clocks [s], [ns]; nobody subscribes to `unwatched` topics.
    """

    name, namespace = 'scan_matcher', '/'

    def __init__(self):
        self.publishers, self.subscriptions, self.services, self.timers, self.guards = [], [], [], [], []
        self.others, self.unwatched, self.said = {}, set(), []
        self.steady, self.now, self._jumped, self._numbers = 100.0, 0, [], itertools.count(1)
        self.context = SimpleNamespace(on_shutdown=lambda _: None)
        self.executor, self._group = None, MutuallyExclusiveCallbackGroup()

    # Names and parameters

    def get_name(self):
        return self.name

    def get_fully_qualified_name(self):
        return f'/{self.name}'

    def resolve_topic_name(self, name):
        return name if name.startswith('/') else f'/{name}'

    def get_parameters_by_prefix(self, _):
        return {}

    def has_parameter(self, name):
        return name.startswith('qos_overrides.')

    def get_logger(self):
        return SimpleNamespace(**dict.fromkeys(('info', 'warning', 'error'), self.said.append))

    # Time

    def get_clock(self):
        return SimpleNamespace(now=lambda: Time(nanoseconds=self.now), create_jump_callback=self._on_jump)

    def _on_jump(self, _, post_callback):
        self._jumped.append(post_callback)
        return SimpleNamespace(unregister=lambda: self._jumped.remove(post_callback))

    def jump(self, seconds):
        """Let the clock of the node jump."""
        self.now += round(1e9 * seconds)
        for callback in self._jumped:
            callback(SimpleNamespace(delta=SimpleNamespace(nanoseconds=round(1e9 * seconds))))

    def wait(self, seconds):
        """Let time pass, in steps."""
        steps = math.ceil(seconds / STEP)
        for _ in range(steps):
            self.steady += seconds / steps
            self.spin()

    def step(self):
        """Execute what is ready first, which takes a microsecond; return whether anything was."""
        self.steady += 1e-6
        ready = next((each for each in (*self.subscriptions, *self.timers) if each.is_ready()), None)
        if ready:
            ready.execute()
        return bool(ready)

    def spin(self):
        """Execute what is ready, until nothing is."""
        while self.step():
            pass

    # Entities

    def _created(self, kind, entity):
        getattr(self, kind).append(entity)
        return entity

    def create_publisher(self, kind, name, quality, **_):
        return self._created('publishers', Publisher(self, kind, name, quality))

    def create_subscription(self, kind, name, callback, quality, callback_group=None, **_):
        return self._created('subscriptions', Subscription(self, kind, name, callback, quality,
                                                          callback_group or self._group))

    def create_service(self, kind, name, callback):
        name = name.replace('~', f'/{self.name}')
        return self._created('services', SimpleEntity(srv_type=kind, srv_name=name, callback=callback))

    def create_timer(self, period, callback, callback_group=None, autostart=True, **_):
        timer = self._created('timers', Timer(self, period, callback, callback_group or self._group))
        if not autostart:
            timer.cancel()
        return timer

    def destroy_publisher(self, publisher):
        self.publishers.remove(publisher)

    def destroy_subscription(self, subscription):
        self.subscriptions.remove(subscription)

    def destroy_service(self, service):
        self.services.remove(service)

    def destroy_timer(self, timer):
        self.timers.remove(timer)

    # The graph

    def get_publishers_info_by_topic(self, topic):
        own = [endpoint(f'/{self.name}', each.msg_type) for each in self.publishers if each.topic_name == topic]
        return own + self.others.get(topic, [])

    def count_publishers(self, topic):
        return len(self.get_publishers_info_by_topic(topic))

    def get_topic_names_and_types(self):
        return [(topic, [each.topic_type for each in endpoints]) for topic, endpoints in self.others.items()]

    def get_service_names_and_types_by_node(self, *_):
        return []

    def deliver(self, topic, message):
        """Put a message into the queues of the subscriptions to a topic."""
        received = [each for each in self.subscriptions if each.topic_name == topic]
        for subscription in received:
            subscription.queue.append((message, {'publication_sequence_number': next(self._numbers)}))
        return bool(received)


class SimpleEntity(SimpleNamespace):
    __hash__ = object.__hash__


class Robot:
    """A core on a `node`, subscribed to its scans; the mounting is none unless the parameters say otherwise."""

    def __init__(self, node, **parameters):
        self.node = node
        values = NodeParameters().replace({'mounting': 'none', **named(parameters)})
        self._live = SimpleNamespace(value=values, changed=None)
        self.core = NodeCore(self.node, self._live)
        self.core.activate()

    @property
    def log(self):
        return '\n'.join(self.node.said)

    def set(self, **parameters):
        """Change parameters."""
        self._live.value = self._live.value.replace(named(parameters))
        self._live.changed(self._live.value, set(named(parameters)))

    def receive(self, topic, *messages):
        """Let messages arrive one after the other, scans as such or as messages; each is handled before the next."""
        for message in messages:
            assert self.node.deliver(topic, scan_to_message(message) if isinstance(message, Scan) else message)
            self.node.spin()

    def burst(self, topic, scans):
        """Let scans arrive at once."""
        for scan in scans:
            assert self.node.deliver(topic, scan_to_message(scan))
        self.node.spin()

    def sent(self, topic):
        """The messages published on a topic."""
        return [message for each in self.node.publishers if each.topic_name == topic for message in each.sent]

    def play(self, scans, topic='/scan'):
        """Let scans arrive; the odometry of each, None without."""
        answers = []
        for scan in scans:
            count = len(self.sent('/odom'))
            self.receive(topic, scan)
            answers += self.sent('/odom')[count:] or [None]
        return answers

    def call(self, service, **request):
        """The response of a service."""
        [found] = [each for each in self.node.services if each.srv_name == service]
        return found.callback(found.srv_type.Request(**request), found.srv_type.Response())

    def diagnosis(self):
        """The status of the next report."""
        self.node.wait(1.0)
        return self.sent('/diagnostics')[-1].status[0]


def named(parameters):
    """Two underlines in a name stand for the dot."""
    return {name.replace('__', '.'): value for name, value in parameters.items()}


def stamps(messages):
    return [in_nanoseconds(message.header.stamp) for message in messages]


def values(status):
    """Key -> value of a DiagnosticStatus."""
    return {pair.key: pair.value for pair in status.values}
