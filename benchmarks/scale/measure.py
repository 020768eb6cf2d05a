"""`python -m benchmarks.scale.measure`: measures everything on this machine that benchmarks/scale rests on.

Costs of the parts of a fusion process (parts.py) and of a router, whole runs of benchmarks.crowd, liveliness tokens.
With --write FILE, values that are not measured now stay: `--parts runs --write FILE` measures the runs alone.
"""

import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.command_line import run_command
from benchmarks.crowd.trial import CrowdPlan, run_trial
from benchmarks.scale.measured import WAKE_RANKS, TokenCosts
from benchmarks.scale.parts import BURSTS_HZ, BURSTS_S, LARGE, MICRO, TIMEOUT_S, measure_parts, publish_bursts
from benchmarks.timing import TICKS_S, cpu_seconds, free_port, resident_bytes
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link
from common.text import one_of, split_list
from studies.output_files import write_text

PARTS = ("costs", "runs", "tokens")
NAP_S = 0.005
DECLARED = (0, 1_000, 3_000, 10_000)
TOKENS_TIMEOUT_S = 120.0


def measure(
    parts: Annotated[str, typer.Option(help="What to measure, separated by commas.")] = ",".join(PARTS),
    scenes: Annotated[str, typer.Option(help="Scenes of the runs, separated by commas.")] = "1,25,250",
    minutes: Annotated[float, typer.Option(help="Duration of each run.")] = 0.5,
    write: Annotated[Path | None, typer.Option(help="File to update.")] = None,
) -> None:
    """Measure, print the result as JSON and update the file.

    Example: python -m benchmarks.scale.measure --write benchmarks/scale/measured.json
    """
    chosen = [one_of("--parts", part, PARTS) for part in split_list("--parts", parts)]
    values = json.loads(write.read_text("utf-8")) if write and write.exists() else {}
    values |= {"date": f"{datetime.now(UTC):%Y-%m-%d}", "machine": machine()}
    if "costs" in chosen:
        costs, sizes = measure_parts()
        costs["forward"] = round(forwarding_cost(), 2)
        values |= {"costs_us": costs, "sizes": values.get("sizes", {}) | sizes}
    if "runs" in chosen:
        values["runs"] = [measure_run(int(count), minutes * 60) for count in split_list("--scenes", scenes)]
        values["sizes"] |= memory(values["runs"])
    if "tokens" in chosen:
        values["tokens"] = [asdict(costs) for costs in token_costs()]
    text = as_json(values)
    print(text)
    if write:
        write_text(write, text, "--write")


def as_json(values: dict[str, Any]) -> str:
    """One value per line, and one line per entry of a list."""
    lines = []
    for name, value in values.items():
        entries = ",\n  ".join(map(json.dumps, value)) if isinstance(value, list) else ""
        lines.append(f" {json.dumps(name)}: " + (f"[\n  {entries}\n ]" if entries else json.dumps(value)))
    return "{\n" + ",\n".join(lines) + "\n}\n"


def machine() -> str:
    """The processors and the load of this machine, as text."""
    info = Path("/proc/cpuinfo").read_text("utf-8")
    names = [line.partition(":")[2].strip() for line in info.splitlines() if line.startswith("model name")]
    return f"{os.cpu_count()} processors {names[0] if names else ''}, load average {os.getloadavg()[0]:.1f}"


