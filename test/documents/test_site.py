# SPDX-License-Identifier: Apache-2.0
"""The site of the documents, in a browser as well, and the notebook, with the versions of .venv-docs."""
import json
import os
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

RUN = """
import sys
import nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(notebook, timeout=120).execute()
nbformat.write(notebook, sys.argv[2])
"""


@pytest.fixture(scope='session')
def docs_python(root):
    """The interpreter that has sphinx and nbclient."""
    python = root / '.venv-docs' / 'bin' / 'python'
    if not python.exists():
        pytest.skip('needs .venv-docs, which scripts/test --long makes')
    return python


def run(root, *words):
    """Run a command with the package on the path; its output."""
    variables = os.environ | {'PYTHONPATH': str(root)}
    # A notebook draws into its own page.
    variables.pop('MPLBACKEND', None)
    done = subprocess.run(words, env=variables,
                          capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


class Page(HTMLParser):
    """What a page links to and shows, its anchors, and its text outside code."""

    def __init__(self, path):
        super().__init__()
        self.links, self.anchors, self.text, self._code = [], {''}, '', 0
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name == 'id':
                self.anchors.add(value)
            elif name in ('href', 'src'):
                self.links.append(value)
        self._code += tag in ('code', 'pre')

    def handle_endtag(self, tag):
        self._code -= tag in ('code', 'pre')

    def handle_data(self, data):
        self.text += '' if self._code else data


def faults(site):
    """What is wrong on the pages of a site: (page, link without a target) or (page, mark of an equation or of code)."""
    pages = {path: Page(path) for path in site.rglob('*.html')}
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = pages[target].anchors if target in pages else {''}
            if not parts.netloc and (not target.exists() or unquote(parts.fragment) not in anchors):
                yield path.stem, link
        yield from ((path.stem, mark) for mark in re.findall(r'\$\$|`', page.text))


@pytest.fixture(scope='session')
def site(root, docs_python, tmp_path_factory):
    """The folder of the site, which is built without a warning."""
    folder = tmp_path_factory.mktemp('site')
    run(root, docs_python, '-m', 'sphinx', '-q', '-W', '--keep-going', '-b', 'html', root / 'doc', folder)
    return folder


def test_every_document_is_a_page_without_a_dead_link(root, site):
    sources = {path.relative_to(root / 'doc').with_suffix('.html') for path in (root / 'doc').glob('**/*.md')}
    assert sources | {Path('api.html')} <= {path.relative_to(site) for path in site.rglob('*.html')}
    assert list(faults(site)) == []
    equations = re.findall(r'^ *\$\$', (root / 'doc' / 'method.md').read_text(), re.MULTILINE)
    assert (site / 'method.html').read_text().count('display="block"') == len(equations) > 0
    from dbscan_reg_ros import __all__ as public
    api = (site / 'api.html').read_text()
    assert [name for name in public if f'id="dbscan_reg_ros.{name}"' not in api] == []


PROGRAM = """
from dbscan_reg_ros import Localizer, Map, Odometry, Parameters, Prior, Scan, SE2, open_recording, register
odometry, localizer = Odometry(Parameters()), Localizer(Map.load('map.npz'))
for scan in open_recording('drive').scans():
    update = odometry.process(scan, Prior(SE2(), covariance))
    found = localizer.process(update)
for pose, probability in found.hypotheses:
    pass
"""
COMPLETED = {
    'scan': 'ranges stamp', 'update': 'pose covariance registration', 'found': 'state pose covariance transform',
    'found.state': 'LOCALISED', 'found.pose': 'x theta', 'pose': 'inverse', 'Map': 'load save', 'SE2()': 'as_matrix',
    'register(scan, scan)': 'status transform', 'Scan': 'from_ranges from_points', 'Parameters()': 'replace',
}
COMPLETE = """
import json, sys
import jedi
program, places = json.load(sys.stdin)
project = jedi.Project(sys.argv[1])
print(json.dumps({place: [each.name for each in jedi.Script(f'{program}{place}.', project=project).complete()]
                  for place in places}))
"""


def test_an_editor_completes_what_programs_of_users_use(root, docs_python):
    done = subprocess.run([docs_python, '-c', COMPLETE, root], input=json.dumps([PROGRAM, list(COMPLETED)]), text=True,
                          capture_output=True, timeout=300, check=True)
    found = json.loads(done.stdout)
    assert [f'{place}.{name}' for place, names in COMPLETED.items() for name in names.split()
            if name not in found[place]] == []


WIDTH = """Math.max(...[document.documentElement, ...document.querySelectorAll(".content")].map(e => e.scrollWidth))"""
"""The theme scrolls what is wider than the screen in the box of the content."""


@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1400, 900)])
def test_no_page_is_wider_than_the_screen(site, started_browser, width, height):
    started_browser.screen(width, height)
    widths = {}
    for page in site.rglob('*.html'):
        started_browser.open(page.as_uri())
        widths[page.relative_to(site).as_posix()] = started_browser.value(WIDTH)
    assert {page for page, pixels in widths.items() if pixels > width} == set() and len(widths) > 20
    assert started_browser.complaints == []


def test_the_notebook_holds_what_it_prints_and_draws(root, docs_python, tmp_path):
    """Made anew with ``jupyter nbconvert --to notebook --execute --inplace doc/examples/first_registration.ipynb``."""
    path = root / 'doc' / 'examples' / 'first_registration.ipynb'
    run(root, docs_python, '-c', RUN, path, tmp_path / 'run.ipynb')
    stored, made = ([output for cell in json.loads(each.read_text())['cells'] for output in cell.get('outputs', ())]
                    for each in (path, tmp_path / 'run.ipynb'))
    texts, expected = (''.join(''.join(output['text']) for output in outputs if output['output_type'] == 'stream')
                       for outputs in (stored, made))
    assert texts == expected and 'status ok' in texts and 'x 0.4000 m, y 0.1000 m, theta 0.000 deg' in texts
    for outputs in (stored, made):
        assert sum('image/png' in output.get('data', ()) for output in outputs) == 6
