"""Functions run in a process of their own, where time and memory can be measured and a hang can be ended."""
import resource
import warnings
from multiprocessing import get_context


def in_child(function, *arguments, timeout):
    """What `function` returns, and the most memory [bytes] that its process ever had; warnings are errors there."""
    with get_context('spawn').Pool(1, warnings.simplefilter, ('error',)) as pool:
        return pool.apply_async(_measured, (function, arguments)).get(timeout)


def _measured(function, arguments):
    result = function(*arguments)
    return result, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
