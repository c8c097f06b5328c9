# SPDX-License-Identifier: Apache-2.0
"""What reads the source before it runs: the same tools in the same versions wherever they are called."""
import os
import re
import shutil
import subprocess
import sys

import pytest

SIDE_BY_SIDE = f'-n {min(len(os.sched_getaffinity(0)) + 1, 4)} --dist worksteal'
LONG_ONLY = ['add_browser', 'set_up_docs', 'set_up_evo']
ENDING = '-o faulthandler_timeout=600 -o faulthandler_exit_on_timeout=true'
LONG_TESTS = {'builds': 'test_builds.py', 'documents': 'test_site.py', 'fuzz': 'test_fuzz_scans.py',
              'page': 'test_interaction.py'}


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


@pytest.fixture
def checks(root, tmp_path):
    """``checks(*arguments, ruff=status, mypy=status)``: status of scripts/test with stand-ins, and what ran."""
    shutil.copytree(root / 'scripts', tmp_path / 'scripts')
    with open(tmp_path / 'scripts' / 'setup', 'a') as setup:
        setup.write(f'set_up() {{ python={tmp_path}/python; }}\nset_up_style() {{ style={tmp_path}; }}\n'
                    'set_up_noble() { noble=; }\n')
        setup.writelines(f'{step}() {{ echo {step} >> {tmp_path}/made; }}\n' for step in LONG_ONLY)

    def checks(*words, ruff=0, mypy=0):
        for name, status in (('ruff', ruff), ('mypy', mypy), ('python', 0)):
            (tmp_path / name).write_text(f'#!/bin/sh\necho {name} $* >> {tmp_path}/ran\nexit {status}\n')
            (tmp_path / name).chmod(0o755)
        (tmp_path / 'ran').write_text('')
        done = subprocess.run(['bash', tmp_path / 'scripts' / 'test', *words], capture_output=True, text=True,
                              timeout=60,
                              check=False)
        return done.returncode, (tmp_path / 'ran').read_text().splitlines()
    return checks


def test_what_ruff_or_mypy_finds_fails_the_tests(checks):
    assert checks(ruff=1) == (1, ['ruff check'])
    assert checks(mypy=1) == (1, ['ruff check', 'mypy'])
    assert checks() == (0, ['ruff check', 'mypy', f'python -m pytest {SIDE_BY_SIDE} {ENDING}'])


def test_what_only_long_tests_need_is_made_for_them_alone(checks, tmp_path):
    assert checks() and not (tmp_path / 'made').exists()
    assert checks('--long') == (0, ['ruff check', 'mypy', f'python -m pytest {SIDE_BY_SIDE} --long'])
    assert {*(tmp_path / 'made').read_text().split()} == {*LONG_ONLY}


@pytest.mark.parametrize(('words', 'runs'), [
    ('test', set()), ('test --long', {*LONG_TESTS}), ('test/documents test/fuzz', {'fuzz', 'documents'})])
def test_builds_fuzz_browsers_and_the_site_run_where_they_are_asked_for(root, words, runs):
    others = [f'--ignore=test/{folder}' for folder in ('node', 'recordings', 'unit')]
    found = subprocess.run([sys.executable, '-m', 'pytest', '-q', '--collect-only', '-p', 'no:cacheprovider',
                            *words.split(), *others], cwd=root, capture_output=True, text=True, timeout=300,
                           check=False).stdout
    assert 'test/documents/test_printed.py' in found
    assert runs == {folder for folder, test in LONG_TESTS.items() if f'test/{folder}/{test}' in found}


def test_the_stubs_say_what_the_compiled_modules_have(root):
    """What only compiled modules use of each other is in no stub."""
    tools = root / '.venv-style' / 'bin'
    if not tools.is_dir() or subprocess.run([tools / 'python', '-V'], capture_output=True, text=True,
                                            check=True).stdout.split()[1] != sys.version.split()[0]:
        pytest.skip('needs scripts/test style, with the version of Python that runs the tests')
    modules = ['.'.join(path.relative_to(root).with_suffix('').parts)
               for path in (root / 'dbscan_reg_ros').rglob('*.pyi')]
    options = ['--concise', '--ignore-missing-stub', '--ignore-disjoint-bases']
    found = subprocess.run([tools / 'stubtest', *options, *modules], cwd=root, capture_output=True, text=True,
                           env=os.environ | {'PYTHONPATH': str(root)}, timeout=300, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def test_style_alone_runs_no_test(checks):
    assert checks('style') == (0, ['ruff check', 'mypy'])


@pytest.mark.parametrize('folder', ['unit', 'recordings', 'documents', 'builds', 'page', 'node', 'fuzz', 'long'])
def test_a_folder_of_tests_runs_by_its_name(checks, root, folder):
    assert (root / 'test' / folder).is_dir()
    assert checks(folder, '-k', 'some') == (0, [f'python -m pytest {SIDE_BY_SIDE} test/{folder} -k some'])


def test_other_arguments_go_to_pytest(checks):
    assert checks('test/unit/features', '-x') == (0, ['python -m pytest test/unit/features -x'])


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
