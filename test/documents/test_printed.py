# SPDX-License-Identifier: Apache-2.0
"""What the documents print is what the commands print."""
import subprocess
import sys


def test_short_commands_print_what_the_documents_show(root, tmp_path):
    done = subprocess.run([sys.executable, root / 'scripts' / 'docs', '--work', tmp_path / 'work', '--check'],
                          capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stdout.startswith('0 blocks')
