"""Rows of `make bench`: a figure and its floor, timed by turns so that disturbances affect both; costs of processes."""

import os
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

ROUNDS = 15
BATCH_S = 0.01
"""Least duration of one batch of calls: far above the clock's resolution, short against disturbances."""
WARM_UP_S = 0.02
TICKS_S = 1 / os.sysconf("SC_CLK_TCK")
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class BenchmarkRow:
    """One figure: `ours` and `floor` in `unit`, ratio = ours / floor; n: how many times ours was measured.

    goal: what ours should be at most, or with `at_least` at least; None: there is none.
    """

    name: str
    ours: float
    floor: float
    ratio: float
    unit: str
    n: int
    goal: float | None = None
    at_least: bool = False

    @property
    def holds(self) -> bool:
        """Whether the goal is reached, if there is one."""
        return self.goal is None or (self.ours >= self.goal if self.at_least else self.ours <= self.goal)


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A part of the benchmarks that could not be measured here, and why, in one line."""

    name: str
    reason: str


def row(
    name: str, ours: float, floor: float, unit: str, n: int, goal: float | None = None, *, at_least: bool = False
) -> BenchmarkRow:
    """A row with its ratio."""
    return BenchmarkRow(name, ours, floor, ours / floor, unit, n, goal, at_least)


def medians(runs: Sequence[Sequence[BenchmarkRow]]) -> list[BenchmarkRow]:
    """Each row with the medians of its runs; n: of all together."""
    return [
        row(
            own[0].name, median(r.ours for r in own), median(r.floor for r in own), own[0].unit, sum(r.n for r in own),
            own[0].goal, at_least=own[0].at_least,
        )
        for own in zip(*runs, strict=True)
    ]  # fmt: skip


def compare(
    name: str, ours: Callable[[], object], floor: Callable[[], object], rounds: int = ROUNDS, batch_s: float = BATCH_S
) -> BenchmarkRow:
    """Microseconds per call, the median over `rounds`; the two alternate, and so does which goes first."""
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
    """How many calls fill a batch; the first call, which may import and allocate, does not count."""
    work()
    started, calls = time.perf_counter(), 0
    while (spent := time.perf_counter() - started) < WARM_UP_S:
        work()
        calls += 1
    return max(round(calls * batch_s / spent), 1)


def _time(work: Callable[[], object], calls: int) -> float:
    """Seconds per call."""
    started = time.perf_counter()
    for _ in range(calls):
        work()
    return (time.perf_counter() - started) / calls


def free_port() -> int:
    """A TCP port that is free on this machine now."""
    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


def cpu_seconds(pid: int | None) -> float:
    """User and system time of a process, all threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICKS_S


def resident_bytes(pid: int | None) -> int:
    """Resident memory of a process."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES
