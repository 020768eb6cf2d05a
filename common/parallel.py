"""Runs the parts of a task in several processes, or one after the other in this one."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
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

    The function, the parts and the results must be picklable if jobs is above 1. An error of one part is raised.
    """
    if min(jobs, len(parts)) < 2:
        results = []
        for n, part in enumerate(parts, 1):
            results.append(function(part))
            done(n, len(parts))
        return results
    with _one_thread_each(), ProcessPoolExecutor(min(jobs, len(parts)), get_context("spawn")) as pool:
        futures = [pool.submit(function, part) for part in parts]
        try:
            for n, future in enumerate(as_completed(futures), 1):
                future.result()
                done(n, len(parts))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
        return [future.result() for future in futures]


@contextmanager
def _one_thread_each() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
