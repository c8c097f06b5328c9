# SPDX-License-Identifier: Apache-2.0
"""What the manifest, setup.py and the imports have to agree on."""
import ast
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from manifest import NOT_IN_THE_MANIFEST, in_the_manifest

from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.command_lines import COMMANDS

PACKAGE = 'dbscan_reg_ros'
ROSDEP_KEYS = {'PIL': 'python3-pil', 'matplotlib': 'python3-matplotlib', 'numpy': 'python3-numpy',
               'scipy': 'python3-scipy',
               'sklearn': 'python3-sklearn', 'tqdm': 'python3-tqdm', 'yaml': 'python3-yaml'}
NO_ROSDEP_KEY = {'distributed', 'lz4', 'optuna', 'rosbags'}
"""Got by pip; lz4 comes with rosbags."""
ONLY_COMPARED_WITH = {'kiss_icp', 'small_gicp'}
COMES_WITH = {'setuptools': 'colcon', 'threadpoolctl': 'scikit-learn'}
"""Modules that are there wherever a package of the manifest, or colcon itself, is."""


@pytest.fixture(scope='module')
def manifest(root):
    return ElementTree.parse(root / 'package.xml').getroot()


def requirements_of(package):
    """Top-level modules of others that a package's files import."""
    names = set()
    for path in package.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.partition('.')[0])
    return names - sys.stdlib_module_names - {PACKAGE}


def test_manifest_and_setup_agree(root, manifest):
    setup = subprocess.run([sys.executable, 'setup.py', '--name', '--version', '--license'], cwd=root, check=True,
                           capture_output=True, text=True).stdout.split()
    assert setup == [manifest.findtext('name'), manifest.findtext('version'), manifest.findtext('license')]
    assert manifest.get('format') == '3' and manifest.findtext('export/build_type') == 'ament_python'


def test_the_manifest_names_every_package_that_is_imported(root, manifest):
    named = {element.text for element in manifest if element.tag in ('depend', 'exec_depend')}
    imported = requirements_of(root / PACKAGE) | requirements_of(root / 'launch')
    needed = {ROSDEP_KEYS.get(name, name) for name in imported - NO_ROSDEP_KEY - ONLY_COMPARED_WITH}
    assert needed <= named


@pytest.mark.parametrize('command', [None, *COMMANDS])
def test_every_command_prints_the_version_of_the_manifest(manifest, capsys, command):
    with pytest.raises(SystemExit) as ended:
        main([*filter(None, [command]), '--version'])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f'{PACKAGE} {manifest.findtext("version")}\n'


def imported(path):
    """Names of the packages that a file imports, or asks for by name."""
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module]
        elif isinstance(node, ast.Call) and getattr(node.func, 'attr', '') in ('importorskip', 'find_spec'):
            names = [word.value for word in node.args[:1] if isinstance(word, ast.Constant)]
        yield from (name.partition('.')[0] for name in names)


def test_what_the_package_and_the_tests_import_is_named_by_the_manifest_or_by_the_list(root):
    own = {path.stem for folder in ('test', 'scripts') for path in (root / folder).rglob('*.py')}
    own |= {path.name for path in (root / 'scripts').iterdir() if path.is_dir()} | {'dbscan_reg_ros'}
    files = [path for folder in ('test', 'dbscan_reg_ros', 'launch') for path in (root / folder).rglob('*.py')]
    others = {name for path in files for name in imported(path)} - own - sys.stdlib_module_names
    assert {'numpy', 'rclpy', 'rosbags', 'kiss_icp', 'colcon_core'} <= others
    assert others - in_the_manifest(root) - set(COMES_WITH) <= NOT_IN_THE_MANIFEST
    assert not NOT_IN_THE_MANIFEST & in_the_manifest(root)


def test_colcon_chooses_pytest(root):
    """Colcon's own decision, by what setup.py requires for tests; otherwise it runs unittest and finds no test."""
    from colcon_core.task.python.test import has_test_dependency
    from colcon_python_setup_py.package_identification.python_setup_py import get_setup_information
    assert has_test_dependency(get_setup_information(root / 'setup.py'), 'pytest')

