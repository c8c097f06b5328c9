# SPDX-License-Identifier: Apache-2.0
"""Each command that a document prints exists, with its options, files, courses and methods; none is run."""
import itertools
import re
import shlex
from importlib import import_module

import pytest
from benchmarks.__main__ import make_parser
from benchmarks.odometry.ablation import FEATURES
from benchmarks.odometry.courses import COURSES

from dbscan_reg_ros.command_lines import COMMANDS, PACKAGE
from dbscan_reg_ros.evaluation.method_names import METHODS
from dbscan_reg_ros.paths import ready_made

OURS = re.compile(r'(?:env \S+ )?(?:\S*python -m dbscan_reg_ros|ros2 run dbscan_reg_ros|dbscan-reg-ros) ')
SCRIPT = re.compile(r'\S*?(scripts/\w+)(?=\s|$)')
LAUNCH = re.compile(r'ros2 launch dbscan_reg_ros ')
NODES = 'scan_matcher', 'scan_matcher_lifecycle'
PLACEHOLDERS = {'N': '1', 'REF': '0', 'CUR': '1', 'X': '0', 'Y': '0', 'DEG': '0'}
"""Stand for numbers; others stand for names."""


def printed(text):
    """Yield the command lines in the blocks and the code spans of a document."""
    blocks = re.findall(r'^```bash\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)
    text = re.sub(r'^ *```.*?^ *```$', '', text, flags=re.MULTILINE | re.DOTALL)
    indented = re.findall(r'^ {4,}(\S.*)$', text, re.MULTILINE)
    for line in itertools.chain(*(block.replace('\\\n', ' ').splitlines() for block in blocks), indented):
        yield re.sub(r'(^|\s)#.*', '', line).strip()
    for span in re.findall(r'`([^`]+)`', text):
        yield ' '.join(span.split())


def words_of(line):
    """Split a command line, up to a pipe; optional words are taken, and placeholders of numbers become numbers."""
    words = shlex.split(re.sub(r'\[|\]|\.\.\.', ' ', line))
    words = itertools.takewhile(lambda word: word not in ('|', '>', '&&', ';'), words)
    return [PLACEHOLDERS.get(word, word) for word in words]


def commands_of(path):
    """Yield the program and the words of each command of ours in a document."""
    for line in printed(path.read_text()):
        if found := OURS.match(line):
            yield PACKAGE, words_of(line[found.end():])
        elif re.match(r'\w+ -', line) and line.split()[0] in COMMANDS:
            yield 'an option', words_of(line)
        elif re.match(r'\w+ [A-Z]', line) and line.split()[0] in COMMANDS:
            yield PACKAGE, words_of(line)
        elif found := LAUNCH.match(line):
            yield 'launch', words_of(line[found.end():])
        elif (found := SCRIPT.match(line)) and line != 'scripts/bench':
            yield found[1], words_of(line[found.end():])


def parser_of(command, words, monkeypatch):
    """Return the parser of a command of the package, and the words that it parses; the command is not run."""
    module, given = import_module(f'{PACKAGE}.{COMMANDS[command][0]}'), []
    monkeypatch.setattr(module, 'run', lambda parser, work, argv=None, **_: given.append((parser, argv)))
    module.main(words)
    return given[0]


def check(root, program, words, monkeypatch):
    if program == PACKAGE:
        assert words[0] in COMMANDS
        if words[0] not in NODES:
            parser, words = parser_of(words[0], words[1:], monkeypatch)
            parser.parse_args(words)
    elif program == 'an option':
        assert words[1] in parser_of(words[0], [], monkeypatch)[0].format_help().split()
    elif program == 'launch':
        text = (root / 'launch' / words[0]).read_text() + (root / PACKAGE / 'node' / 'launching.py').read_text()
        names = [word.partition(':=')[0] for word in words[1:] if ':=' in word]
        assert [name for name in names if f"'{name}'" not in text] == []
        sensors = [word.partition(':=')[2] for word in words if word.startswith('sensor:=')]
        assert set(sensors) <= {*ready_made(), 'NAME'}
    elif program == 'scripts/bench':
        args = vars(make_parser().parse_args(words))
        for option, known in ('course', COURSES), ('method', METHODS), ('feature', FEATURES):
            assert set(args.get(option) or ()) <= {*known, 'NAME'}
    else:
        assert (root / program).stat().st_mode & 0o111
    for word in words:
        if re.match(r'(config|test|launch)/', word):
            assert (root / word.partition('::')[0]).exists(), word


DOCUMENTS = {'README.md': 12, 'doc/benchmarks.md': 35, 'doc/paper.md': 2, 'doc/quickstart.md': 8, 'doc/node.md': 5,
             'doc/tuning.md': 10, 'doc/faq.md': 3, 'doc/method.md': 3, 'doc/reliability.md': 5,
             'doc/recordings.md': 2, '.github/CONTRIBUTING.md': 5}
"""Document -> least number of commands that are found in it."""


@pytest.mark.parametrize('name', DOCUMENTS)
def test_each_command_of_a_document_is_one_that_can_be_given(root, name, monkeypatch, capsys):
    commands = [(program, words) for program, words in commands_of(root / name) if words != ['COMMAND']]
    assert len(commands) >= DOCUMENTS[name]
    wrong = []
    for program, words in commands:
        try:
            check(root, program, words, monkeypatch)
        except (AssertionError, OSError, SystemExit) as error:
            if not (isinstance(error, SystemExit) and error.code == 0):
                wrong.append(f'{program} {shlex.join(words)}: {error} {capsys.readouterr().err[-200:]}')
    assert wrong == [], '\n'.join(wrong)
