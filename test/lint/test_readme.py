# SPDX-License-Identifier: Apache-2.0
"""What the README points to exists."""
import re

import pytest

from dbscan_reg_ros.command_lines import COMMANDS


@pytest.fixture(scope='module')
def readme(root):
    return (root / 'README.md').read_text()


def test_every_link_into_the_project_leads_somewhere(root, readme):
    links = [link for link in re.findall(r'\]\(([^)#]+)\)', readme) if '://' not in link]
    assert links and all((root / link).exists() for link in links), links


def test_every_script_is_there_and_can_be_run(root, readme):
    scripts = set(re.findall(r'\bscripts/\w+', readme))
    assert scripts >= {'scripts/demo', 'scripts/test'}
    assert all((root / script).stat().st_mode & 0o111 for script in scripts)


def test_every_launch_file_is_there(root, readme):
    files = set(re.findall(r'[\w.]+\.launch\.py', readme))
    assert files and all((root / 'launch' / file).exists() for file in files)


def test_every_command_has_its_line(readme):
    table = readme.partition('## Commands')[2].partition('##')[0]
    assert set(re.findall(r'^\| `(\w+)', table, re.MULTILINE)) == set(COMMANDS)
