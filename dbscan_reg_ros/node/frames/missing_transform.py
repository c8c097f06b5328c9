# SPDX-License-Identifier: Apache-2.0
"""What is there in place of a missing transform: other topics of transforms, other frames, and the nearest names."""
import difflib
from collections.abc import Iterable, Iterator, Mapping

from rclpy.node import Node

from ..interfaces.graph_checks import named, other_publishers

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
