# SPDX-License-Identifier: Apache-2.0
"""Serialisation of ROS 2 messages from plain fields, without ROS; `rosbags` has the definitions of their types."""
import struct
from itertools import groupby

import numpy as np

HEADER = b'\0\1\0\0'
"""First bytes of a message in CDR: little-endian."""
FORMATS = {'bool': '?', 'octet': 'B', 'char': 'B', 'byte': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
           'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd'}
"""Basic type -> format of `struct`, which is the type code of numpy as well."""
ALIGNMENT = 8
"""Largest alignment of a value [bytes]."""
PADDING = {size: [bytes(-at % size) for at in range(ALIGNMENT)] for size in (1, 2, 4, 8)}
"""Size of a value -> the padding before it, by the position modulo `ALIGNMENT`."""


class MessageMaker:
    """Makes serialised ROS 2 messages.

    For each type of message and each of its fields a function is made once that appends a value to a bytearray. A value
    of n bytes begins at a multiple of n bytes after the header.

    Attributes
    ----------
    store : rosbags.typesys.store.Typestore
        Type store with the message types of ROS 2 Jazzy.
    """

    def __init__(self):
        from rosbags.typesys import Stores, get_typestore
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self._messages = {}

    def serialize(self, kind, fields):
        """Return the message of type `kind`, such as ``nav_msgs/msg/Odometry``, as CDR.

        Parameters
        ----------
        fields : dict
            Field name -> value, nested; fields left out are zero, empty, or the identity rotation.
        """
        out = bytearray()
        self._message(kind)(out, fields)
        return HEADER + bytes(out)

    def _message(self, kind):
        """Return the function that appends the fields, a dict, of a message of type `kind`."""
        if kind not in self._messages:
            self._messages[kind] = self._make_message(kind)
        return self._messages[kind]

    def _make_message(self, kind):
        definition = self.store.fielddefs[kind][1]
        names = {name for name, _ in definition}
        identity = {'w': 1.0} if kind == 'geometry_msgs/msg/Quaternion' else {}
        parts = [part for size, run in groupby(definition, _number_size)
                 for part in ([_numbers(size, list(run), identity)] if size else map(self._field, run))]
        defaults = {}

        def append(out, fields):
            at = len(out) % ALIGNMENT
            if not fields and at in defaults:
                out += defaults[at]
                return
            if not names.issuperset(fields):
                raise TypeError(f'{kind} has no field {", ".join(fields.keys() - names)}')
            begin = len(out)
            for part in parts:
                part(out, fields)
            if not fields:
                defaults[at] = bytes(out[begin:])

        return append

    def _field(self, member):
        """Return the function that appends a field that is no number, taken from the fields of its message."""
        from rosbags.interfaces import Nodetype
        name, (node, detail) = member
        if node == Nodetype.BASE:
            return lambda out, fields: _append_text(out, fields.get(name, ''))
        if node == Nodetype.NAME:
            message = self._message(detail)
            return lambda out, fields: message(out, fields.get(name, {}))
        (element, what), length = detail
        fixed = length if node == Nodetype.ARRAY else None
        if element == Nodetype.BASE and what[0] != 'string':
            return _array(name, np.dtype(FORMATS[what[0]]).newbyteorder('<'), fixed)
        append = _append_text if element == Nodetype.BASE else self._message(what)
        return _sequence(name, append, fixed, '' if element == Nodetype.BASE else {})


def _number_size(member):
    """Return the size [bytes] of a field that is a number; 0 for any other field."""
    _, (node, detail) = member
    number = FORMATS.get(detail[0]) if node.name == 'BASE' else None
    return struct.calcsize(number) if number else 0


def _numbers(size, members, given):
    """Return the function that appends adjacent numbers of `size` [bytes]; `given` has defaults other than 0."""
    items = [(name, given.get(name, 0)) for name, _ in members]
    pack = struct.Struct('<' + ''.join(FORMATS[detail[0]] for _, (_, detail) in members)).pack
    padding = PADDING[size]

    def append(out, fields):
        out += padding[len(out) % ALIGNMENT]
        out += pack(*[fields.get(name, default) for name, default in items])

    return append


def _append_text(out, text):
    content = text.encode()
    out += PADDING[4][len(out) % ALIGNMENT]
    out += struct.pack('<I', len(content) + 1)
    out += content
    out.append(0)


def _array(name, dtype, length):
    """Return the function that appends an array of numbers; its length first, unless it has a fixed `length`."""
    padding = PADDING[dtype.itemsize]

    def append(out, fields):
        values = np.asarray(fields.get(name, np.zeros(length or 0)), dtype=dtype)
        _append_length(out, name, values, length)
        if values.size:
            out += padding[len(out) % ALIGNMENT]
            out += values.tobytes()

    return append


def _sequence(name, append_item, length, empty):
    """Return the function that appends texts or messages, each with `append_item`; `empty` is the default of one."""
    def append(out, fields):
        items = fields.get(name, [empty] * (length or 0))
        _append_length(out, name, items, length)
        for item in items:
            append_item(out, item)

    return append


def _append_length(out, name, values, length):
    """Append the number of `values`, unless it is the fixed `length` of the field."""
    if length is None:
        out += PADDING[4][len(out) % ALIGNMENT]
        out += struct.pack('<I', len(values))
    elif len(values) != length:
        raise ValueError(f'{name}: {len(values)} values where {length} are needed')
