# SPDX-License-Identifier: Apache-2.0
"""The floors of the house: who may import whom, read from the source."""
import ast
import subprocess
import sys

import pytest

PACKAGE = 'dbscan_reg_ros'
INTERFACES = {'builtin_interfaces', 'rcl_interfaces', 'rclpy', 'rosbag2_py'}
WITH_ROSBAG2_PY = 'recordings/bags/with_rosbag2_py.py'
"""Reads and writes bags with ROS's own library and no node; only where it is chosen is it imported."""
CORE_LIBRARIES = {'numpy', 'scipy', 'sklearn'}
WORLD_OUTSIDE = {'asyncio', 'builtins', 'datetime', 'glob', 'gzip', 'io', 'logging', 'multiprocessing', 'os', 'pathlib',
                 'pickle', 'random', 'shutil', 'signal', 'socket', 'subprocess', 'sys', 'tempfile', 'threading', 'time'}


def sources(folder):
    files = sorted(folder.rglob('*.py'))
    assert files
    return files


def imported(path, package):
    """Absolute names of all that a file imports, anywhere in it."""
    inside = [PACKAGE, *path.relative_to(package).parent.parts]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = inside[:len(inside) - node.level + 1] if node.level else []
            base = '.'.join([*above, *([node.module] if node.module else [])])
            yield from (f'{base}.{alias.name}' for alias in node.names)


def top(name):
    return name.partition('.')[0]


@pytest.fixture(scope='module')
def package(root):
    return root / PACKAGE


def test_the_core_knows_only_itself_and_numerical_libraries(package):
    for path in sources(package / 'core'):
        for name in imported(path, package):
            if top(name) == PACKAGE:
                assert name.startswith(f'{PACKAGE}.core'), f'{path} imports {name}'
            else:
                assert top(name) in CORE_LIBRARIES | sys.stdlib_module_names - WORLD_OUTSIDE, f'{path} imports {name}'


def test_the_core_reads_no_file_and_no_clock(package):
    for path in sources(package / 'core'):
        called = {node.func.id for node in ast.walk(ast.parse(path.read_text()))
                  if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        assert not called & {'open', 'print', 'input', 'exec', 'eval'}, path


def test_only_the_node_imports_ros_and_what_reads_bags_with_it(package):
    for path in sources(package):
        if package / 'node' not in path.parents and path != package / WITH_ROSBAG2_PY:
            ros = {name for name in imported(path, package) if top(name) in INTERFACES or top(name).endswith('_msgs')}
            assert not ros, f'{path} imports {ros}'


@pytest.mark.parametrize('floor', ['core', 'recordings', 'simulation', 'evaluation', 'robot'])
def test_nothing_below_imports_node_or_commands(package, floor):
    for path in sources(package / floor):
        up = {name for name in imported(path, package)
              if name.startswith((f'{PACKAGE}.node', f'{PACKAGE}.commands', f'{PACKAGE}.benchmarks'))}
        assert not up, f'{path} imports {up}'


def test_the_whole_core_loads_without_scikit_learn(root):
    code = ('import importlib, pathlib, sys\n'
            f'for path in pathlib.Path("{PACKAGE}/core").rglob("*.py"): importlib.import_module(".".join(path.with_suffix("").parts))\n'
            'print(sorted({"matplotlib", "rclpy", "rosbags", "sklearn", "yaml"} & set(sys.modules)))')
    result = subprocess.run([sys.executable, '-c', code], cwd=root, capture_output=True, text=True, check=True)
    assert result.stdout == '[]\n'


def test_what_reads_bags_with_ros_is_small_and_imported_in_one_place(package):
    assert len((package / WITH_ROSBAG2_PY).read_text().splitlines()) <= 150
    importing = {path.name for path in sources(package)
                 if any(name.endswith('with_rosbag2_py') for name in imported(path, package))}
    assert importing == {'bag_library.py'}
