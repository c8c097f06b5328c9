# SPDX-License-Identifier: Apache-2.0
"""The part of a recording that is converted."""
import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

from ..core.scan import SECOND
from .bags.reading import safely

LONGEST = 4e9
"""Upper limit of the duration of a recording [s]; later times are treated as the end of the recording."""


class Gap(NamedTuple):
    """Part of a topic of a bag that is left out: from `start` to `end`, since the first message of the bag [s]."""

    topic: str
    start: float
    end: float


@dataclass(frozen=True)
class Kept:
    """Part of a recording that is converted.

    Attributes
    ----------
    topic : str or None
        Topic of the scans; needed if a log is read or written and the source has several topics of scans.
    topics : collection of str
        Topics to write to a bag; empty: all topics.
    start, end : float
        First and last time to convert, since the first message [s]. Static transforms from before are kept.
    without : collection of Gap
        Parts to leave out when a bag becomes a bag.
    """

    topic: str | None = None
    topics: Collection[str] = ()
    start: float = 0.0
    end: float = math.inf
    without: Collection[Gap] = ()


def messages_of_part(reader, connections, kept, problems, left_out):
    """Yield the messages of the part `kept` of a bag on some `connections`: connection, record time [ns] and bytes.

    The static transforms from before come first, at the time at which the part starts.

    Parameters
    ----------
    reader : BagReader
    connections : list
    kept : Kept
    problems : list of str
        Receives a line for each damaged part of the bag.
    left_out : Counter
        Receives the number of messages in each `Gap`.
    """
    for connection, time, raw in _of_window(reader, connections, kept, problems):
        passed = (time - reader.start_time) / SECOND
        gaps = [gap for gap in kept.without if gap.topic == connection.topic and gap.start <= passed <= gap.end]
        left_out.update(gaps)
        if not gaps:
            yield connection, time, raw


def _of_window(reader, connections, kept, problems):
    """Yield the messages from start to end, gaps included, after the static transforms from before."""
    window = _window(reader, kept)
    static = [connection for connection in connections if connection.topic == '/tf_static']
    before = [(connection, window['start'], raw)
              for connection, _, raw in safely(reader, static, problems.append, stop=window['start'])] if static else []
    for message in safely(reader, connections, problems.append, **window):
        yield from before
        before = []
        yield message


def _window(reader, kept):
    """Return the arguments ``start`` and ``stop`` [ns] with which the reader reads the part `kept` of the bag."""
    window = {'start': reader.start_time + round(min(kept.start, LONGEST) * SECOND)}
    if kept.end < LONGEST:
        window['stop'] = reader.start_time + round(kept.end * SECOND) + 1
    return window
