# SPDX-License-Identifier: Apache-2.0
"""Functions run in a process of their own, where time and memory can be measured and a hang can be ended."""
import warnings
from multiprocessing import get_context
from pathlib import Path


def in_child(function, *arguments, timeout):
    """What `function` returns, and the most memory [bytes] that its process ever had; warnings are errors there."""
    with get_context('spawn').Pool(1, warnings.simplefilter, ('error',)) as pool:
        return pool.apply_async(_measured, (function, arguments)).get(timeout)


def _measured(function, arguments):
    result = function(*arguments)
    return result, most_memory('self')


def most_memory(process):
    """The most memory [bytes] that a process with this number ever had resident."""
    status = Path(f'/proc/{process}/status').read_text()
    return int(status.partition('VmHWM:')[2].split()[0]) * 1024
