# SPDX-License-Identifier: Apache-2.0
"""Split a command line into the arguments of the command and the ROS arguments."""
from collections.abc import Sequence


def split_arguments(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments of the command, and the ROS arguments from ``--ros-args`` to ``--`` inclusive."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for word in argv:
        inside = inside or word == '--ros-args'
        (ros if inside else own).append(word)
        inside = inside and word != '--'
    return own, ros
