# SPDX-License-Identifier: Apache-2.0
"""scripts/check_numbers: what counts as a chosen number."""
import subprocess
import sys

import pytest


@pytest.fixture(scope='module')
def count(root):
    """``count(source) -> (parameters, named numbers, unnamed literals)``."""
    namespace = {'__name__': 'check_numbers', '__file__': str(root / 'scripts' / 'check_numbers')}
    exec(compile((root / 'scripts' / 'check_numbers').read_text(), 'check_numbers', 'exec'), namespace)

    def count(source):
        kinds = namespace['count'](source)
        return tuple(kinds[kind] for kind in namespace['KINDS'])
    return count


@pytest.mark.parametrize(('source', 'numbers'), [
    ("class P:\n    a: float = parameter(0.3, 'help', 'm', 0.0, 9.0)\n    b: bool = parameter(True, 'help')",
     (2, 0, 0)),
    ("class P:\n    a: tuple = parameter((0.3, 0.2, 0.0), 'help')", (3, 0, 0)),
    ('SIZE = 2\nRATIO = 3 * math.pi / 180\nTABLE = np.array([1.5, 2.5, 3.5])\nNAME = "2"', (0, 5, 0)),
    ('def f(a, b=3, *, c=0.5, d=None, e=True): return a', (0, 2, 0)),
    ('def f(a):\n    return 0 * a + 1 - 2.0 * a[-1] / -0.5 + 2 ** a', (0, 0, 0)),
    ('def f(a):\n    limit = 0.35\n    return a[3] < limit or a > -1.5', (0, 0, 3)),
    ('class Status(enum.IntEnum):\n    OK = 3\n    def f(self): return self > 7', (0, 0, 1)),
])
def test_each_kind_of_number_is_counted(count, source, numbers):
    assert count(source) == numbers


@pytest.mark.parametrize(('limit', 'status'), [('100', 0), ('99', 1)])
def test_a_tree_has_all_of_its_own_numbers(root, tmp_path, limit, status):
    (tmp_path / 'scripts').mkdir()
    (tmp_path / 'scripts' / 'check_numbers').write_text((root / 'scripts' / 'check_numbers').read_text())
    (tmp_path / 'core').mkdir()
    (tmp_path / 'core' / 'one.py').write_text('SIZE = 7\n')
    git = ('git', '-c', 'user.name=a', '-c', 'user.email=a@b', '-C', tmp_path)
    for command in (('init', '-q'), ('add', '-A'), ('commit', '-qm', 'One')):
        subprocess.run([*git, *command], check=True)
    script = tmp_path / 'scripts' / 'check_numbers'
    done = subprocess.run([sys.executable, script, 'core', '--against', 'HEAD', '--at-most', limit],
                          capture_output=True,
                          text=True, check=False, timeout=60)
    assert done.returncode == status and done.stdout.endswith('1 of 1 numbers: 100.0 %\n')
