# SPDX-License-Identifier: Apache-2.0
"""What could run code of a file, read from the source; hashes of what the set-up installs."""
import ast
import re

FORBIDDEN_MODULES = {'pickle', 'marshal', 'shelve', 'dill', 'cloudpickle', 'joblib'}
FORBIDDEN_CALLS = {'eval', 'exec', 'compile', '__import__', 'system', 'popen', 'unsafe_load', 'full_load', 'load_all'}


def calls(root):
    """(place, name, call) of every call in the source."""
    for path in sorted([*(root / 'dbscan_reg_ros').rglob('*.py'), *(root / 'scripts').rglob('*.py'),
                        *(root / 'launch').glob('*.py')]):
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = {alias.name.partition('.')[0] for alias in node.names} | {getattr(node, 'module', '') or ''}
                assert not names & FORBIDDEN_MODULES, f'{path}:{node.lineno} imports {names}'
            if isinstance(node, ast.Call):
                function = node.func
                yield f'{path}:{node.lineno}', getattr(function, 'attr', getattr(function, 'id', '')), node


def test_nothing_in_the_source_runs_what_it_reads(root):
    found = list(calls(root))
    assert len(found) > 1000
    for place, name, call in found:
        if name == 'compile' and isinstance(call.func, ast.Attribute) and call.func.value.id == 're':
            continue
        assert name not in FORBIDDEN_CALLS, place
        keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
        assert keywords.get('allow_pickle', 'False') == 'False', place
        assert keywords.get('shell', 'False') == 'False', place
        if name == 'load' and ast.unparse(call.func) == 'yaml.load':
            assert ast.unparse(call.args[1]) == '_Loader', place
        if name == 'load' and ast.unparse(call.func) == 'np.load':
            assert keywords.get('allow_pickle') == 'False', place


def test_every_package_of_the_set_up_is_pinned_with_its_hashes(root):
    for path in sorted((root / 'scripts' / 'requirements').glob('*.txt')):
        text = re.sub(r'\s*#.*', '', path.read_text()).replace('\\\n', ' ')
        requirements = [line for line in text.splitlines() if line.strip()]
        assert requirements, path
        for requirement in requirements:
            assert re.match(r'[\w.\[\],-]+==[\w.]+( ; [^#]*?)?(\s+--hash=sha256:[0-9a-f]{64})+\s*$',
                            requirement), requirement
