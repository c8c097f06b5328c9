# SPDX-License-Identifier: Apache-2.0
"""Listener to /tf and /tf_static, and what is there in place of a missing transform."""
import difflib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.subscription import Subscription

from ...core.geometry.mounting import Mounting, MountingError
from ...core.geometry.se2 import SE2
from ..interfaces.graph_checks import named, other_publishers, publishers
from ..interfaces.topics import TF_IN, TF_STATIC
from ..rclpy_internals import NO_SUBSCRIPTION_EVENTS, WakingCallbackGroup, taken
from .transform_sender import TransformSender
from .transform_store import NoTransformError, TransformStore

COUNT_PERIOD = 0.2
"""Interval [s] at which the publishers on /tf are counted."""


class TransformListener:
    """Subscribes to /tf and /tf_static; needs tf2_msgs. Calls `on_transform` with each TransformStamped and its topic.

    With `store` the transforms are kept for `lookup`; otherwise they are received only to detect other senders than our
    `sender`. /tf is then subscribed to only while another node publishes on it, because a subscription receives our own
    transforms, too. A message on /tf wakes the executor if `is_urgent()`, else it waits for `poll` or `lookup`.
    """

    def __init__(self, node: Node, on_transform: Callable[[TransformStamped, str], None], store: bool,
                 is_urgent: Callable[[], bool], sender: TransformSender) -> None:
        self._node = node
        self._on_transform = on_transform
        self._is_urgent = is_urgent
        self._sender = sender
        self._topic = node.resolve_topic_name(TF_IN.name)
        self._store = TransformStore() if store else None
        self._moving = self._subscription() if store else None
        self._static: Subscription | None = None
        self._static_publishers: set[bytes] = set()
        self._next_count, self._others = 0.0, False
        self.subscribe_static()
        sender.subscribe_static = self.subscribe_static

    def _subscription(self) -> Subscription:
        return self._node.create_subscription(TF_IN.kind, TF_IN.name, self._on_moving, TF_IN.quality,
                                              callback_group=WakingCallbackGroup(self._is_urgent),
                                              event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def subscribe_static(self) -> None:
        """Subscribe to /tf_static, or subscribe again: every latched transform is received again."""
        if self._static:
            self._node.destroy_subscription(self._static)
        self._static = self._node.create_subscription(
            TF_STATIC.kind, TF_STATIC.name, self._on_static, TF_STATIC.quality, event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def on_timer(self) -> None:
        """Poll /tf; when a publisher on /tf_static has gone, receive the latched transforms of all others again.

        The publisher that has gone may have replaced transforms of the remaining publishers between the same frames.
        """
        self.poll()
        latched = publishers(self._node, '/tf_static').keys()
        if self._static_publishers - latched:
            self.subscribe_static()
        self._static_publishers = set(latched)

    def lookup(self, target: str, source: str, stamp: int) -> tuple[NDArray[np.float64], bool]:
        """Poll /tf, then look up a transform as `TransformStore.lookup` does; requires that `store` is true."""
        self.poll()
        assert self._store
        try:
            return self._store.lookup(target, source, stamp)
        except NoTransformError:
            raise NoTransformError(describe_missing(self._node, target, source, self._store.parents)) from None

    def planar(self, target: str, source: str, stamp: int) -> SE2 | None:
        """Return the pose of the frame `source` in `target` at `stamp` [ns] exactly; None if it is not known then.

        Requires that `store` is true.
        """
        self.poll()
        assert self._store
        try:
            matrix, known = self._store.lookup(target, source, stamp)
            return Mounting.from_matrix(matrix).pose if known else None
        except (NoTransformError, MountingError):
            return None

    def restart(self) -> None:
        """Remove the transforms that were received on /tf, because time has gone back."""
        self.poll()
        if self._store:
            self._store.clear()

    def poll(self) -> None:
        """Process the messages that have arrived on /tf; if `store` is false, also update the subscription to /tf."""
        if self._moving:
            for message, _ in taken(self._moving):
                self._on_moving(message)
        if self._store:
            return
        useful = self._sender.active and self._has_other_publisher()
        if useful and not self._moving:
            self._moving = self._subscription()
        elif self._moving and not useful:
            self._node.destroy_subscription(self._moving)
            self._moving = None

    def _has_other_publisher(self) -> bool:
        """Whether others publish on /tf, too; counted `COUNT_PERIOD` apart."""
        now = time.monotonic()
        if now >= self._next_count:
            self._next_count = now + COUNT_PERIOD
            self._others = self._node.count_publishers(self._topic) > 1
        return self._others

    def _on_moving(self, message: Any) -> None:
        self._receive(message, '/tf')

    def _on_static(self, message: Any) -> None:
        self._static_publishers |= publishers(self._node, '/tf_static').keys()
        self._receive(message, '/tf_static')

    def _receive(self, message: Any, topic: str) -> None:
        for transform in message.transforms:
            # In ROS 1 the names of frames may begin with a slash.
            transform.header.frame_id = transform.header.frame_id.lstrip('/')
            transform.child_frame_id = transform.child_frame_id.lstrip('/')
            if self._store:
                self._store.add(transform, static=topic == '/tf_static')
            self._on_transform(transform, topic)


MOST = 8
"""Number of frames that are named at most."""
ALIKE = 0.5
"""Names with at least this ratio of common characters are suggested."""
TOPICS = '/tf', '/tf_static'


def describe_missing(node: Node, base: str, frame: str, parents: Mapping[str, str]) -> str:
    """Describe why the transform from the frame `base` to that of the scans is not known, with a remedy.

    `parents` maps each frame to its parent, of all transforms received.
    """
    if not frame:
        return 'the scans name no frame (header.frame_id is empty): the driver has to set it'
    if not parents:
        return _other_topics(node)
    frames = sorted({*parents, *parents.values()})
    texts = [f'received are the frames {_listed(frames)}']
    chain = list(_chain(frame, parents))
    if frame not in frames:
        name = _nearest(frame, frames)
        chain = list(_chain(name, parents))
        texts.append(f'the scans have the frame {frame!r}, which is none of them' +
                     f'; let the driver send {name!r}' * bool(name))
    if base not in frames:
        texts.append(f'base_frame {base!r} is none of them')
        mounted = chain[1:]
        if name := _nearest(base, mounted or frames) or ''.join(mounted[-1:]):
            texts.append(f'set base_frame to {name!r}')
    elif frame in frames:
        texts.append(f'no transform connects {chain[-1]!r}, to which {frame!r} belongs, with {base!r}')
    return '; '.join(texts)


def _listed(names: list[str]) -> str:
    return ', '.join(map(repr, names[:MOST])) + f' and {len(names) - MOST} more' * (len(names) > MOST)


def _chain(frame: str, parents: Mapping[str, str]) -> Iterator[str]:
    """Yield `frame`, its parent and so on up to the root."""
    seen: set[str] = set()
    while frame not in seen:
        yield frame
        seen.add(frame)
        frame = parents.get(frame, frame)


def _nearest(name: str, frames: Iterable[str]) -> str:
    """Return the frame whose name is nearest, with or without the prefix; empty if none is near."""
    def ratio(frame: str) -> float:
        pairs = (name, frame), (name.rpartition('/')[2], frame.rpartition('/')[2])
        return max(difflib.SequenceMatcher(None, *pair).ratio() for pair in pairs)
    return max((frame for frame in frames if ratio(frame) >= ALIKE), key=ratio, default='')


def _other_topics(node: Node) -> str:
    """Describe who publishes transforms where, if none is received."""
    ours = [node.resolve_topic_name(topic) for topic in TOPICS]
    names = named(each for topic in ours for each in other_publishers(node, topic))
    if names:
        return f'none is received from {names} yet'
    others = sorted(name for name, kinds in node.get_topic_names_and_types()
                    if 'tf2_msgs/msg/TFMessage' in kinds and name not in ours and node.count_publishers(name))
    if not others:
        return f'no other node publishes on {" or ".join(ours)}'
    remedy = ', '.join(f'-r {topic}:={name}' for topic in TOPICS for name in others if name.endswith(topic))
    if set(TOPICS) & set(others):
        remedy = f'no -r {TOPICS[0]}:=... and -r {TOPICS[1]}:=...'
    return f'transforms are published on {", ".join(others)}, not on {" or ".join(ours)}: start the node with {remedy}'
