# SPDX-License-Identifier: Apache-2.0
"""Packages that the manifest names, and those that only some of the tests need."""
import re

NOT_IN_THE_MANIFEST = frozenset({
    'colcon_core', 'colcon_python_setup_py', 'coverage', 'dask', 'distributed', 'kiss_icp', 'lz4',
    'optuna', 'rosbags', 'shapely', 'small_gicp', 'wheel', 'xdist'})
"""Names of modules; a test that needs one is skipped where it is not installed."""

OTHER_NAMES = {'cython3': 'Cython', 'python3-pil': 'PIL', 'tf2_ros_py': 'tf2_ros'}
"""Keys of rosdep whose module has another name than the key without ``python3-``."""


def in_the_manifest(root):
    """Names of the modules of all packages that package.xml depends on."""
    keys = re.findall(r'<\w+_depend>([\w-]+)<', (root / 'package.xml').read_text())
    return {OTHER_NAMES.get(key, key.removeprefix('python3-')) for key in keys}
