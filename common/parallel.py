"""Runs the parts of a task in several processes, or one after the other in this one."""

import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process, resource_tracker
from typing import TypeVar

Part = TypeVar("Part")
Result = TypeVar("Result")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables by which numerical libraries limit their threads: one for each process, or they fight for the cores."""


def cores() -> int:
    """The number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_parts(
    function: Callable[[Part], Result], parts: Sequence[Part], jobs: int, done: Callable[[int, int], None]
) -> list[Result]:
    """The results of all parts, in their order; done: called with the number of parts that are finished, and of all.

    The function, the parts and the results must be picklable if jobs is above 1. An error of one part is raised; the
    others then end at once, as they do after Ctrl-C.
    """
    done(0, len(parts))
    if min(jobs, len(parts)) < 2:
        results = []
        for n, part in enumerate(parts, 1):
            results.append(function(part))
            done(n, len(parts))
        return results
    with _environment({name: os.environ.get(name) or "1" for name in THREADS}), _workers(min(jobs, len(parts))) as pool:
        with _ctrl_c_blocked():
            futures = [pool.submit(function, part) for part in parts]
        for n, future in enumerate(as_completed(futures), 1):
            future.result()
            done(n, len(parts))
        return [future.result() for future in futures]


@contextmanager
def _workers(count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with the context; after an exception, such as that of Ctrl-C, at once."""
    # Where this process ends at once (common/interrupt.py), the tracker removes its semaphores without a warning.
    with _environment({"PYTHONWARNINGS": "ignore"}):
        resource_tracker.ensure_running()
    others = set(active_children())
    pool = ProcessPoolExecutor(count, get_context("spawn"), initializer=_end_with_parent)
    try:
        yield pool
    except BaseException:
        for worker in set(active_children()) - others:
            worker.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Processes that start meanwhile inherit that Ctrl-C does not reach them: it is for this process to end them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this process as soon as its parent is gone, for example killed."""
    threading.Thread(target=_wait_for_parents_end, daemon=True).start()


def _wait_for_parents_end() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Variables of the processes that start in the context."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
