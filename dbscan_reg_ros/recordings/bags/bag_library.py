# SPDX-License-Identifier: Apache-2.0
"""Choice of the library that reads and writes bags: `rosbags`, or `rosbag2_py`, which every ROS 2 Jazzy has.

The modules `with_rosbags` and `with_rosbag2_py` have the same interface: `BagReader`, `BagWriter` and `serializer`.
"""
from importlib.util import find_spec

from .bag_faults import kind_at


def is_ros1(path) -> bool:
    """Whether the file at `path` is a ROS 1 bag."""
    return kind_at(path) == 'ROS 1 bag'


def bag_library(ros1=False):
    """Return the module that reads and writes bags: `with_rosbags` if `rosbags` is installed, else `with_rosbag2_py`.

    Parameters
    ----------
    ros1 : bool
        Whether the library must support ROS 1 bags, which `rosbag2_py` does not.

    Raises
    ------
    ModuleNotFoundError
        When no library is installed; the error names `rosbags`, which can be installed on any system.
    """
    if ros1 or find_spec('rosbags') or not find_spec('rosbag2_py'):
        try:
            from . import with_rosbags
        except ModuleNotFoundError as missing:
            if missing.name != 'rosbags':
                raise
            raise ModuleNotFoundError('bags need the package rosbags: pip install rosbags', name='rosbags') from None
        return with_rosbags
    from . import with_rosbag2_py
    return with_rosbag2_py
