# SPDX-License-Identifier: Apache-2.0
"""The set-up that the demo and the tests share: it finds a Python that serves, or says what is missing."""
import re
import shutil
import subprocess
import sys

import pytest

OLD = f'#!/bin/sh\nexec {sys.executable} -c "raise SystemExit(\'AssertionError: 3.9.2\')"\n'
BARE = '#!/bin/sh\ncase "$2" in *ensurepip*) echo "No module named ensurepip" >&2; exit 1;; esac\n'
GOOD = f'#!/bin/sh\nexec {sys.executable} "$@"\n'


@pytest.fixture
def programs(tmp_path):
    """``programs(name=script, ...)``: a PATH with these and the ordinary tools, but no other Python."""
    folder = tmp_path / 'bin'
    folder.mkdir()
    for tool in ('bash', 'cat', 'cut', 'dirname', 'sh', 'sha256sum', 'uname', 'rm', 'mkdir', 'mv', 'chmod',
                 'find', 'sort', 'xargs', 'tail', 'touch', 'grep'):
        (folder / tool).symlink_to(shutil.which(tool))

    def programs(scripts):
        for name, script in scripts.items():
            (folder / name).write_text(script)
            (folder / name).chmod(0o755)
        return str(folder)
    return programs


@pytest.fixture
def shell(root, programs):
    """``shell(code, scripts)``: run bash code after the set-up was sourced."""
    def shell(code, scripts):
        return subprocess.run(['bash', '-c', f'set -euo pipefail; source {root}/scripts/setup; {code}'], text=True,
                              env={'PATH': programs(scripts)}, capture_output=True, check=False, timeout=60)
    return shell


def find(shell, scripts):
    return shell("find_python 'import ensurepip, venv'", scripts)


@pytest.mark.parametrize('scripts', [{'python3.10': GOOD}, {'python3.12': OLD, 'python3.11': BARE, 'python3': GOOD}])
def test_the_first_python_that_serves_is_found(shell, scripts):
    result = find(shell, scripts)
    assert (result.returncode, result.stdout, result.stderr) == (0, f'{sys.executable}\n', '')


def test_without_a_python_the_message_says_what_each_lacks(shell):
    result = find(shell, {'python3.11': BARE, 'python3': OLD})
    assert result.returncode == 1 and result.stdout == ''
    head, _, *tried = result.stderr.splitlines()
    assert head.startswith('No Python that serves. Needed: Python 3.10 to 3.13')
    reasons = dict(line.split(':', 1) for line in tried)
    assert [*reasons] == ['  python3.12', '  python3.11', '  python3.13', '  python3.10', '  python3']
    assert 'command not found' in reasons['  python3.12'] and 'ensurepip' in reasons['  python3.11']
    assert '3.9.2' in reasons['  python3']


FAKE_PYTHON = '''#!/bin/sh
case "$2" in
    *sys.executable*) echo "$0";;
    venv) for folder; do :; done; mkdir -p "$folder/bin"; cat "$0" > "$folder/bin/python"; chmod +x "$folder/bin/python"
          echo venv;;
esac
'''


@pytest.fixture
def make(shell, tmp_path):
    """``make(more)``: the steps of the set-up, with an installer that says what it would do and fails where told to."""
    (tmp_path / 'wanted.txt').write_text('one==1\n')

    def make(more=False):
        code = f'''root={tmp_path} requirements={tmp_path}
            install() {{ echo "install $2"; ! test -e "$1/fail"; }}
            make_venv venv wanted.txt
            {f'step {tmp_path}/venv more mark install {tmp_path}/venv more.txt' if more else ''}'''
        return [*filter(None, shell(code, {'python3': FAKE_PYTHON}).stdout.splitlines())]
    make.folder = tmp_path
    return make


def test_an_environment_is_made_once_and_again_when_its_requirements_change(make):
    assert make() == ['venv', 'install wanted.txt'] and make() == []
    (make.folder / 'wanted.txt').write_text('one==2\n')
    assert make() == ['venv', 'install wanted.txt'] and make() == []


def test_an_environment_in_which_a_step_was_interrupted_is_made_again(make):
    make()
    (make.folder / 'venv' / 'fail').touch()
    assert make(more=True) == ['install more.txt']
    assert make(more=True) == ['venv', 'install wanted.txt', 'install more.txt'] and make(more=True) == []


