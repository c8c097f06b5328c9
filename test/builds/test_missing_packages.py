# SPDX-License-Identifier: Apache-2.0
"""The tests themselves, with only what the manifest names.

All are found, and those that need more are skipped with a reason.
"""
import os
import re
import subprocess
import sys

import pytest
from manifest import NOT_IN_THE_MANIFEST


@pytest.fixture
def run_tests(root):
    """``run_tests(hidden, *words) -> result`` of pytest in a process of its own in which packages are hidden."""
    def run_tests(hidden, *words):
        variables = os.environ | {
            'WITHOUT_PACKAGES': ' '.join(hidden), 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'PYTEST_ADDOPTS': '',
            'PYTHONPATH': os.pathsep.join(filter(None, [str(root / 'test' / 'without'), os.environ.get('PYTHONPATH')]))}
        return subprocess.run([sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '-q', *words], cwd=root,
                              env=variables,
                              capture_output=True, text=True, timeout=300, check=False)
    return run_tests


def test_every_file_of_tests_is_collected_without_what_the_manifest_does_not_name(run_tests):
    result = run_tests(NOT_IN_THE_MANIFEST, '--collect-only')
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr
    assert int(re.search(r'(\d+) tests collected', result.stdout).group(1)) > 1000


@pytest.mark.parametrize('test', [
    'recordings/test_recordings.py::test_a_bag_without_scans_is_refused',
    'recordings/test_convert.py::test_the_command_says_what_it_wrote',
])
def test_a_test_that_needs_a_package_is_skipped_with_its_name(run_tests, test):
    result = run_tests(['rosbags'], f'test/{test}')
    assert result.returncode == 0 and '1 skipped' in result.stdout, result.stdout
    assert 'needs the Python package rosbags' in result.stdout


def test_hidden_packages_are_as_if_not_installed_in_children_as_well(root):
    code = ('import importlib.util, subprocess, sys\n'
            'print(importlib.util.find_spec("yaml"), importlib.util.find_spec("numpy") is not None, flush=True)\n'
            'sys.exit(subprocess.run([sys.executable, "-c", "import yaml.nodes"], capture_output=True).returncode)')
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False,
                            env=os.environ | {'WITHOUT_PACKAGES': 'yaml', 'PYTHONPATH': str(root / 'test' / 'without')})
    assert (result.stdout, result.returncode) == ('None True\n', 1)
