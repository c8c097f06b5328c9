# SPDX-License-Identifier: Apache-2.0
"""Which module may import which, read from the source: layers and circles."""
import ast
import keyword
import re
import subprocess
import sys

import pytest

PACKAGE = 'dbscan_reg_ros'
BENCHMARKS = 'benchmarks'
INTERFACES = {'builtin_interfaces', 'rcl_interfaces', 'rclpy', 'rosbag2_py'}
WITH_ROSBAG2_PY = 'recordings/bags/with_rosbag2_py.py'
"""Reads and writes bags with ROS's own library and no node; only where it is chosen is it imported."""
CORE_LIBRARIES = {'numpy', 'scipy', 'sklearn'}
WORLD_OUTSIDE = {'asyncio', 'builtins', 'datetime', 'glob', 'gzip', 'io', 'logging', 'multiprocessing', 'os', 'pathlib',
                 'pickle', 'random', 'shutil', 'signal', 'socket', 'subprocess', 'sys', 'tempfile', 'threading', 'time'}

LAYERS = (
    {'paths', 'allocation', 'command_lines', 'endings'},
    {'core'},
    {'build_check', 'private_graph'},
    {'requirements', 'recordings', 'robot'},
    {'evaluation', 'simulation'},
    {'places'},
    {'node'},
    {'figures', 'replays', 'tuning'},
    {'commands'},
    {'__init__', '__main__'},
)
"""What lies directly in the package, lowest layer first, as doc/architecture.md draws it."""


SOURCE_SUFFIXES = '.py', '.pyx'


def sources(folder):
    files = sorted(path for suffix in SOURCE_SUFFIXES for path in folder.rglob(f'*{suffix}'))
    assert files
    return files


def syntax_tree(path):
    """The syntax tree of a file; of Cython, whose statements Python cannot parse, only the imports and calls."""
    text = path.read_text()
    if path.suffix == '.py':
        return ast.parse(text)
    imports = re.findall(r'^(?:from [\w.]+ )?import [\w., ]+$', text, re.MULTILINE)
    calls = re.findall(r'(?<!def )(?<![\w.])[A-Za-z]\w*(?=\()', text)
    return ast.parse('\n'.join([*imports, *(f'{name}()' for name in calls if not keyword.iskeyword(name))]))


def imported(path, package):
    """Absolute names of all that a file imports, anywhere in it."""
    inside = [package.name, *path.relative_to(package).parent.parts]
    for node in ast.walk(syntax_tree(path)):
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


def test_the_core_reads_no_file_and_prints_nothing(package):
    for path in sources(package / 'core'):
        called = {node.func.id for node in ast.walk(syntax_tree(path))
                  if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        assert not called & {'open', 'print', 'input', 'exec', 'eval'}, path


def test_only_the_node_imports_ros_and_what_reads_bags_with_it(package):
    for path in sources(package):
        if package / 'node' not in path.parents and path != package / WITH_ROSBAG2_PY:
            ros = {name for name in imported(path, package) if top(name) in INTERFACES or top(name).endswith('_msgs')}
            assert not ros, f'{path} imports {ros}'


class ImportGraph:
    """Imports among our own modules, those inside functions included: `imports` is module -> modules."""

    def __init__(self, root):
        self.paths = {}
        for folder, package in (root, PACKAGE), (root / 'scripts', BENCHMARKS):
            for path in sources(folder / package):
                self.paths['.'.join(path.relative_to(folder).with_suffix('').parts)] = path
        self.imports = {module: set(self._of(module, path)) for module, path in self.paths.items()}

    def _of(self, module, path):
        package = path.parents[module.count('.') - 1]
        for name in imported(path, package):
            while name and name not in self.paths and f'{name}.__init__' not in self.paths:
                name = name.rpartition('.')[0]
            target = name if name in self.paths else f'{name}.__init__'
            if name and target != module:
                yield target

    def among(self, folder):
        """Imports among the modules and folders directly in `folder`, each folder taken as a whole."""
        graph = {}
        for module, targets in self.imports.items():
            for target in targets:
                inside = [self._child(name, folder) for name in (module, target)]
                if all(inside) and inside[0] != inside[1]:
                    graph.setdefault(inside[0], set()).add(inside[1])
        return graph

    @staticmethod
    def _child(module, folder):
        if not module.startswith(f'{folder}.'):
            return ''
        return module[len(folder) + 1:].partition('.')[0]


def circle(graph):
    """Find the nodes of a graph (node -> nodes) that no order can sort; empty without a circle."""
    left = {node: set(targets) for node, targets in graph.items()}
    while True:
        ends = [node for node, targets in left.items() if not targets & left.keys()]
        if not ends:
            return sorted(left)
        for node in ends:
            del left[node]


@pytest.fixture(scope='module')
def graph(root):
    return ImportGraph(root)


def test_modules_import_each_other_in_no_circle(graph):
    assert circle(graph.imports) == []


def test_folders_import_each_other_in_no_circle(graph):
    folders = {module.rpartition('.')[0] for module in graph.paths}
    assert {folder: nodes for folder in folders if (nodes := circle(graph.among(folder)))} == {}


def test_layers_import_only_lower_layers_and_their_own(graph):
    level = {name: height for height, layer in enumerate(LAYERS) for name in layer}
    rooms = {path.name for module, path in graph.paths.items() if path.name != '__init__.py' and module.count('.') == 1}
    for importer, targets in graph.among(PACKAGE).items():
        up = {target for target in targets if level[target] > level[importer]}
        assert not up, f'{importer} imports {up}'
    assert rooms
    for module, targets in graph.imports.items():
        if top(module) == PACKAGE:
            assert BENCHMARKS not in {top(target) for target in targets}, module


def test_the_whole_core_loads_without_scikit_learn(root):
    code = ('import importlib, pathlib, sys\n'
            f'for path in pathlib.Path("{PACKAGE}/core").rglob("*.py"): '
            'importlib.import_module(".".join(path.with_suffix("").parts))\n'
            'print(sorted({"matplotlib", "rclpy", "rosbags", "sklearn", "yaml"} & set(sys.modules)))')
    result = subprocess.run([sys.executable, '-c', code], cwd=root, capture_output=True, text=True, check=True)
    assert result.stdout == '[]\n'
