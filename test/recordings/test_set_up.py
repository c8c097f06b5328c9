# SPDX-License-Identifier: Apache-2.0
"""The set-up that the demo and the tests share: it finds a Python that serves, or says what is missing."""
import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

BROKEN = '#!/bin/sh\necho "command not found here" >&2\nexit 127\n'
OLD = '#!/bin/sh\n[ "$1" = --version ] && { echo "Python 3.9.2"; exit; }\n[ "$2" = "" ]\n'
BARE = '#!/bin/sh\ncase "$2" in *ensurepip*) exit 1;; esac\n'
GOOD = f'#!/bin/sh\nexec {sys.executable} "$@"\n'


@pytest.fixture
def programs(tmp_path):
    """``programs(name=script, ...)``: a PATH with these and the ordinary tools, but no other Python."""
    folder = tmp_path / 'bin'
    folder.mkdir()
    for tool in ('bash', 'cat', 'cut', 'dirname', 'sh', 'sha256sum', 'uname', 'rm', 'mkdir', 'mv', 'chmod',
                 'find', 'sort', 'xargs', 'tail'):
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
    return shell("find_python '3, 13' 'import ensurepip, venv'", scripts)


@pytest.mark.parametrize('name', ['python3.10', 'python3'])
def test_each_candidate_is_found(shell, name):
    result = find(shell, {name: GOOD})
    assert (result.returncode, result.stdout) == (0, f'{sys.executable}\n')


@pytest.mark.parametrize('bad', [BROKEN, OLD, BARE], ids=['broken', 'old', 'bare'])
def test_a_candidate_that_does_not_serve_is_passed_over(shell, bad):
    result = find(shell, {'python3.12': bad, 'python3.11': bad, 'python3': GOOD})
    assert (result.returncode, result.stdout, result.stderr) == (0, f'{sys.executable}\n', '')


def test_without_a_python_the_message_says_what_each_lacks(shell):
    result = find(shell, {'python3.12': BROKEN, 'python3.11': BARE, 'python3': OLD})
    assert result.returncode == 1 and result.stdout == ''
    assert result.stderr.splitlines() == [
        'No Python that serves. Needed: Python 3.10 to 3.13 that can make virtual environments',
        '(Debian and Ubuntu: apt-get install python3 python3-venv). Tried:',
        '  python3.12 is there but does not run',
        "  python3.11 fails at 'import ensurepip, venv'",
        '  python3.13 is not there',
        '  python3.10 is not there',
        '  python3 is Python 3.9.2']


def test_the_demo_of_a_fresh_copy_ends_with_that_message(root, programs, tmp_path):
    shutil.copytree(root / 'scripts', tmp_path / 'scripts')
    result = subprocess.run(['bash', tmp_path / 'scripts' / 'demo'], env={'PATH': programs({})}, capture_output=True,
                            text=True, check=False, timeout=60)
    assert result.returncode == 1 and result.stdout == ''
    assert result.stderr.startswith('No Python that serves. Needed: Python 3.10 to 3.13')


FAKE_STEPS = '''
install() { echo "install ${2##*/}"; test -e "$1/fail" && return 1 || return 0; }
'''
FAKE_PYTHON = '''#!/bin/sh
case "$2" in
    *sys.executable*) echo "$0";;
    venv) for folder; do :; done; mkdir -p "$folder/bin"; cat "$0" > "$folder/bin/python"; chmod +x "$folder/bin/python"
          echo venv;;
esac
'''


@pytest.fixture
def make(shell, programs, tmp_path):
    """``make(step)``: the set-up's steps with an installer that only says what it would do."""
    venv = tmp_path / 'venv'
    (tmp_path / 'wanted.txt').write_text('one==1\n')
    (tmp_path / 'more.txt').write_text('two==2\n')

    def make(more=False):
        code = f'{FAKE_STEPS}\nmake_venv {venv} {tmp_path}/wanted.txt "3, 13" ""'
        if more:
            code += f'\nadd_requirements {venv} {tmp_path}/more.txt'
        return shell(code, {'python3': FAKE_PYTHON}).stdout.split('\n')[:-1]
    make.venv, make.folder = venv, tmp_path
    return make


