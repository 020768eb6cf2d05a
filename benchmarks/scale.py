"""`python -m benchmarks.scale`: what growing costs: a fusion process with ever more scenes, liveliness tokens.

Whole runs of benchmarks.crowd, and for a number of tokens what another process needs to know them all.
"""

import multiprocessing
import os
import sys
import tempfile
import time
from datetime import UTC, datetime
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.command_line import markdown_table, read_page, replace_table, run_command
from benchmarks.crowd.crowd import OBSERVERS
from benchmarks.crowd.trial import CrowdPlan, run_trial
from benchmarks.timing import free_port, resident_bytes
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link
from studies.output_files import write_text

BEGIN = "<!-- scale: from here to the end mark, `make scale` writes -->"
END = "<!-- scale: end -->"
SCENES = (1, 25, 250)
RATE_HZ = 30.0
"""Posteriors a second of each observer."""
DECLARED = (0, 1_000, 3_000, 10_000)
TIMEOUT_S = 120.0
"""For each number of tokens."""


def scale(
    minutes: Annotated[float, typer.Option(min=0.1, help="Duration of each run.")] = 0.5,
    page: Annotated[Path | None, typer.Option(help="A markdown page whose tables are replaced.")] = None,
) -> None:
    """Measure fusion processes with 1, 25 and 250 scenes, and the cost of liveliness tokens; print the tables.

    Example: python -m benchmarks.scale --page docs/design/scale.md
    """
    text = read_page(page, BEGIN, END)
    head = f"Measured on {datetime.now(UTC):%Y-%m-%d}: {_machine()}."
    tables = "\n\n".join([head, _runs(minutes * 60), _tokens()])
    print(tables)
    if page:
        write_text(page, replace_table(text, tables, BEGIN, END), "--page")


def _machine() -> str:
    """The processors and the load of this machine, as text."""
    info = Path("/proc/cpuinfo").read_text("utf-8")
    names = [line.partition(":")[2].strip() for line in info.splitlines() if line.startswith("model name")]
    return f"{os.cpu_count()} processors {names[0] if names else ''}, load average {os.getloadavg()[0]:.1f}"


def _runs(seconds: float) -> str:
    """A run of benchmarks.crowd for each number of scenes."""
    head = ["scenes", "observers", "share of a core", "judgements a second", "age, median", "age, 99 %", "memory"]
    rows = []
    for scenes in SCENES:
        with tempfile.TemporaryDirectory() as folder:
            plan = CrowdPlan(scenes, RATE_HZ, seconds)
            result = run_trial(plan, Path(folder), lambda line: print(line, file=sys.stderr, flush=True))
        counts, process = result.counts, result.processes[0]
        share = (process.ended_cpu_s - process.begun_cpu_s) / result.seconds
        median_ms, p99_ms = np.percentile(np.array(counts.ages_s or [0.0]) * 1e3, (50, 99))
        rows.append(
            [f"{scenes:,}", f"{OBSERVERS * scenes:,}", f"{share:.2f}", f"{counts.judgements / result.seconds:,.0f}",
             f"{median_ms:.0f} ms", f"{p99_ms:.0f} ms", f"{process.last_bytes / 1e6:.0f} MB"]
        )  # fmt: skip
    return markdown_table(head, rows)


def _tokens() -> str:
    """What each number of tokens costs."""
    head = ["tokens", "declared in", "all known in", "memory of the subscriber", "of the declarer"]
    rows = [[f"{count:,}", *_token_costs(count)] for count in DECLARED]
    return markdown_table(head, rows)


def _token_costs(count: int) -> list[str]:
    """One process declares that many tokens, another one queries them.

    Without routers every process that queries liveliness holds every matching token; a router holds all of them.
    """
    context = multiprocessing.get_context("spawn")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    declared: Queue[float] = context.Queue()
    known: Queue[tuple[float | None, float]] = context.Queue()
    stop = context.Event()
    declarer = context.Process(target=declare, args=(endpoint, count, declared, stop))
    declarer.start()
    try:
        declare_s = declared.get(timeout=TIMEOUT_S)
        listener = context.Process(target=query, args=(endpoint, count, known))
        listener.start()
        known_s, listener_mb = known.get(timeout=TIMEOUT_S + 10.0)
        listener.join()
        if known_s is None:
            raise LabanmeshError(f"{count} tokens were not all known within {TIMEOUT_S:g} s")
        stop.set()
        declarer_mb = declared.get(timeout=10)
    finally:
        stop.set()
        declarer.join()
    return [f"{declare_s:.2f} s", f"{known_s:.2f} s", f"{listener_mb:.0f} MB", f"{declarer_mb:.0f} MB"]


def declare(endpoint: str, count: int, results: "Queue[float]", stop: Event) -> None:
    """In its own process: declare the tokens and keep them until `stop`; sends the seconds, then the memory in MB."""
    with Link.open(MeshConfig(endpoint=endpoint), "fusion") as link:
        begun_s = time.monotonic()
        for number in range(count):
            link.announce(SceneKeys(f"home{number}").fusion_alive("fusion"))
        results.put(time.monotonic() - begun_s)
        stop.wait(TIMEOUT_S)
        results.put(resident_bytes(os.getpid()) / 1e6)


def query(endpoint: str, count: int, results: "Queue[tuple[float | None, float]]") -> None:
    """In its own process: wait until all tokens are known; sends the seconds and the memory in MB."""
    begun_s = time.monotonic()
    with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
        # Expected: of tokens that nobody expects only some are noted.
        expected = [SceneKeys(f"home{number}").fusion_alive("fusion") for number in range(count)]
        known = link.presence("laban/*/fusion/*/alive", expected).wait_for(count, TIMEOUT_S)
        results.put((time.monotonic() - begun_s if known else None, resident_bytes(os.getpid()) / 1e6))


if __name__ == "__main__":
    sys.exit(run_command(scale, "scale"))
