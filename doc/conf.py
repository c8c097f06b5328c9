# SPDX-License-Identifier: Apache-2.0
"""Settings of sphinx: python -m sphinx -W -b html doc FOLDER makes the site."""
import pathlib
import re
import sys

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

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
myst_enable_extensions = ['dollarmath', 'html_image']
suppress_warnings = ['misc.highlighting_failure']  # code of languages that the highlighter does not know
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autodoc_typehints = 'none'
autodoc_member_order = 'bysource'

html_theme = 'alabaster'
html_title = f'{project} {release}'
html_theme_options = {'description': '2D laser odometry for ROS 2', 'page_width': '1100px', 'fixed_sidebar': True,
                      'font_family': 'system-ui, sans-serif'}
html_copy_source = False
html_math_renderer = 'mathml'


def setup(app):
    """Write the first page from the README, and equations as MathML, which browsers show without a script."""
    app.connect('source-read', _lead_to_the_site)
    app.add_html_math_renderer('mathml', (_visit_math, None), (_visit_math, None))


def _lead_to_the_site(app, name, source):
    """Let links lead to the pages of the site, and those to other files to nothing but their name."""
    text = source[0]
    if name == 'index':
        readme = ROOT / 'README.md'
        app.env.note_dependency(readme)
        text = readme.read_text().replace('](doc/', '](').replace('src="doc/', 'src="') + '\n' + text
    # A file that is no page: its name, without a link.
    source[0] = re.sub(r'\[([^\]]*)\]\((?:\.\./[^)#]*|[A-Z.][\w./]*|config/[^)]*|examples[^)]*)(?:#[^)]*)?\)',
                       r'\1', text)


def _visit_math(writer, node):
    is_block = isinstance(node, nodes.math_block)
    element = tex2mathml(node.astext(), as_block=is_block)
    writer.body.append(writer.starttag(node, 'div' if is_block else 'span', '', CLASS='math') + element +
                       ('</div>\n' if is_block else '</span>'))
    raise nodes.SkipNode
