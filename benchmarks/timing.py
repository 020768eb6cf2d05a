"""A figure and its floor: timed by turns, so that what disturbs the machine disturbs both."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

ROUNDS = 15
BATCH_S = 0.01
"""Time that one batch of calls takes at least: far above the clock's grain, far below the machine's moods."""
WARM_UP_S = 0.02


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: `ours` and `floor` in `unit`, ratio = ours / floor; n: how often ours was measured."""

    name: str
    ours: float
    floor: float
    ratio: float
    unit: str
    n: int


def row(name: str, ours: float, floor: float, unit: str, n: int) -> Row:
    """A row with its ratio."""
    return Row(name, ours, floor, ours / floor, unit, n)


def compare(
    name: str,
    ours: Callable[[], object],
    floor: Callable[[], object],
    rounds: int = ROUNDS,
    batch_s: float = BATCH_S,
) -> Row:
    """Microseconds a call, the median over `rounds`; in each round both take turns, and turns who begins."""
    calls_ours, calls_floor = _calls_in(ours, batch_s), _calls_in(floor, batch_s)
    times_ours, times_floor = [], []
    for round_ in range(rounds):
        if round_ % 2:
            times_floor.append(_time(floor, calls_floor))
        times_ours.append(_time(ours, calls_ours))
        if not round_ % 2:
            times_floor.append(_time(floor, calls_floor))
    return row(name, median(times_ours) * 1e6, median(times_floor) * 1e6, "us", rounds * calls_ours)


def _calls_in(work: Callable[[], object], batch_s: float) -> int:
    """How many calls fill a batch; the very first, which may import and allocate, does not count."""
    work()
    started, calls = time.perf_counter(), 0
    while (spent := time.perf_counter() - started) < WARM_UP_S:
        work()
        calls += 1
    return max(round(calls * batch_s / spent), 1)


def _time(work: Callable[[], object], calls: int) -> float:
    """Seconds a call."""
    started = time.perf_counter()
    for _ in range(calls):
        work()
    return (time.perf_counter() - started) / calls