def measure_run(scenes: int, seconds: float) -> dict[str, Any]:
    """A run of benchmarks.crowd, with the wake-up delays during it."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    wakes: Queue[list[float]] = context.Queue()
    watcher = context.Process(target=watch_wakes, args=(stop, wakes))
    watcher.start()
    busy_s, begun_s = _busy_s(), time.monotonic()
    plan = CrowdPlan(scenes, 30.0, seconds)
    with tempfile.TemporaryDirectory() as folder:
        result = run_trial(plan, Path(folder), lambda line: print(line, file=sys.stderr, flush=True))
    busy = (_busy_s() - busy_s) / (time.monotonic() - begun_s)
    stop.set()
    wake_ms = wakes.get(timeout=60)
    watcher.join()
    counts, process = result.counts, result.processes[0]
    share = (process.ended_cpu_s - process.begun_cpu_s) / result.seconds
    ages_ms = np.array(counts.ages_s or [0.0]) * 1e3
    return {
        "scenes": scenes,
        "rate_hz": 30.0,
        "seconds": round(result.seconds, 1),
        "core_share": round(share, 4),
        "left": round((os.cpu_count() or 1) - max(busy - share, 0.0), 3),
        "judgements_hz": round(counts.judgements / result.seconds, 1),
        "age_median_ms": round(float(np.percentile(ages_ms, 50)), 2),
        "age_p99_ms": round(float(np.percentile(ages_ms, 99)), 2),
        "crowd_late_ms": round(counts.late_s * 1e3, 1),
        "memory_mb": round(process.last_bytes / 1e6, 1),
        "wake_ms": wake_ms,
        "load": round(os.getloadavg()[0], 1),
    }


def _busy_s() -> float:
    """Busy time of all processors since boot, including time taken by the hypervisor."""
    user, nice, system, _, _, irq, softirq, steal = map(int, Path("/proc/stat").read_text().split()[1:9])
    return (user + nice + system + irq + softirq + steal) * TICKS_S


def watch_wakes(stop: Event, results: "Queue[list[float]]") -> None:
    """In its own process: how much longer than 5 ms a sleep of 5 ms takes, in ms at WAKE_RANKS."""
    late_ms: list[float] = []
    while not stop.is_set():
        begun_s = time.monotonic()
        time.sleep(NAP_S)
        late_ms.append((time.monotonic() - begun_s - NAP_S) * 1e3)
    results.put([round(float(late), 3) for late in np.quantile(late_ms, WAKE_RANKS)])


def memory(runs: Sequence[dict[str, Any]]) -> dict[str, float]:
    """MB of a process without scenes, and per scene: a line through the runs of several scenes."""
    many = [run for run in runs if run["scenes"] > 1]
    scene_mb, process_mb = np.polyfit([run["scenes"] for run in many], [run["memory_mb"] for run in many], 1)
    return {"process_mb": round(float(process_mb), 1), "scene_mb": round(float(scene_mb), 3)}


def forwarding_cost() -> float:
    """Microseconds of a router's processor time per message; publisher and router are processes of their own."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    mesh = MeshConfig(mode="router", endpoint=endpoint)
    context = multiprocessing.get_context("spawn")
    up, stop, ready, go = context.Event(), context.Event(), context.Event(), context.Event()
    router = context.Process(target=route, args=(mesh, up, stop))
    router.start()
    try:
        if not up.wait(TIMEOUT_S):
            raise LabanmeshError(f"the router did not listen within {TIMEOUT_S:g} s")
        with Link.open(mesh, "hub") as link, link.sub_session(polled=True) as rings:
            rings.inbox(SceneKeys("burst").posterior("*"))
            publisher = context.Process(target=publish_bursts, args=(mesh, LARGE, ready, go))
            publisher.start()
            if not ready.wait(TIMEOUT_S):
                raise LabanmeshError(f"no connection over the router within {TIMEOUT_S:g} s")
            begun_s = cpu_seconds(router.pid)
            go.set()
            publisher.join()
            return (cpu_seconds(router.pid) - begun_s) * MICRO / (BURSTS_HZ * BURSTS_S * LARGE)
    finally:
        stop.set()
        router.join()


def route(mesh: MeshConfig, up: Event, stop: Event) -> None:
    """In its own process: the router."""
    with Link.open(mesh, "router", listen=[mesh.endpoint]):
        up.set()
        stop.wait()


def token_costs() -> Iterator[TokenCosts]:
    """For each of DECLARED: one process declares the tokens, another one queries them.

    Without routers every process that queries liveliness holds every matching token; a router holds all of them.
    """
    context = multiprocessing.get_context("spawn")
    for count in DECLARED:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        declared: Queue[float] = context.Queue()
        known: Queue[tuple[float | None, float]] = context.Queue()
        stop = context.Event()
        declarer = context.Process(target=declare, args=(endpoint, count, declared, stop))
        declarer.start()
        try:
            declare_s = declared.get(timeout=TOKENS_TIMEOUT_S)
            listener = context.Process(target=query, args=(endpoint, count, known))
            listener.start()
            known_s, listener_mb = known.get(timeout=TOKENS_TIMEOUT_S + 10.0)
            listener.join()
            if known_s is None:
                raise LabanmeshError(f"{count} tokens were not all known within {TOKENS_TIMEOUT_S:g} s")
            stop.set()
            declarer_mb = declared.get(timeout=10)
        finally:
            stop.set()
            declarer.join()
        yield TokenCosts(count, round(declare_s, 3), round(known_s, 3), round(listener_mb, 1), round(declarer_mb, 1))


def declare(endpoint: str, count: int, results: "Queue[float]", stop: Event) -> None:
    """In its own process: declare the tokens and keep them until `stop`; sends the seconds, then the memory in MB."""
    with Link.open(MeshConfig(endpoint=endpoint), "fusion") as link:
        begun_s = time.monotonic()
        for number in range(count):
            link.announce(SceneKeys(f"home{number}").fusion_alive("fusion"))
        results.put(time.monotonic() - begun_s)
        stop.wait(TOKENS_TIMEOUT_S)
        results.put(resident_bytes(os.getpid()) / 1e6)


def query(endpoint: str, count: int, results: "Queue[tuple[float | None, float]]") -> None:
    """In its own process: wait until all tokens are known; sends the seconds and the memory in MB."""
    begun_s = time.monotonic()
    with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
        # Expected: of tokens that nobody expects only some are noted.
        expected = [SceneKeys(f"home{number}").fusion_alive("fusion") for number in range(count)]
        known = link.presence("laban/*/fusion/*/alive", expected).wait_for(count, TOKENS_TIMEOUT_S)
        results.put((time.monotonic() - begun_s if known else None, resident_bytes(os.getpid()) / 1e6))


if __name__ == "__main__":
    sys.exit(run_command(measure, "scale.measure"))
