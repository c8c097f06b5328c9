# SPDX-License-Identifier: Apache-2.0
"""What the documents print is what the commands print: the short commands, and the check itself."""
import subprocess
import sys

import pytest
from PIL import Image

DOCUMENT = '''# A document

<!-- file: numbers.txt -->
```yaml
first 1.000 m after 12.0 ms
second 2.00
```

<!-- run: short -->
```bash
cat numbers.txt
python -c "from PIL import Image; Image.new('RGB', (1000, 500), (10, 20, 30)).save('a.png')"
```

```text
first {first} m after 99.0 ms
second {second}
```

<!-- picture: a.png -->
![a dark picture](shown.png)
'''


@pytest.fixture
def docs(root, tmp_path):
    """``docs(*words) -> (exit status, output)``."""
    def docs(*words):
        done = subprocess.run([sys.executable, root / 'scripts' / 'docs', '--work', tmp_path / 'work', *words],
                              capture_output=True, text=True, timeout=300, check=False)
        return done.returncode, done.stdout + done.stderr
    return docs


@pytest.fixture
def document(tmp_path):
    """``document(first, second) -> path`` of one that shows these numbers."""
    def document(first, second):
        path = tmp_path / 'a.md'
        path.write_text(DOCUMENT.format(first=first, second=second))
        return path
    return document


def test_short_commands_print_what_the_documents_show(docs):
    status, output = docs('--check')
    assert status == 0, output
    assert not output.startswith('0 blocks')


@pytest.mark.parametrize(('first', 'second', 'differ'), [
    ('1.000', '2.00', False), ('1.019', '2.01', False), ('1.022', '2.00', True), ('1.000', '2.05', True)])
def test_numbers_agree_to_two_per_cent_or_a_digit_and_times_do_not_count(docs, document, first, second, differ):
    path = document(first, second)
    docs('--write', path)
    path.write_text(DOCUMENT.format(first=first, second=second))
    status, output = docs('--check', path)
    assert status == differ, output
    assert (' is now ' in output) == differ


def test_what_differs_is_renewed(docs, document, tmp_path):
    path = document('3.000', '2.00')
    assert docs('--check', path)[0] == 1
    assert not (tmp_path / 'shown.png').exists()
    assert docs('--write', path)[0] == 0
    assert 'first 1.000 m after 12.0 ms\nsecond 2.00\n```\n\n<!-- picture' in path.read_text()
    assert docs('--check', path)[0] == 0
    with Image.open(tmp_path / 'shown.png') as image:
        assert image.size == (900, 450)
    Image.new('RGB', (900, 450), (200, 200, 200)).save(tmp_path / 'shown.png')
    status, output = docs('--check', path)
    assert status == 1 and 'shown.png differs' in output


def test_commands_without_their_recording_are_skipped_and_counted(docs, tmp_path):
    (tmp_path / 'a.md').write_text("""<!-- run: short -->
```bash
python -m dbscan_reg_ros replay --close-loops absent/absent.log.gz
```
<!-- picture: results/absent/latest/map.png shown.png -->
""")
    status, output = docs('--check', tmp_path / 'a.md')
    assert (status, output) == (0, '0 blocks of commands checked, 1 skipped for lack of data, 0 left out or for the '
                                   'next call; 0 differences\n')


def drawn(path, seed, radius):
    """A document with the picture of a simulated building and drive, blurred by `radius` pixels."""
    path.write_text(f"""<!-- run: short -->
```bash
rm -f drive.log*
python -m dbscan_reg_ros simulate drive.log --seconds 2 --seed {seed}
python -c "from PIL import Image, ImageFilter, ImageOps; picture = Image.open('drive.log.png').convert('RGB'); \\
ImageOps.pad(picture, (900, 900), color='white').filter(ImageFilter.GaussianBlur({radius})).save('a.png')"
```
<!-- picture: a.png shown.png -->
""")
    return path


def test_a_picture_drawn_a_little_otherwise_agrees_and_one_of_another_drive_does_not(docs, tmp_path):
    path = tmp_path / 'a.md'
    assert docs('--write', drawn(path, 1, 0.0))[0] == 0
    status, output = docs('--check', drawn(path, 1, 0.7))
    assert status == 0, output
    status, output = docs('--check', drawn(path, 2, 0.0))
    assert status == 1 and 'shown.png differs' in output


def test_lines_that_are_no_longer_printed_are_named(docs, document):
    path = document('1.000', '2.00')
    path.write_text(path.read_text().replace('second 2.00\n```\n\n<!-- picture', 'third 2.00\n```\n\n<!-- picture'))
    status, output = docs('--check', path)
    assert status == 1 and 'a.md:16: not printed: third 2.00' in output
