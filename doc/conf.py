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

html_theme = 'furo'
html_title = f'{project} {release}'
html_use_index = False
html_copy_source = False
html_math_renderer = 'mathml'


def setup(app):
    """Write the first page from the README, and equations as MathML, which browsers show without a script."""
    app.connect('source-read', _lead_to_the_site)
    app.add_html_math_renderer('mathml', (_visit_math, None), (_visit_math, None))


def _lead_to_the_site(app, name, source):
    """Let links lead to the pages of the site, and those to other files to nothing but their name."""
    text, folder = source[0], (ROOT / 'doc' / name).parent
    if name == 'index':
        app.env.note_dependency(ROOT / 'README.md')
        text = (ROOT / 'README.md').read_text().replace('](doc/', '](').replace('src="doc/', 'src="') + '\n' + text
    elif name == 'decisions/index':
        text += '\n```{toctree}\n:hidden:\n:glob:\n\n2*\n```\n'

    def shown(link):
        path = (folder / link[2]).resolve()
        is_page = path.suffix in ('.md', '.png', '.gif') and path.is_relative_to(ROOT / 'doc') and path.exists()
        return link[0] if is_page else link[1]

    source[0] = re.sub(r'\[([^\]]*)\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)', shown, text)


def _visit_math(writer, node):
    is_block = isinstance(node, nodes.math_block)
    element = tex2mathml(node.astext(), as_block=is_block)
    style = {'STYLE': 'padding: 0.5em 0'} if is_block else {}  # the theme cuts off what is higher than a line
    writer.body.append(writer.starttag(node, 'div' if is_block else 'span', '', CLASS='math', **style) + element +
                       ('</div>\n' if is_block else '</span>'))
    raise nodes.SkipNode
