# SPDX-License-Identifier: Apache-2.0
"""Version, placeholders, citation, container and templates agree with each other."""
import re
import xml.etree.ElementTree as ElementTree

import pytest
import yaml


@pytest.fixture(scope='module')
def placeholders(root):
    return yaml.safe_load((root / '.github' / 'placeholders.yml').read_text())


@pytest.fixture(scope='module')
def manifest(root):
    return ElementTree.parse(root / 'package.xml').getroot()


@pytest.fixture(scope='module')
def citation(root):
    return yaml.safe_load((root / '.github' / 'CITATION.cff').read_text())


def test_the_version_is_written_where_a_release_raises_it_and_its_changes_are_listed(root, manifest, citation):
    version = manifest.findtext('version')
    assert re.fullmatch(r'\d+\.\d+\.\d+', version)
    assert f"version='{version}'" in (root / 'setup.py').read_text()
    assert 'version' not in citation and version not in (root / 'README.md').read_text()
    newest = re.search(r'^(.+)\n-+\n\* ', (root / 'CHANGELOG.rst').read_text(), re.MULTILINE)[1]
    assert newest == 'Forthcoming' or re.fullmatch(rf'{re.escape(version)} \(\d{{4}}-\d\d-\d\d\)', newest)


def test_what_is_not_known_yet_is_in_one_file(root, placeholders, manifest, citation):
    maintainer, email = placeholders['maintainer'], placeholders['email']
    assert (manifest.findtext('maintainer'), manifest.find('maintainer').get('email')) == (maintainer, email)
    assert manifest.findtext('author') == maintainer and citation['authors'] == [{'name': maintainer}]
    project = (root / 'pyproject.toml').read_text()
    assert f'maintainers = [{{name = "{maintainer}", email = "{email}"}}]' in project
    assert re.findall(r'^\* (.*)$', (root / '.github' / 'CODEOWNERS').read_text(), re.MULTILINE) == [email]
    addresses = [*filter(None, (placeholders['repository'], placeholders['documentation']))]
    assert [url.text for url in manifest.findall('url')] == addresses
    assert all(f'"{address}"' in project for address in addresses)


def test_the_authors_of_the_paper_are_those_of_the_citation_in_readme(root, citation):
    cited = re.search(r'author = {([^}]*)}', (root / 'README.md').read_text())[1]
    authors = citation['preferred-citation']['authors']
    assert len(authors) == 10
    assert re.split(r'\s+and\s+', cited) == [f"{each['family-names']}, {each['given-names']}" for each in authors]


def test_workflows_name_what_is_there(root):
    for path in (root / '.github' / 'workflows').glob('*.yml'):
        steps = [step for job in yaml.safe_load(path.read_text())['jobs'].values() for step in job['steps']]
        assert all('run' in step or '@v' in step['uses'] for step in steps)
        for file in re.findall(r'scripts/[\w./]+', path.read_text()):
            assert (root / file).exists(), file
