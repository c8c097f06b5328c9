# SPDX-License-Identifier: Apache-2.0
"""Serialisation of ROS 2 messages from plain fields with `rosbags`, without ROS."""
from functools import cache

import numpy as np

BYTES = dict.fromkeys(('octet', 'byte', 'char'), 'uint8')
"""Type in a definition that numpy has under another name."""
EMPTY = {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}


class MessageMaker:
    """Makes serialised ROS 2 messages.

    Attributes
    ----------
    store : rosbags.typesys.store.Typestore
        Type store with the message types of ROS 2 Jazzy.
    """

    def __init__(self):
        from rosbags.typesys import Stores, get_typestore
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self._members = cache(self._members)

    def serialize(self, kind, fields):
        """Return the message of type `kind`, such as ``nav_msgs/msg/Odometry``, as CDR.

        Parameters
        ----------
        fields : dict
            Field name -> value, nested; fields left out are zero, empty, or the identity rotation.
        """
        return self.store.serialize_cdr(self._make(kind, fields), kind)

    def _make(self, kind, fields):
        message, members, parts = self._members(kind)
        if parts:
            fields = {name: self._part(parts[name], value) if name in parts else value
                      for name, value in fields.items()}
        return message(**(members | fields))

    def _part(self, kind, value):
        return [self._make(kind, item) for item in value] if isinstance(value, list) else self._make(kind, value)

    def _members(self, kind):
        """Return the class of a message type, the default of every field, and the type of each nested message field."""
        from rosbags.interfaces import Nodetype
        defaults, parts = {}, {}
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            if node == Nodetype.BASE:
                defaults[name] = EMPTY.get(detail[0], 0)
            elif node == Nodetype.NAME:
                parts[name] = detail
                defaults[name] = self._make(detail, {})
            else:
                (element, what), length = detail
                length = length if node == Nodetype.ARRAY else 0
                if element == Nodetype.NAME:
                    parts[name] = what
                    defaults[name] = [self._make(what, {}) for _ in range(length)]
                elif what[0] == 'string':
                    defaults[name] = [''] * length
                else:
                    defaults[name] = np.zeros(length, dtype=BYTES.get(what[0], what[0]))
        if kind == 'geometry_msgs/msg/Quaternion':
            defaults['w'] = 1.0
        return self.store.types[kind], defaults, parts