def test_an_environment_is_made_once(make):
    assert make() == ['venv', 'install wanted.txt']
    assert make() == []


def test_an_environment_is_made_again_when_its_requirements_change(make):
    make()
    (make.folder / 'wanted.txt').write_text('one==2\n')
    assert make() == ['venv', 'install wanted.txt']


def test_an_interrupted_environment_is_made_again(make):
    make()
    (make.venv / 'stamps' / 'base').unlink()
    assert make() == ['venv', 'install wanted.txt']
    assert make() == []


def test_an_interrupted_addition_is_repaired_from_the_ground_up(make):
    make()
    (make.venv / 'fail').touch()
    assert make(more=True) == ['install more.txt']
    assert make(more=True) == ['venv', 'install wanted.txt', 'install more.txt']
    assert make(more=True) == []


def wheel(folder, name, version, *metadata):
    """Write an empty package; return the line of a lock that names it."""
    path, info = folder / f'{name}-{version}-py3-none-any.whl', f'{name}-{version}.dist-info'
    with zipfile.ZipFile(path, 'w') as archive:
        archive.writestr(f'{info}/METADATA',
                         '\n'.join(('Metadata-Version: 2.1', f'Name: {name}', f'Version: {version}', *metadata)))
        archive.writestr(f'{info}/WHEEL', 'Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n')
        archive.writestr(f'{info}/RECORD', '')
    return f'{name}=={version} --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n'


def test_a_lock_still_installs_when_newer_versions_have_come(root, tmp_path):
    tool = wheel(tmp_path, 'tool', '1.0', 'Provides-Extra: more')
    plugin = wheel(tmp_path, 'plugin', '1.0', 'Requires-Dist: tool[more]>=0.9')
    wheel(tmp_path, 'tool', '2.0', 'Provides-Extra: more')
    (tmp_path / 'lock.txt').write_text(plugin + tool)
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', tmp_path / 'venv'], check=True)
    packages, = (tmp_path / 'venv').glob('lib/python*/site-packages')
    (packages / 'pip').symlink_to(Path(sysconfig.get_paths()['purelib'], 'pip'))
    result = subprocess.run(['bash', '-c', f'source {root}/scripts/setup; install {tmp_path}/venv {tmp_path}/lock.txt'],
                            env={'PATH': '/usr/bin:/bin', 'PIP_NO_INDEX': '1', 'PIP_FIND_LINKS': str(tmp_path)},
                            capture_output=True, text=True, check=False, timeout=120)
    assert (result.returncode, result.stderr) == (0, '')
    assert [*(tmp_path / 'venv').glob('lib/python*/site-packages/tool-1.0.dist-info')]


def test_an_installation_reports_its_progress_and_fails_as_pip_does(root, tmp_path):
    (tmp_path / 'lock.txt').write_text('one==1\ntwo==2\nthree==3\n')
    pip = tmp_path / 'venv' / 'bin' / 'python'
    pip.parent.mkdir(parents=True)
    pip.write_text('#!/bin/sh\nfor k in one two three; do echo "Collecting $k"; done\n'
                   'echo "Installing collected packages: one two three"\necho "ERROR: $STATUS" >&2\nexit $STATUS\n')
    pip.chmod(0o755)
    for options, status in (('', 0), ('', 1), ('set -euo pipefail; ', 0), ('set -euo pipefail; ', 1)):
        code = f'{options}source {root}/scripts/setup; EACH=2; install {tmp_path}/venv {tmp_path}/lock.txt'
        done = subprocess.run(['bash', '-c', code], env={'PATH': '/usr/bin:/bin', 'STATUS': str(status)}, text=True,
                              capture_output=True, check=False, timeout=60)
        lines = [line for line in done.stderr.splitlines() if not line.startswith('ERROR')]
        assert (done.returncode, done.stdout) == (status, '')
        assert lines[:2] == ['  2 of 3 packages fetched', '  unpacking 3 packages ...']
        assert [line[:17] for line in lines[2:]] == ['Could not install'] * status


FAKE_BUILD = '''#!/bin/sh
case "$1" in
    -c) case "$2" in *Python.h*) echo "$HEADER";; esac;;
    */build.py) echo tried >> "$0.tries"; echo "no compiler here"; exit 1;;
esac
'''


