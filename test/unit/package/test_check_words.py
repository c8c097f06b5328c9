# SPDX-License-Identifier: Apache-2.0
"""scripts/check_words: names and phrases that are gone are found, with line and replacement."""
import shutil
import subprocess
import sys

import pytest


@pytest.fixture
def check(root, tmp_path):
    """``check(path, text)``: the exit status and the findings for a project of this one file."""
    (tmp_path / 'scripts').mkdir()
    source = (root / 'scripts' / 'check_words').read_text()
    head, _, tail = source.partition('EXCEPTIONS: dict[tuple[str, str], str] = {')
    (tmp_path / 'scripts' / 'check_words').write_text(head + 'EXCEPTIONS = {' + tail[tail.index('\n}') + 1:])
    subprocess.run(['git', 'init', '-q', tmp_path], check=True)

    def check(path, text, *options):
        (tmp_path / path).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / path).write_text(text)
        done = subprocess.run([sys.executable, tmp_path / 'scripts' / 'check_words', '--all', *options], timeout=60,
                              capture_output=True, text=True, check=False)
        return done.returncode, done.stdout.splitlines()
    return check


def test_the_project_passes(root):
    if shutil.which('git') is None or not (root / '.git').exists():
        pytest.skip('needs the git repository')
    done = subprocess.run([sys.executable, root / 'scripts' / 'check_words'], capture_output=True, text=True,
                          timeout=120, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(('text', 'found'), [
    ('x = build_cloud(points)\n', ['build_cloud -> OrientedPoints']),
    ('x = parameters.segments.most\n', ['segments.most -> segments.max_segments']),
    ('from dbscan_reg_ros.core.placement import x\n',
     ['dbscan_reg_ros.core.placement -> the path of today (doc/architecture.md)']),
    ('"""A scan.\n\nThe walls of it\nare of little worth.\n"""\n', ['worth -> weight; support; reason']),
    ('# What the wheels\n# have told is used.\n', ['told -> given by the external prior; reported; distinguished']),
    ("raise ValueError('the wheels '\n                 f'told {way} m')\n",
     ['told -> given by the external prior; reported; distinguished']),
    ('def test_the_round_room():\n    pass\n', ['round room -> circular room']),
])
def test_a_name_or_phrase_in_python_is_found(check, text, found):
    status, lines = check('module.py', text)
    assert status == 1 and [line.partition(': ')[2] for line in lines] == found


@pytest.mark.parametrize(('path', 'line'), [('doc/page.md', 3), ('config/some.yaml', 3)])
def test_a_phrase_over_two_lines_is_found_at_its_first(check, path, line):
    status, lines = check(path, '# A title\n#\n# The pose of the last\n# word. A parameter is as\n# long as it says.\n')
    assert status == 1
    assert lines == [f'{path}:{line}: last word -> final', f'{path}:{line + 1}: as long as -> while; if']


@pytest.mark.parametrize('text', [
    'The wall, a window of key frames, the turn rate, drift, and a lost track.', 'In either way. In the same way.',
    'The point cloud and sensor_msgs/PointCloud2', 'The left turn signal',
    'A bag that holds no scan', 'It is by the way.'])
def test_ordinary_words_are_free(check, text):
    assert check('README.md', text + '\n') == (0, [])


def test_the_table_is_long_and_the_exceptions_are_few(root):
    source = (root / 'scripts' / 'check_words').read_text()
    namespace = {'__name__': 'check_words', '__file__': str(root / 'scripts' / 'check_words')}
    exec(compile(source, 'check_words', 'exec'), namespace)
    assert len(namespace['PHRASES']) >= 80 and len(namespace['EXCEPTIONS']) <= 20
    assert all(reason for reason in namespace['EXCEPTIONS'].values())
