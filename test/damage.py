# SPDX-License-Identifier: Apache-2.0
"""Bytes and lines of recordings damaged in every way."""
import numpy as np

WORDS = ['', '0', '-1', 'nan', 'inf', '-inf', '1e999', '1e99999999', '-1e308', '3.4e38', '9' * 30, '9' * 5000, 'x',
         '\0', 'FLASER',
         'ROBOTLASER1', 'PARAM', 'laser_range_min', 'laser_time_increment', '180', '4294967296', '-0', '1_000', '٣']


def damaged_bytes(content, rng, other=b'') -> bytes:
    """`content` with one to three kinds of damage; `other` is what may be mixed into it."""
    for _ in range(rng.integers(1, 4)):
        content = BYTES[rng.integers(len(BYTES))](content, rng, other)
    return content


def damaged_text(text, rng) -> str:
    """The lines of a log with one to three kinds of damage."""
    for _ in range(rng.integers(1, 4)):
        text = LINES[rng.integers(len(LINES))](text, rng)
    return text


def _span(content, rng):
    """Start and end of a part, mostly a short one."""
    start = int(rng.integers(len(content) + 1))
    return start, min(start + int(2.0 ** rng.uniform(0.0, 14.0)), len(content))


def _cut(content, rng, _):
    return content[:rng.integers(len(content) + 1)]


def _flip(content, rng, _):
    content = bytearray(content)
    for at in rng.integers(max(len(content), 1), size=min(int(2.0 ** rng.uniform(0.0, 8.0)), len(content))):
        content[at] ^= 1 << rng.integers(8)
    return bytes(content)


def _overwrite(content, rng, _):
    start, end = _span(content, rng)
    filler = [bytes(end - start), b'\xff' * (end - start), rng.bytes(end - start)][rng.integers(3)]
    return content[:start] + filler + content[end:]


def _wrong_number(content, rng, _):
    """A count or a size that is not the true one."""
    start = int(rng.integers(len(content) + 1))
    size = int(rng.choice([1, 2, 4, 8]))
    value = int(rng.choice([0, 1, 255, 65535, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1])) % 256**size
    return content[:start] + value.to_bytes(size, 'little') + content[start + size:]


def _remove(content, rng, _):
    start, end = _span(content, rng)
    return content[:start] + content[end:]


def _repeat(content, rng, _):
    start, end = _span(content, rng)
    return content[:end] + content[start:end] * int(rng.integers(1, 20)) + content[end:]


def _insert(content, rng, other):
    start, (first, last) = int(rng.integers(len(content) + 1)), _span(other, rng)
    return content[:start] + other[first:last] + content[start:]


def _interleave(content, rng, other):
    step = int(2.0 ** rng.uniform(6.0, 12.0))
    parts = [source[at:at + step] for at in range(0, max(len(content), len(other)), step) for source in (content,
                                                                                                         other)]
    return b''.join(parts)


BYTES = [_cut, _flip, _flip, _overwrite, _wrong_number, _wrong_number, _remove, _repeat, _insert, _interleave]


def _wrong_words(text, rng):
    words = text.split(' ')
    for at in rng.integers(len(words), size=rng.integers(1, 6)):
        words[at] = WORDS[rng.integers(len(WORDS))]
    return ' '.join(words)


def _shuffled_lines(text, rng):
    lines = text.split('\n')
    return '\n'.join(np.array(lines, dtype=object)[rng.integers(len(lines), size=len(lines))])


def _joined_lines(text, rng):
    return text.replace('\n', ' ', int(rng.integers(1, 4)))


def _long_line(text, rng):
    return text + ' 1.0' * int(2.0 ** rng.uniform(10.0, 21.0)) + '\n' + text


def _lost_words(text, rng):
    start, end = _span(text, rng)
    return text[:start] + text[end:]


LINES = [_wrong_words, _wrong_words, _shuffled_lines, _joined_lines, _long_line, _lost_words]
