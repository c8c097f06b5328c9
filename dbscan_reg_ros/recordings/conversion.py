# SPDX-License-Identifier: Apache-2.0
"""Conversion between CARMEN logs, ROS 1 bags and ROS 2 bags."""
import contextlib
import gzip
import math
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

from ..core.errors import RecordingError
from ..core.scan import SECOND
from ..paths import check_writable
from .bags.bag import LASER_SCAN, ODOMETRY
from .bags.reading import bag_library, is_ros1, open_reader, own, safely
from .carmen.lines import SETTINGS, format_line, settings_of
from .message_fields import pose_only_fields, scan_fields
from .opening import is_bag, open_recording
from .recording import Record
from .truth import truth_beside

LONGEST = 4e9
"""Upper limit of the duration of a recording [s]; later times are treated as the end of the recording."""


class Gap(NamedTuple):
    """Part of a topic of a bag that is left out: from `start` to `end`, since the first message of the bag [s]."""

    topic: str
    start: float
    end: float


@dataclass(frozen=True)
class Kept:
    """Part of a recording that is converted."""

    topic: str | None = None
    """Topic of the scans; needed if a log is read or written and the source has several topics of scans."""
    topics: Collection[str] = ()
    """Topics to write to a bag; empty: all topics."""
    start: float = 0.0
    end: float = math.inf
    """First and last time to convert, since the first message [s]. Static transforms from before are kept."""
    without: Collection[Gap] = ()
    """Parts to leave out when a bag becomes a bag."""