@pytest.mark.parametrize('status', [0, 1])
def test_an_installation_fails_as_pip_does_and_says_what_to_do(shell, tmp_path, status):
    (tmp_path / 'lock.txt').write_text('one==1\n')
    python = tmp_path / 'venv' / 'bin' / 'python'
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexit {status}\n')
    python.chmod(0o755)
    done = shell(f'requirements={tmp_path}; install {tmp_path}/venv lock.txt', {})
    assert (done.returncode, done.stdout) == (status, '')
    assert ('Could not install lock.txt' in done.stderr) == bool(status)


def test_without_tf2_msgs_the_set_up_goes_on_and_says_why_until_it_is_built(shell, tmp_path):
    python = tmp_path / 'python'
    (tmp_path / '.venv' / 'stamps').mkdir(parents=True)
    for status, said in ((1, 'Going on without /tf: no compiler here\n'), (0, ''), (1, '')):
        python.write_text(f'#!/bin/sh\necho no compiler here; exit {status}\n')
        python.chmod(0o755)
        result = shell(f'root={tmp_path} python={python}; add_to_wheels run', {})
        assert (result.returncode, result.stdout, result.stderr) == (0, '', said)


FAKE_BUILDER = '''#!/bin/sh
case "$1 $2" in
    "-VV ") echo "Python $VERSION";;
    "setup.py "*)
        echo tried >> "$TRIES"
        test -z "$FAILS" && exit 0
        echo "running build_ext"; echo "dbscan_reg_ros: its compiled modules need $FAILS" >&2; echo done; exit 1;;
esac
'''


@pytest.fixture
def build_steps(programs, root, tmp_path):
    """``build_steps(variables)``: the status of the set-up, its report on the build, and how often it built."""
    copy, tries = tmp_path / 'copy', tmp_path / 'tries'
    for folder in ('scripts', 'dbscan_reg_ros/core/features'):
        shutil.copytree(root / folder, copy / folder, ignore=shutil.ignore_patterns('*.so', '__pycache__'))
    shutil.copy(root / 'setup.py', copy)
    tries.touch()

    def build_steps(version='1', fails=''):
        path = programs({'python3': FAKE_BUILDER, 'cc': '#!/bin/sh\n'})
        result = subprocess.run(['bash', '-c',
                                 f'set -euo pipefail; source {copy}/scripts/setup; python=python3; build_steps'],
                                env={'PATH': path, 'VERSION': version, 'FAILS': fails, 'TRIES': str(tries)},
                                check=False,
                                capture_output=True, text=True, timeout=60)
        assert result.stdout == ''
        return result.returncode, result.stderr, len(tries.read_text().split())
    build_steps.folder = copy
    return build_steps


def test_the_compiled_modules_are_built_once_and_when_their_sources_or_python_change(build_steps):
    building = 'Building the compiled modules: once, some minutes ...\n'
    assert build_steps() == (0, building, 1) and build_steps() == (0, '', 1)
    assert build_steps(version='2') == (0, building, 2)
    with open(build_steps.folder / 'dbscan_reg_ros/core/features/noise.pyx', 'a') as source:
        source.write('# changed\n')
    assert build_steps(version='2') == (0, building, 3) and build_steps(version='2') == (0, '', 3)


def test_a_build_that_fails_ends_the_set_up_with_what_is_missing_and_is_tried_again(build_steps):
    for tries in (1, 2):
        status, said, tried = build_steps(fails='python3-dev')
        assert (status, tried) == (1, tries)
        assert said.splitlines()[1:] == [
            'dbscan_reg_ros: its compiled modules need python3-dev (build/steps.log has all)']


@pytest.mark.parametrize('command, expected', [(('bench', 'loops'), 'usage: bench loops'),
                                               (('demo',), r'usage: \S*/scripts/demo\n')])
def test_the_help_installs_nothing(root, tmp_path, programs, command, expected):
    (tmp_path / 'scripts').mkdir()
    for name in (command[0], 'setup'):
        shutil.copy(root / 'scripts' / name, tmp_path / 'scripts')
    (tmp_path / 'scripts' / 'benchmarks').symlink_to(root / 'scripts' / 'benchmarks')
    (tmp_path / 'dbscan_reg_ros').symlink_to(root / 'dbscan_reg_ros')
    path = programs({'python3': GOOD})
    done = subprocess.run(['bash', tmp_path / 'scripts' / command[0], *command[1:], '--help'], text=True,
                          capture_output=True, env={'PATH': path}, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, '') and re.match(expected, done.stdout)
    assert {file.name for file in tmp_path.iterdir()} == {'bin', 'scripts', 'dbscan_reg_ros'}
