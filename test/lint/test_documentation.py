# SPDX-License-Identifier: Apache-2.0
"""The documents agree with the source and with each other."""
import re
from pathlib import Path

import pytest

import dbscan_reg_ros
from dbscan_reg_ros.command_lines import COMMANDS
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted(path.relative_to(ROOT).as_posix() for pattern in ('README.md', '.github/*.md', 'doc/**/*.md')
                   for path in ROOT.glob(pattern))


def anchors(text):
    """The names under which the headings of a document are linked to."""
    return {re.sub(r'[^\w\- ]', '', heading).strip().lower().replace(' ', '-')
            for heading in re.findall(r'^#+ (.*)$', text, re.MULTILINE)}


@pytest.mark.parametrize('name', DOCUMENTS)
def test_links_lead_somewhere(root, name):
    document = root / name
    for link in re.findall(r'\]\(([^)\s]+)\)', document.read_text()):
        if '://' in link:
            continue
        path, _, anchor = link.partition('#')
        target = (document.parent / path).resolve() if path else document
        assert target.is_relative_to(root) and target.exists(), link
        assert not anchor or anchor in anchors(target.read_text()), link


@pytest.mark.parametrize('index, folder', [('README.md', 'doc'), ('doc/decisions/index.md', 'doc/decisions')])
def test_every_document_is_linked_to_from_the_first_page(root, index, folder):
    links = {(root / index).parent / link for link in re.findall(r'\]\(([^)#]+)', (root / index).read_text())}
    documents = {path for path in (root / folder).glob('*.md') if path.name != 'index.md'}
    assert documents and documents <= links


def test_every_command_has_its_line_in_the_readme(root):
    table = (root / 'README.md').read_text().partition('## Commands')[2].partition('##')[0]
    assert set(re.findall(r'^\| `(\w+)', table, re.MULTILINE)) == set(COMMANDS)


def test_the_architecture_names_every_module_of_the_core_and_every_folder(root):
    text = (root / 'doc' / 'architecture.md').read_text()
    package = root / 'dbscan_reg_ros'
    modules = [*(package / 'core').glob('*.py'), *package.glob('*.py')]
    expected = {path.name for path in modules} - {'__init__.py'}
    assert {name for name in expected if f'`{name}`' not in text} == set()
    folders = {path.parent.name for path in package.glob('*/__init__.py')}
    assert {name for name in folders if f'`{name}/`' not in text and f'/{name}`' not in text} == set()


def test_the_site_describes_every_public_name(root):
    described = re.findall(r'^\.\. auto\w+:: (\w+)$', (root / 'doc' / 'api.rst').read_text(), re.MULTILINE)
    assert sorted(described) == sorted(dbscan_reg_ros.__all__)


@pytest.mark.parametrize('name', DOCUMENTS)
def test_modules_and_tests_that_are_named_exist(root, name):
    text = (root / name).read_text()
    files = {path.name for folder in ('dbscan_reg_ros', 'launch', 'scripts', 'test')
             for path in (root / folder).rglob('*.p*')}
    named = {path.split('/')[-1] for path in re.findall(r'`([\w/.]+\.(?:py|px[di]|pyx))`', text)}
    assert named - files <= {'setup.py'}
    tests = '\n'.join(path.read_text() for path in (root / 'test').rglob('test_*.py'))
    assert {test for test in re.findall(r'`(test_\w+)`', text) if f'def {test}(' not in tests} == set()


@pytest.mark.parametrize('name', DOCUMENTS)
def test_parameters_that_are_named_exist(root, name):
    known = set(NodeParameters().flatten())
    groups = {group for parameter in known for group in parameter.split('.')[:-1]}
    headings = {parameter.rpartition('.')[0] for parameter in known}
    named = set(re.findall(r'`([a-z_]+(?:\.[a-z_]+)+)(?::[^`]*)?`', (root / name).read_text()))
    files = '.py', '.pyx', '.pxd', '.md', '.yaml', '.npz', '.pgm'
    named = {name for name in named if name.split('.')[0] in groups and not name.endswith(files)}
    assert named <= known | headings


@pytest.mark.parametrize('name', DOCUMENTS)
def test_parameter_files_that_are_shown_can_be_read(root, name, tmp_path):
    for block in re.findall(r'^```yaml\n(.*?)^```', (root / name).read_text(), re.MULTILINE | re.DOTALL):
        (tmp_path / 'shown.yaml').write_text(block)
        assert read_parameters(tmp_path / 'shown.yaml') != NodeParameters()
