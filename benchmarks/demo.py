"""The demo as its visitors have it: on this machine as it is, beside a busy core, and all of it on one core.

`python -m benchmarks.demo --runs 10` runs `labanmesh demo` so often in each situation, one after the other, and prints
a row for each run and for each situation. Linux only: it pins processes to cores.
"""

import argparse
import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

COUNTS = re.compile(r"(\d+) of \d+ right, (\d+) wrong, (\d+) undecided")
BEGIN, END = "starting four observers", "votes in time"
"""Lines of the demo's output between which the processes run."""
SITUATIONS = ("quiet", "beside one busy core", "all on one core")


@dataclass(frozen=True, slots=True)
class DemoRun:
    """Movements by their verdict, first word; wrong: also by the last word. Seconds of the live part, and of all."""

    right: int
    wrong: int
    undecided: int
    live_s: float
    total_s: float


def run_demo(situation: str, more: Sequence[str]) -> DemoRun:
    """One demo; more: further options. Raises RuntimeError if it fails."""
    core = min(os.sched_getaffinity(0))
    pinned = (lambda: os.sched_setaffinity(0, {core})) if situation == "all on one core" else None
    with tempfile.TemporaryDirectory() as folder, _busy(core, situation == "beside one busy core"):
        command = [sys.executable, "-P", "-m", "labanmesh", "demo", "--output", folder, *more]
        begun_s = time.monotonic()
        at_s: dict[str, float] = {}
        counts: list[list[int]] = []
        with subprocess.Popen(  # noqa: S603 - our own command
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, preexec_fn=pinned
        ) as process:
            for line in process.stdout or ():
                at_s |= {mark: time.monotonic() for mark in (BEGIN, END) if line.startswith(mark)}
                counts += [[int(n) for n in numbers] for numbers in COUNTS.findall(line)]
        if process.returncode or not counts:
            raise RuntimeError(f"labanmesh demo ended with status {process.returncode}")
        right, wrong, undecided = counts[0]
        wrong = max(wrong, *(other for _, other, _ in counts))
        return DemoRun(right, wrong, undecided, at_s[END] - at_s[BEGIN], time.monotonic() - begun_s)


@contextmanager
def _busy(core: int, wanted: bool) -> Iterator[None]:
    """Another process that keeps the core busy, if wanted."""
    hog = multiprocessing.get_context("spawn").Process(target=_burn, args=(core,), daemon=True) if wanted else None
    if hog is not None:
        hog.start()
    try:
        yield
    finally:
        if hog is not None:
            hog.kill()


def _burn(core: int) -> None:
    os.sched_setaffinity(0, {core})
    while True:
        pass


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--situation", choices=SITUATIONS, action="append")
    options, more = parser.parse_known_args()
    row = "{:<22}{:>6}{:>7}{:>7}{:>11}{:>8}{:>8}".format
    print(row("situation", "run", "right", "wrong", "undecided", "live s", "all s"), flush=True)
    for situation in options.situation or SITUATIONS:
        runs = []
        for n in range(1, options.runs + 1):
            runs.append(run := run_demo(situation, more))
            seconds = (f"{run.live_s:.1f}", f"{run.total_s:.1f}")
            print(row(situation, n, run.right, run.wrong, run.undecided, *seconds), flush=True)
        rights = [run.right for run in runs]
        live_s, total_s = max(run.live_s for run in runs), max(run.total_s for run in runs)
        wrong, undecided = sum(run.wrong for run in runs), sum(run.undecided for run in runs)
        worst = (f"{live_s:.1f}", f"{total_s:.1f}")
        print(row(situation, "all", f"{min(rights)}-{max(rights)}", wrong, undecided, *worst), flush=True)


if __name__ == "__main__":
    main()
