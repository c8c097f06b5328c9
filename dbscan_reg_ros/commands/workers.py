"""Work for several processes: local ones, or those of a Dask cluster, behind one `concurrent.futures.Executor`."""
import multiprocessing
import os
import signal
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager

from ..allocation import keep_freed_memory
from ..core.errors import DbscanRegError

THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
"""What limits the threads of numerical libraries: processes that each want all processors hinder each other."""
EVERY = 20
"""Items between two looks at what the parent says."""

_parent = None
"""In a local worker: how it reports progress and hears that it has to stop."""


class SchedulerError(DbscanRegError):
    """There is no cluster at the address given."""


@contextmanager
def workers(processes, scheduler=None):
    """An executor of `processes` local processes, or of the Dask cluster at the address `scheduler`.

    One process is this one. What is submitted has to be importable by other processes. An interruption reaches the
    work as a KeyboardInterrupt, and is passed on once all of it has ended.
    """
    if scheduler:
        opened = _cluster(scheduler)
    elif processes == 1:
        opened = _Here()
    else:
        opened = _local(processes)
    with opened as executor:
        yield executor


def watched(items, title, total):
    """The `items` with a progress bar, wherever this process shows it; an interruption is raised in between."""
    if _parent is None:
        from tqdm import tqdm
        with _interruptions() as interrupted:
            for item in tqdm(items, title, total, disable=None):
                if interrupted.is_set():
                    raise KeyboardInterrupt
                yield item
        return
    name = f'{title} {os.getpid()}'
    done = 0
    for done, item in enumerate(items, 1):
        if done % EVERY == 0:
            _parent.report(name, title, done, total)
        yield item
    _parent.report(name, title, done, done)


@contextmanager
def _interruptions():
    """An event that is set where Python would raise a KeyboardInterrupt."""
    interrupted = threading.Event()
    if (threading.current_thread() is not threading.main_thread()
            or signal.getsignal(signal.SIGINT) is not signal.default_int_handler):
        yield interrupted
        return
    signal.signal(signal.SIGINT, lambda _number, _frame: interrupted.set())
    try:
        yield interrupted
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def processors() -> int:
    """How many processes can run at once on this machine."""
    return len(os.sched_getaffinity(0))


class _Here(Executor):
    """Does at once what is submitted, in this process; what is mapped when its result is asked for."""

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - whoever asks for the result gets it
            future.set_exception(error)
        return future

    def map(self, function, *iterables, **_):
        return map(function, *iterables)


@contextmanager
def _local(processes):
    context = multiprocessing.get_context('spawn')
    stop, reports = context.Event(), context.SimpleQueue()
    executor = ProcessPoolExecutor(processes, context, _begin, (stop, reports))
    bars = threading.Thread(target=_show, args=(reports,), daemon=True)
    bars.start()
    limits = {name: '1' for name in THREADS if name not in os.environ}
    os.environ.update(limits)
    try:
        yield executor
    except BaseException:
        stop.set()
        executor.shutdown(wait=True, cancel_futures=True)
        raise
    finally:
        executor.shutdown(wait=True)
        reports.put(None)
        bars.join()
        for name in limits:
            del os.environ[name]


@contextmanager
def _cluster(address):
    from distributed import Client

    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        raise SchedulerError(f'{address}: no Dask scheduler answers: {error}') from error
    with client, client.get_executor(pure=False) as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def _begin(stop, reports):
    """Start of a local worker: an interruption comes from the parent."""
    global _parent
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    _parent = _Parent(stop, reports)


class _Parent:
    """The parent of a local worker."""

    def __init__(self, stop, reports):
        self._stop, self._reports = stop, reports

    def report(self, name, title, done, total):
        if self._stop.is_set():
            raise KeyboardInterrupt
        self._reports.put((name, title, done, total))


def _show(reports):
    """Show the bars of all workers until None comes."""
    from tqdm import tqdm

    bars = {}
    while (report := reports.get()) is not None:
        name, title, done, total = report
        if name not in bars:
            bars[name] = tqdm(None, title, total, disable=None)
        bars[name].total = total
        bars[name].update(done - bars[name].n)
        if done == total:
            bars.pop(name).close()
    for bar in bars.values():
        bar.close()
