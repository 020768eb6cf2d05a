"""`python -m benchmarks.scale.measure`: measures everything on this machine that benchmarks/scale rests on.

Costs of the parts of a fusion process (parts.py, traffic.py), whole runs of benchmarks.crowd, liveliness tokens. With
--write FILE, values that are not measured now stay: `--parts runs --write FILE` measures the runs alone.
"""

import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.command_line import run_command
from benchmarks.crowd.trial import TICKS_S, CrowdPlan, run_trial
from benchmarks.scale.measured import WAKE_RANKS
from benchmarks.scale.parts import measure_parts
from benchmarks.scale.traffic import forwarding_cost, token_costs
from common.text import one_of, split_list
from studies.report import write_text

PARTS = ("costs", "runs", "tokens")
NAP_S = 0.005


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


if __name__ == "__main__":
    sys.exit(run_command(measure, "scale.measure"))
