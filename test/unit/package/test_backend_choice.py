# SPDX-License-Identifier: Apache-2.0
"""The compiled steps are never used when their sources have changed, and the environment can choose the reference."""
import os
import re
import shutil
import subprocess
import sys

import pytest

from dbscan_reg_ros import backend_choice

PACKAGE = 'dbscan_reg_ros'


@pytest.fixture
def fresh_choice(monkeypatch):
    """Choose again during the test."""
    for chosen in (backend_choice.choose, backend_choice.compiled_backend):
        chosen.cache_clear()
    yield monkeypatch
    for chosen in (backend_choice.choose, backend_choice.compiled_backend):
        chosen.cache_clear()


def test_steps_of_other_sources_are_not_used(fresh_choice):
    if backend_choice.compiled_backend() is None:
        pytest.skip('the compiled steps are not built')
    backend_choice.compiled_backend.cache_clear()
    fresh_choice.setattr(backend_choice, 'source_hash', lambda: 'another')
    fresh_choice.delenv(backend_choice.PURE, raising=False)
    with pytest.warns(RuntimeWarning, match='built from other sources: the slower numpy reference runs'):
        assert backend_choice.choose().name == 'reference'


def test_steps_that_refer_to_a_name_that_is_gone_are_not_used(root, tmp_path):
    """They are loaded before their hash can be compared."""
    if backend_choice.compiled_backend() is None:
        pytest.skip('the compiled steps are not built')
    shutil.copytree(root / PACKAGE, tmp_path / PACKAGE, ignore=shutil.ignore_patterns('__pycache__'))
    module = tmp_path / PACKAGE / 'core' / 'registration' / 'translation.py'
    module.write_text(re.sub(r'\b(_END_WEIGHT)\b', r'\1_OF_TODAY', module.read_text()))
    done = subprocess.run([sys.executable, '-c', 'from dbscan_reg_ros.backend_choice import compiled_backend; '
                           'print(compiled_backend())'], cwd=tmp_path, env=os.environ | {'PYTHONPATH': str(tmp_path)},
                          capture_output=True, text=True, check=False)
    assert done.stdout == 'None\n'
    assert 'built from other sources: the slower numpy reference runs' in done.stderr


@pytest.mark.parametrize(('value', 'names'), [('1', ['reference']), ('0', ['compiled', 'reference']),
                                              ('', ['compiled', 'reference'])])
def test_the_environment_chooses_the_reference(fresh_choice, value, names):
    fresh_choice.setenv(backend_choice.PURE, value)
    assert backend_choice.choose().name in names

