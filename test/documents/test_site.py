# SPDX-License-Identifier: Apache-2.0
"""The site of the documents is built without a warning, and the notebook runs; both with the versions of .venv-docs."""
import json
import os
import re
import subprocess

import pytest

RUN = """
import sys
import nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(notebook, timeout=120).execute()
nbformat.write(notebook, sys.argv[2])
"""


@pytest.fixture
def docs_python(root):
    """The interpreter that has sphinx and nbclient."""
    python = root / '.venv-docs' / 'bin' / 'python'
    if not python.exists():
        pytest.skip('needs .venv-docs, which scripts/test --long makes')
    return python


def run(root, *words):
    """Run a command with the package on the path; its output."""
    variables = os.environ | {'PYTHONPATH': str(root), 'DBSCAN_REG_PURE': '1'}
    # A notebook draws into its own page.
    variables.pop('MPLBACKEND', None)
    done = subprocess.run(words, env=variables,
                          capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_site_is_built_without_a_warning(root, docs_python, tmp_path):
    run(root, docs_python, '-m', 'sphinx', '-q', '-W', '--keep-going', '-b', 'html', root / 'doc', tmp_path / 'site')
    pages = {path.stem for path in (tmp_path / 'site').glob('*.html')}
    assert {'index', 'api', *(path.stem for path in (root / 'doc').glob('*.md'))} <= pages
    api = (tmp_path / 'site' / 'api.html').read_text()
    from dbscan_reg_ros import __all__ as public
    assert [name for name in public if f'id="dbscan_reg_ros.{name}"' not in api] == []


def test_the_notebook_has_no_outputs_and_runs(root, docs_python, tmp_path):
    path = root / 'doc' / 'examples' / 'first_registration.ipynb'
    cells = [cell for cell in json.loads(path.read_text())['cells'] if cell['cell_type'] == 'code']
    assert [cell['outputs'] for cell in cells] == [[]] * len(cells)
    assert {cell['execution_count'] for cell in cells} == {None}
    run(root, docs_python, '-c', RUN, path, tmp_path / 'run.ipynb')
    outputs = [output for cell in json.loads((tmp_path / 'run.ipynb').read_text())['cells']
               for output in cell.get('outputs', ())]
    texts = ''.join(''.join(output['text']) for output in outputs if output['output_type'] == 'stream')
    x, y = map(float, re.search(r'SE2\(x=(\S+), y=(\S+),', texts).groups())
    assert 'status ok' in texts and (x, y) == pytest.approx((0.4, 0.1), abs=1e-3)
    assert sum('image/png' in output.get('data', ()) for output in outputs) == 6
