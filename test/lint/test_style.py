# SPDX-License-Identifier: Apache-2.0
"""What reads the source before it runs: the same tools in the same versions wherever they are called."""
import os
import re
import subprocess
import sys

import pytest


def locked(root):
    """Name -> version, of what scripts/requirements/style.txt pins; that of numpy depends on the Python."""
    text = (root / 'scripts' / 'requirements' / 'style.txt').read_text()
    return dict(re.findall(r'^([a-z-]+)==([\w.]+)', text, re.MULTILINE))


def test_the_hook_and_the_tests_run_the_same_versions(root):
    hooks = re.findall(r'additional_dependencies: \[(.*)\]', (root / '.pre-commit-config.yaml').read_text())
    wanted = {word for hook in hooks for word in hook.split(', ')}
    named = {line for line in (root / 'scripts/requirements/style.in').read_text().splitlines()
             if not line.startswith('#')}
    assert named == wanted and len(wanted) == 4
    pinned = {f'{name}=={version}' for name, version in locked(root).items()}
    assert {word for word in wanted if '==' in word} <= pinned


def test_the_stubs_say_what_the_compiled_modules_have(root):
    """What only compiled modules use of each other is in no stub."""
    tools = root / '.venv-style' / 'bin'
    if not tools.is_dir() or subprocess.run([tools / 'python', '-V'], capture_output=True, text=True,
                                            check=True).stdout.split()[1] != sys.version.split()[0]:
        pytest.skip('needs scripts/test lint, with the version of Python that runs the tests')
    modules = ['.'.join(path.relative_to(root).with_suffix('').parts)
               for path in (root / 'dbscan_reg_ros').rglob('*.pyi')]
    options = ['--concise', '--ignore-missing-stub', '--ignore-disjoint-bases']
    found = subprocess.run([tools / 'stubtest', *options, *modules], cwd=root, capture_output=True, text=True,
                           env=os.environ | {'PYTHONPATH': str(root)}, timeout=300, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def test_programs_of_users_pass_a_strict_type_checker(root):
    mypy = root / '.venv-style' / 'bin' / 'mypy'
    if not mypy.exists():
        pytest.skip('needs scripts/test lint')
    options = ['--strict', '--config-file=', '--follow-imports=silent', '--ignore-missing-imports']
    found = subprocess.run([mypy, *options, *sorted((root / 'doc' / 'examples').glob('*.py'))], cwd=root,
                           capture_output=True, text=True, timeout=300, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def sources(root):
    """What the licence stands in: Python, Cython, shell and CMake."""
    for folder in ('.ci', 'dbscan_reg_ros', 'launch', 'scripts', 'test'):
        for path in (root / folder).rglob('*'):
            if path.is_file() and '__pycache__' not in path.parts and (path.suffix in ('', '.py', '.pyx', '.pxd',
                                                                                       '.pyi')
                                                                       or path.name == 'CMakeLists.txt'):
                yield path
    yield root / 'setup.py'


def test_every_source_file_begins_with_its_licence(root):
    """On the first line, or on the second after that of the interpreter."""
    files = list(sources(root))
    assert len(files) > 300

    def begins(path):
        lines = path.read_text().splitlines()
        return lines[lines[0].startswith('#!'):][:1] == ['# SPDX-License-Identifier: Apache-2.0']
    assert sorted(str(path.relative_to(root)) for path in files if not begins(path)) == []
