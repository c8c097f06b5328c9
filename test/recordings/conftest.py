# SPDX-License-Identifier: Apache-2.0
"""What tests of several files of recordings share."""
import json

import pytest

from dbscan_reg_ros.commands.compare import main as compare_command


@pytest.fixture
def compare(hall_recording, tmp_path, capsys):
    """``compare(a, b, *words) -> exit code, printed, comparison.json``."""
    def compare(a, b, *words):
        code = compare_command([str(a), str(b), str(hall_recording), *map(str, words), '--processes', '1', '--out',
                                str(tmp_path)])
        return code, capsys.readouterr(), json.loads((tmp_path / 'compare/latest/comparison.json').read_text())
    return compare
