# SPDX-License-Identifier: Apache-2.0
"""Parallel work in local processes or on a Dask cluster, through the interface `concurrent.futures.Executor`."""
import math
import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager, nullcontext
from multiprocessing.connection import wait

from ..allocation import keep_freed_memory
from ..core.errors import DbscanRegError
from ..endings import ENDING, held, interruptible, lasting_output

THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
"""Variables that limit the threads of numerical libraries, as parallel processes with many threads are slow."""

PATIENCE = 1.0
"""Time [s] that a worker has after an interruption to write its partial results; then it is killed."""

_worker = None
"""The `_Worker` object of this process if the process is a local worker, else None."""


class SchedulerError(DbscanRegError):
    """No Dask scheduler responds at the given address."""


@contextmanager
def workers(processes, scheduler=None, most=math.inf):
    """Provide an executor of local processes, or of the Dask cluster at the address `scheduler`.

    They are as many as `processes`, by default one for each processor, but at most `most`. With one process, the work
    runs in this process. Submitted functions must be importable by other processes. An interruption (Ctrl-C, SIGTERM or
    SIGHUP) is raised once all processes have ended, at most `PATIENCE` seconds later: work that uses `watched` receives
    a KeyboardInterrupt and may write partial results; other work ends at once.
    """
    processes = min(processes or len(os.sched_getaffinity(0)), most)
    if scheduler:
        opened = _cluster(scheduler)
    elif processes == 1:
        opened = _Here()
    else:
        opened = local_workers(processes)
    with opened as executor:
        yield executor


def as_done(executor, function, jobs):
    """Yield (number of the job, result) of ``function(*job)`` for each of the `jobs`, in the order of completion."""
    if isinstance(executor, _Here):
        yield from ((number, function(*job)) for number, job in enumerate(jobs))
        return
    futures = {executor.submit(function, *job): number for number, job in enumerate(jobs)}
    for future in as_completed(futures):
        yield futures[future], future.result()


def watched(items, title, total):
    """Yield the `items`, and raise a pending interruption between two of them.

    Work in this process has a progress bar with a `title` and the `total` number of items.
    """
    if _worker is None:
        from tqdm import tqdm
        with _interruptions() as interrupted:
            for item in tqdm(items, title, total, disable=None):
                if interrupted.is_set():
                    raise KeyboardInterrupt
                yield item
        return
    _worker.end_politely()
    for item in items:
        _worker.heed()
        yield item


@contextmanager
def _interruptions():
    """Provide an event that is set where Python would raise a KeyboardInterrupt."""
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


class _Here(Executor):
    """Executor in this process: runs submitted work at once, and mapped work when its result is requested."""

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - raised where the result is asked for
            future.set_exception(error)
        return future

    def map(self, function, *iterables, **_):
        return map(function, *iterables)


class _Local(ProcessPoolExecutor):
    """Executor of local processes that ignore Ctrl-C in the terminal: their parent process ends them."""

    def submit(self, function, /, *args, **kwargs):
        with held(*ENDING):
            # The processes that are started here take over what is blocked.
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                return super().submit(_work, function, args, kwargs)
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def local_workers(processes):
    """Provide an executor of local processes, even if it is a single process."""
    context = multiprocessing.get_context('spawn')
    others = set(multiprocessing.active_children())
    executor = _Local(processes, context, _begin)
    limits = {name: '1' for name in THREADS if name not in os.environ}
    os.environ.update(limits)
    in_main = threading.current_thread() is threading.main_thread()
    try:
        with interruptible(signal.SIGTERM, signal.SIGHUP) if in_main else nullcontext():
            yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        _stop([child for child in multiprocessing.active_children() if child not in others])
        raise
    finally:
        executor.shutdown(wait=True)
        for name in limits:
            del os.environ[name]


def _stop(processes):
    """Terminate the worker processes; kill them after `PATIENCE` seconds or at a second interruption."""
    deadline = time.monotonic() + PATIENCE
    try:
        for process in processes:
            process.terminate()
        while ((running := [p.sentinel for p in processes if p.is_alive()])
               and (left := deadline - time.monotonic()) > 0):
            wait(running, left)
    finally:
        for process in processes:
            process.kill()


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
            executor.shutdown(wait=False)
            raise


def _begin():
    """Initialise a local worker process."""
    global _worker
    keep_freed_memory()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _worker = _Worker()


def _end_with_parent():
    multiprocessing.parent_process().join()
    os._exit(1)


def _work(function, args, kwargs):
    """Run the jobs of a local worker."""
    try:
        with lasting_output():
            return function(*args, **kwargs)
    finally:
        _worker.end_at_once()


class _Worker:
    """Interruption of a local worker by its parent process, which sends SIGTERM."""

    def __init__(self):
        self._stopped = False

    def end_at_once(self):
        """Let SIGTERM end this process from now on; end it now if SIGTERM was already received."""
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        if self._stopped:
            os._exit(1)

    def end_politely(self):
        """From now on, SIGTERM only sets a flag; `heed` raises a KeyboardInterrupt if it is set."""
        signal.signal(signal.SIGTERM, self._stop)

    def _stop(self, _number, _frame):
        self._stopped = True

    def heed(self):
        """Raise a KeyboardInterrupt if the parent process has sent SIGTERM."""
        if self._stopped:
            raise KeyboardInterrupt
