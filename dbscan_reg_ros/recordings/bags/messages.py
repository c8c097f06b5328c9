# SPDX-License-Identifier: Apache-2.0
"""Serialisation of ROS 2 messages from plain fields with the definitions of `rosbags`, without ROS."""
import struct
from functools import cache, partial

import numpy as np

LITTLE_ENDIAN = b'\0\1\0\0'
"""Begin of a message in CDR; alignment counts from its end."""
NUMBERS = {'bool': '?', 'byte': 'B', 'octet': 'B', 'char': 'B', 'float32': 'f', 'float64': 'd',
           'int8': 'b', 'int16': 'h', 'int32': 'i', 'int64': 'q',
           'uint8': 'B', 'uint16': 'H', 'uint32': 'I', 'uint64': 'Q'}
"""Type in a definition -> its letter, the same for struct and numpy."""


class MessageMaker:
    """Makes serialised ROS 2 messages (CDR): rosbags itself makes an object of each point of each segment first.

    Attributes
    ----------
    store : rosbags.typesys.store.Typestore
        Type store with the message types of ROS 2 Jazzy.
    """

    def __init__(self):
        from rosbags.typesys import Stores, get_typestore
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self._members, self._empty = cache(self._members), cache(self._empty)

    def serialize(self, kind, fields):
        """Return the message of type `kind`, such as ``nav_msgs/msg/Odometry``, as CDR.

        Parameters
        ----------
        fields : dict
            Field name -> value, nested; fields left out are zero, empty, or the identity rotation.
        """
        out = bytearray()
        self._write(kind, out, fields)
        return LITTLE_ENDIAN + out

    def _write(self, kind, out, fields):
        """Append a message with some `fields` to the bytes `out`."""
        if not fields:
            out += self._empty(kind, len(out) % 8)
            return
        for name, write, default in self._members(kind):
            write(out, fields.get(name, default))

    def _empty(self, kind, offset):
        """Return a message without any fields given that begins `offset` bytes after a multiple of 8."""
        out = bytearray(offset)
        for _, write, default in self._members(kind):
            write(out, default)
        return bytes(out[offset:])

    def _members(self, kind):
        """Return for each field of a message type its name, the function that appends its value, and its default."""
        from rosbags.interfaces import Nodetype
        members = []
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            if node in (Nodetype.BASE, Nodetype.NAME):
                members.append((name, *self._one(node, detail)))
            else:
                (element, what), length = detail
                one, default = self._one(element, what)
                numbers = self._numbers(element, what)
                if node == Nodetype.ARRAY:
                    members.append((name, numbers or partial(_each, one), [default] * length))
                else:
                    members.append((name, partial(_sequence, numbers or partial(_each, one)), []))
        if kind == 'geometry_msgs/msg/Quaternion':
            members = [(name, write, float(name == 'w')) for name, write, _ in members]
        return members

    def _one(self, node, detail):
        """Return the function that appends one value of a type, and the default value."""
        from rosbags.interfaces import Nodetype
        if node == Nodetype.NAME:
            return partial(self._write, detail), {}
        if detail[0] == 'string':
            return _string, ''
        return _number(NUMBERS[detail[0]]), 0

    def _numbers(self, node, detail):
        """Return the function that appends many values of a type that is a number, or points; None for other types."""
        from rosbags.interfaces import Nodetype
        if node == Nodetype.BASE:
            return partial(_array, f'<{NUMBERS[detail[0]]}') if detail[0] in NUMBERS else None
        if detail != 'geometry_msgs/msg/Point':
            return None
        return lambda out, points: _array(
            '<d', out, [[point['x'], point['y'], point.get('z', 0.0)] for point in points])


def _number(letter):
    """Return the function that appends a number."""
    number = struct.Struct(f'<{letter}')

    def write(out, value):
        out.extend(bytes(-len(out) % number.size))
        out += number.pack(value)

    return write


_count = _number('I')


def _string(out, value):
    data = value.encode()
    _count(out, len(data) + 1)
    out += data + b'\0'


def _array(kind, out, values):
    if len(values):
        numbers = np.asarray(values, dtype=kind)
        out.extend(bytes(-len(out) % numbers.itemsize))
        out += numbers.tobytes()


def _each(write, out, values):
    for value in values:
        write(out, value)


def _sequence(write, out, values):
    _count(out, len(values))
    write(out, values)