@pytest.fixture
def add_tf2_msgs(shell, root, tmp_path):
    """``add_tf2_msgs(variables)``: the message of a failed build of tf2_msgs, and the number of builds so far."""
    venv = tmp_path / "robot's venv"
    (venv / 'bin').mkdir(parents=True)
    (venv / 'bin' / 'python').write_text(FAKE_BUILD)
    (venv / 'bin' / 'python').chmod(0o755)
    (venv / 'stamps').mkdir()
    (venv / 'stamps' / 'base').write_text('whole')

    def add_tf2_msgs(variables='HEADER=False', scripts=None):
        result = shell(f'export {variables}; add_tf2_msgs "{venv}"', scripts or {})
        assert (result.returncode, result.stdout) == (0, '') and (venv / 'stamps' / 'base').exists(), result.stderr
        *building, said = result.stderr.splitlines(keepends=True)
        add_tf2_msgs.building += len(building)
        tries = (venv / 'bin' / 'python.tries').read_text().count('tried')
        assert add_tf2_msgs.building == tries, 'it announces each build'
        return said, tries
    add_tf2_msgs.building = 0
    add_tf2_msgs.failed = venv / 'stamps' / 'tf2_msgs_failed'
    return add_tf2_msgs


def test_a_failed_build_is_tried_again_when_asked_for_or_when_something_has_changed(add_tf2_msgs):
    said, tries = add_tf2_msgs()
    assert said.startswith('Going on without /tf: no compiler here (to try again: rm ') and tries == 1
    assert add_tf2_msgs() == (said, 1) and add_tf2_msgs() == (said, 1)
    subprocess.run(['bash', '-c', said.rpartition('to try again: ')[2].rstrip(')\n')], check=True)
    assert add_tf2_msgs() == (said, 2)
    assert add_tf2_msgs('HEADER=True') == (said, 3) and add_tf2_msgs('HEADER=True') == (said, 3)
    assert add_tf2_msgs('HEADER=True', {'c++': '#!/bin/sh\necho one\n'}) == (said, 4)
    assert add_tf2_msgs('HEADER=True', {'c++': '#!/bin/sh\necho newer\n'}) == (said, 5)


@pytest.mark.long
def test_tf2_msgs_is_built_below_a_path_with_an_apostrophe(root, tmp_path):
    """In a tree of links to the files of the environment that runs the tests."""
    if not (Path(sys.prefix) / 'share' / 'rosidl_generator_py').is_dir() or shutil.which('c++') is None:
        pytest.skip('needs the wheels of ROS 2 and a C++ compiler')
    venv = tmp_path / "robot's" / 'venv'
    venv.parent.mkdir()
    subprocess.run(['cp', '-rs', sys.prefix, venv], check=True)
    for path in (*venv.rglob('*tf2_msgs*'), venv / 'pyvenv.cfg'):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    shutil.copy(Path(sys.prefix) / 'pyvenv.cfg', venv)
    environment = {name: value for name, value in os.environ.items() if name != 'PYTHONPATH'}
    built = subprocess.run([venv / 'bin' / 'python', root / 'scripts' / 'tf2_msgs' / 'build.py'], capture_output=True,
                           text=True,
                           env=environment, timeout=300, check=False)
    assert built.returncode == 0, (venv / 'tf2_msgs.log').read_text()[-2000:]
    code = ('from tf2_msgs import msg; from rclpy.serialization import serialize_message; print(msg.__file__);'
            'print(len(serialize_message(msg.TFMessage())))')
    said = subprocess.run([venv / 'bin' / 'python', '-c', code], capture_output=True, text=True, env=environment,
                          check=True,
                          timeout=60).stdout.splitlines()
    assert said[0].startswith(str(venv)) and said[1] == '8'
    assert not any('/prefix' in path.read_text() for path in (venv / 'share' / 'tf2_msgs').rglob('*.*sh'))


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
        path = programs({'python3': FAKE_BUILDER, 'cc': '#!/bin/sh\n',
                         'grep': f'#!/bin/sh\nexec {shutil.which("grep")} "$@"\n'})
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