def messages_of_part(reader, connections, kept, problems, left_out):
    """Yield the messages of the part `kept` of a bag on some `connections`: connection, record time [ns] and bytes.

    The static transforms from before come first, at the time at which the part starts. `problems` receives a line for
    each damaged part of the bag, the Counter `left_out` the number of messages in each `Gap`.
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


T = TypeVar('T')
LOG_TOPICS = {'/wheel_odom': ODOMETRY, '/laser_pose': ODOMETRY, '/truth': ODOMETRY, '/scan': LASER_SCAN}
"""Topic -> message type in a bag made from a CARMEN log, in this order; see `_topics_of`."""
ALL = Kept()


def no_progress(items: Iterable[T], _total: int) -> Iterable[T]:
    """Return the `items` unchanged, without any display of progress."""
    return items


def convert(source: str | Path, target: str | Path, kept: Kept = ALL, *, storage: str = 'mcap',
            progress: Callable[[Iterable, int], Iterable] = no_progress) -> tuple[Counter, list[str]]:
    """Convert the recording `source`, or a part of it, to the format of `target`.

    The messages keep their order and their stamps. The record times of a bag made from a log are the stamps, increased
    where they go back. ``Ctrl-C`` leaves a valid recording of the messages written until then.

    Parameters
    ----------
    source : str or Path
    target : str or Path
        ``NAME.log`` or ``NAME.log.gz`` becomes a CARMEN log, ``NAME.bag`` a ROS 1 bag, any other name the folder of
        a ROS 2 bag.
    kept : Kept
        The part of the recording that is converted.
    storage : str
        Storage of a ROS 2 bag: ``mcap`` or ``sqlite3``.
    progress : callable
        ``progress(iterable, total)`` returns an iterable of the same items, and may show how many were processed.

    Returns
    -------
    counts : Counter
        Topic -> number of messages written.
    remarks : list of str
        Assumptions made to read `source`, its damaged parts, which were skipped, a line for each part left out, and
        which true poses `target` lacks.

    Raises
    ------
    RecordingError
        When `source` cannot be read, `target` exists or cannot be made, a topic is missing, or the part `kept` or a
        part to leave out contains no message.
    """
    source, target = Path(source), Path(target)
    check_target(target)
    from_bag, to_log = is_bag(source), target.name.endswith(('.log', '.log.gz'))
    bag_to_bag = from_bag and not to_log
    if not 0.0 <= kept.start <= kept.end:
        raise RecordingError(f'from {kept.start:g} to {kept.end:g} s: expected a start of 0 s or later, and an end '
                             'that is not before it')
    if kept.without and not bag_to_bag:
        raise RecordingError(f'{target}: --without applies to a bag that is written from a bag')
    if to_log and kept.topics:
        raise RecordingError(f'{target}: topics to keep ({", ".join(kept.topics)}) apply to bags; a log takes the '
                             'scans of one topic (--topic)')
    if bag_to_bag and kept.topic:
        raise RecordingError(f'{target}: --topic {kept.topic} applies to logs; for a bag use --topics')
    open_target = partial(bag_writer, target, storage)
    beside = [f'{file.name} beside {source.name}, with true motions, is not copied' for file in truth_beside(source)]
    if bag_to_bag:
        counts, remarks = _bag_to_bag(source, open_target, kept, progress)
        return counts, [*remarks, *beside]
    recording = open_recording(source, kept.topic)
    records = _timed(progress(recording.records(), recording.count), kept.start, kept.end)
    if to_log:
        counts = write_log(target, (record for _, record in records))
    else:
        counts = _log_to_bag(records, open_target, _topics_of(recording, kept.topics))
    if recording.truth() is not None and open_recording(target).truth() is None:
        beside.append(f'{target.name} has no true poses, which {source.name} has: in what is kept the poses of the '
                      'laser do not differ from those of the wheels')
    return counts, [*recording.notes, *recording.problems, *beside]


def _topics_of(recording, wanted):
    """Return topic -> message type of the bag made from a log: scans, and wheel odometry and laser poses, or the truth.

    Only `wanted` topics are returned; if `wanted` is empty, all of them.
    """
    poses = ('/wheel_odom', '/laser_pose') if recording.wheel_odometry() else ('/truth',) if recording.truth() else ()
    topics = (*poses, '/scan')
    _check_topics(wanted, topics, 'the bag of this log')
    return {topic: kind for topic, kind in LOG_TOPICS.items() if topic in topics and topic in (wanted or topics)}


def check_target(target):
    """Raise RecordingError if no recording can be written at the path `target`."""
    if target.exists():
        raise RecordingError(f'{target}: exists already; choose another name, or remove it')
    if not target.parent.is_dir():
        raise RecordingError(f'{target.parent}: no such folder to write to')
    if target.suffix in ('.mcap', '.db3'):
        raise RecordingError(f'{target}: a ROS 2 bag is a folder; leave out the ending and choose --storage')
    check_writable(target, RecordingError)


def _timed(records, start, end):
    """Yield strictly increasing record times [ns] and the records from `start` to `end` [s] after the first record."""
    first = time = None
    passed, kept = 0.0, False
    for record in records:
        time = record.scan.stamp if time is None else max(record.scan.stamp, time + 1)
        first = time if first is None else first
        passed = (time - first) / SECOND
        if start <= passed <= end:
            kept = True
            yield time, record
    if not kept:
        raise _nothing(start, end, passed)


def _nothing(start, end, length):
    return RecordingError(f'from {start:g} to {end:g} s: no message to keep; the recording lasts {length:.3f} s')


def write_log(target: Path, records: Iterable[Record]) -> Counter[str]:
    """Write a CARMEN log of `records`; return CARMEN message name -> number of lines."""
    counts: Counter[str] = Counter()
    settings = dict(SETTINGS)
    open_log = gzip.open if target.suffix == '.gz' else open
    with _none_when_failed(target), open_log(target, 'wt', encoding='utf-8') as log:
        log.write('# CARMEN log\n')
        for record in records:
            for name, value in settings_of(record.scan).items():
                if settings[name] != value:
                    settings[name] = value
                    log.write(f'PARAM {name} {value}\n')
            line = format_line(record)
            log.write(line + '\n')
            counts[line.partition(' ')[0]] += 1
    return counts


def _log_to_bag(records, open_target, topics):
    """Write pairs (record time [ns], `Record`) to a bag with these `topics`; return topic -> number of messages."""
    counts = Counter()
    with open_target() as (writer, serialize):
        added = {name: writer.add_topic(name, kind) for name, kind in topics.items()}
        for time, record in records:
            messages = _messages(record)
            for name, kind in topics.items():
                writer.write(added[name], time, serialize(kind, messages[name]))
                counts[name] += 1
    return counts


def _bag_to_bag(source, open_target, kept, progress):
    """Write the part `kept` of the bag `source`; return topic -> number of messages, and the damaged parts skipped."""
    counts, problems, left_out = Counter(), [], Counter()
    with open_reader(source) as reader:
        connections = _connections(reader, source, kept.topics)
        _check_topics({gap.topic for gap in kept.without}, {connection.topic for connection in connections}, source)
        messages = messages_of_part(reader, connections, kept, problems, left_out)
        with open_target(source) as (writer, _):
            convert_message = writer.add_topics_of(reader, connections)
            for connection, time, raw in progress(messages, sum(c.msgcount for c in connections)):
                try:
                    added, message = convert_message(connection, raw)
                except Exception as error:  # noqa: BLE001 - a damaged message makes the library raise nearly anything
                    problems.append(f'{source.name}: damaged message on {connection.topic} skipped{own(error)}')
                    continue
                writer.write(added, time, message)
                counts[connection.topic] += 1
            if not counts:
                raise (RecordingError(problems[0]) if problems
                       else _nothing(kept.start, kept.end, reader.duration / SECOND))
            for gap in kept.without:
                if not left_out[gap]:
                    raise RecordingError(f'{source}: no message on {gap.topic} from {gap.start:g} to {gap.end:g} s to '
                                         f'leave out; the recording lasts {reader.duration / SECOND:.3f} s')
    return counts, [*problems, *(f'{gap.topic}: {count} messages from {gap.start:g} to {gap.end:g} s left out'
                                 for gap, count in left_out.items())]


def _connections(reader, source, topics):
    """Return the connections of the bag `source` on the `topics`, or all connections if `topics` is empty."""
    _check_topics(topics, {connection.topic for connection in reader.connections}, source)
    if not reader.message_count:
        raise RecordingError(f'{source}: holds no message')
    return [connection for connection in reader.connections if not topics or connection.topic in topics]


@contextlib.contextmanager
def bag_writer(target, storage='mcap', source=None):
    """Provide the writer of the bag `target` and its serialiser; `source` is the bag that is copied, if there is one.

    An interrupted writer leaves a valid bag; after an error no bag is left.
    """
    library = bag_library(ros1=target.suffix == '.bag' or (source is not None and is_ros1(source)))
    interrupted = None
    with _none_when_failed(target), library.BagWriter(target, storage) as writer:
        try:
            yield writer, library.serializer(target)
        except KeyboardInterrupt as error:
            interrupted = error
    if interrupted:
        raise interrupted


@contextlib.contextmanager
def _none_when_failed(target):
    try:
        yield
    except Exception:
        if target.is_dir():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)
        raise


def _messages(record):
    """Return topic -> message fields for one `Record` of a log."""
    return {'/wheel_odom': pose_only_fields(record.scan.stamp, 'base_link', record.robot_pose),
            **{topic: pose_only_fields(record.scan.stamp, record.scan.frame_id, record.laser_pose)
               for topic in ('/laser_pose', '/truth')},
            '/scan': scan_fields(record.scan)}


def _check_topics(wanted, held, where):
    missing = sorted(set(wanted) - set(held))
    if missing:
        raise RecordingError(f'{where}: no topic {", ".join(missing)}; there are {", ".join(sorted(held))}')
