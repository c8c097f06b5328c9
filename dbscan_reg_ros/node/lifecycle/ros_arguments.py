# SPDX-License-Identifier: Apache-2.0
"""Telling a command's own arguments from those of ROS."""


def split_arguments(argv):
    """(own arguments, those between ``--ros-args`` and ``--``, both included) of a command line."""
    own, ros, inside = [], [], False
    for word in argv:
        inside = inside or word == '--ros-args'
        (ros if inside else own).append(word)
        inside = inside and word != '--'
    return own, ros
