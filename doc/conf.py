# SPDX-License-Identifier: Apache-2.0
"""Settings of sphinx: python -m sphinx -W -b html doc FOLDER makes the site."""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

project = 'dbscan_reg_ros'
author = 'the authors of dbscan_reg_ros'
copyright = author
release = re.search(r'<version>(.*)</version>', (ROOT / 'package.xml').read_text())[1]

extensions = ['myst_parser', 'numpydoc', 'sphinx.ext.autodoc']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}
exclude_patterns = ['examples/*', '_build']
myst_heading_anchors = 4
myst_enable_extensions = ['html_image']
# Code of other languages, and links that lead out of the folder of the documents.
suppress_warnings = ['misc.highlighting_failure', 'myst.xref_missing', 'image.not_readable']
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autodoc_typehints = 'none'
autodoc_member_order = 'bysource'

html_theme = 'alabaster'
html_title = f'{project} {release}'
html_theme_options = {'description': '2D laser odometry for ROS 2', 'page_width': '1100px', 'fixed_sidebar': True,
                      'font_family': 'system-ui, sans-serif'}
html_copy_source = False
REPOSITORY = '../'
"""Documents link to files beside the folder of the documents, as on the page of the repository."""


def setup(app):
    """Write the first page from the README."""
    app.connect('source-read', _lead_to_the_site)


def _lead_to_the_site(_app, name, source):
    """Let links of the README lead to the pages of the site, and those to other files to nothing but their name."""
    text = source[0]
    if name == 'index':
        text = text.replace('](doc/', '](').replace('src="doc/', 'src="')
    # A file that is no page: its name, without a link.
    source[0] = re.sub(r'\[([^\]]*)\]\((?:\.\./[^)#]*|[A-Z.][\w./]*|config/[^)]*|examples[^)]*)(?:#[^)]*)?\)',
                       r'\1', text)
