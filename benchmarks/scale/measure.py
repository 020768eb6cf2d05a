"""`python -m benchmarks.scale.measure`: measures everything that the simulation of benchmarks/scale rests on."""

import argparse
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
from typing import Any

import numpy as np

from benchmarks.crowd.trial import PAGE, TICKS_S, Plan, free_port, run
from benchmarks.scale.measured import WAKE_RANKS, Tokens
from benchmarks.scale.parts import measured_parts
from benchmarks.scale.traffic import forwarding
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link

PARTS = ("costs", "runs", "tokens")
SCENES = (1, 25, 250)
NAP_S = 0.005


def main() -> int:
    """Measures, prints JSON, and writes it where asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale.measure", description=__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--scenes", nargs="+", type=int, default=SCENES, help="of the runs (default 1 25 250)")
    parser.add_argument("--minutes", type=float, default=0.5, help="of each run (default 0.5)")
    parser.add_argument("--write", type=Path, help="file to write; what is in it and not measured now stays")
    given = parser.parse_args()
    told = json.loads(given.write.read_text("utf-8")) if given.write and given.write.exists() else {}
    told |= {"date": f"{datetime.now(UTC):%Y-%m-%d}", "machine": machine()}
    try:
        if "costs" in given.parts:
            costs, sizes = measured_parts()
            costs["forward"] = round(forwarding(), 2)
            told |= {"costs_us": costs, "sizes": told.get("sizes", {}) | sizes}
        if "runs" in given.parts:
            told["runs"] = [one_run(scenes, given.minutes * 60) for scenes in given.scenes]
            told["sizes"] |= memory(told["runs"])
        if "tokens" in given.parts:
            told["tokens"] = [asdict(known) for known in tokens()]
    except LabanmeshError as error:
        print(f"costs: {error}", file=sys.stderr)
        return error.exit_status
    text = json.dumps(told, indent=1) + "\n"
    print(text)
    if given.write:
        given.write.write_text(text, "utf-8")
    return 0


def machine() -> str:
    """In words: processors, and how busy they are."""
    info = Path("/proc/cpuinfo").read_text("utf-8")
    names = [line.partition(":")[2].strip() for line in info.splitlines() if line.startswith("model name")]
    return f"{os.cpu_count()} processors {names[0] if names else ''}, load average {os.getloadavg()[0]:.1f}"


def one_run(scenes: int, seconds: float) -> dict[str, Any]:
    """benchmarks.crowd, and how late sleepers were woken meanwhile."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    wakes: Queue[list[float]] = context.Queue()
    watcher = context.Process(target=watch_wakes, args=(stop, wakes))
    watcher.start()
    busy_s, begun_s = _busy_s(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(Plan(scenes, 30.0, seconds), Path(folder), lambda line: print(line, file=sys.stderr, flush=True))
    busy = (_busy_s() - busy_s) / (time.monotonic() - begun_s)
    stop.set()
    wake_ms = wakes.get(timeout=60)
    watcher.join()
    share = (outcome.processes[0].ended_cpu_s - outcome.processes[0].begun_cpu_s) / outcome.seconds
    ages, process = np.array(outcome.account.ages_s or [0.0]) * 1e3, outcome.processes[0]
    return {
        "scenes": scenes,
        "rate_hz": 30.0,
        "seconds": round(outcome.seconds, 1),
        "core_share": round(share, 4),
        "left": round((os.cpu_count() or 1) - max(busy - share, 0.0), 3),
        "judgements_hz": round(outcome.account.judgements / outcome.seconds, 1),
        "age_median_ms": round(float(np.percentile(ages, 50)), 2),
        "age_p99_ms": round(float(np.percentile(ages, 99)), 2),
        "crowd_late_ms": round(outcome.account.late_s * 1e3, 1),
        "memory_mb": round(process.last_bytes / 1e6, 1),
        "wake_ms": wake_ms,
        "load": round(os.getloadavg()[0], 1),
    }


def _busy_s() -> float:
    """Of all processors together since the start, taken away by the hypervisor included."""
    user, nice, system, _, _, irq, softirq, steal = map(int, Path("/proc/stat").read_text().split()[1:9])
    return (user + nice + system + irq + softirq + steal) * TICKS_S


def watch_wakes(stop: Event, told: "Queue[list[float]]") -> None:
    """In a process of its own: by how much a sleep of 5 ms was longer, in ms at WAKE_RANKS."""
    late_ms: list[float] = []
    while not stop.is_set():
        begun_s = time.monotonic()
        time.sleep(NAP_S)
        late_ms.append((time.monotonic() - begun_s - NAP_S) * 1e3)
    told.put([round(float(late), 3) for late in np.quantile(late_ms, WAKE_RANKS)])


def memory(runs: Sequence[dict[str, Any]]) -> dict[str, float]:
    """MB of a process of many scenes without them, and of each scene: a line through the runs of many scenes."""
    many = [run for run in runs if run["scenes"] > 1]
    scene_mb, process_mb = np.polyfit([run["scenes"] for run in many], [run["memory_mb"] for run in many], 1)
    return {"process_mb": round(float(process_mb), 1), "scene_mb": round(float(scene_mb), 3)}


if __name__ == "__main__":
    sys.exit(main())


DECLARED = (0, 1_000, 3_000, 10_000)
PATIENCE_S = 120.0


def tokens() -> Iterator[Tokens]:
    """For each of DECLARED: declared in a process of its own, and another that asks for them."""
    context = multiprocessing.get_context("spawn")
    for count in DECLARED:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        told: Queue[float] = context.Queue()
        heard: Queue[tuple[float | None, float]] = context.Queue()
        stop = context.Event()
        declarer = context.Process(target=declare, args=(endpoint, count, told, stop))
        declarer.start()
        try:
            declare_s = told.get(timeout=PATIENCE_S)
            listener = context.Process(target=listen, args=(endpoint, count, heard))
            listener.start()
            known_s, listener_mb = heard.get(timeout=PATIENCE_S)
            listener.join()
            if known_s is None:
                raise LabanmeshError(f"{count} tokens were not all known within {PATIENCE_S:.0f} s")
            stop.set()
            declarer_mb = told.get(timeout=10)
        finally:
            stop.set()
            declarer.join()
        yield Tokens(count, round(declare_s, 3), round(known_s, 3), round(listener_mb, 1), round(declarer_mb, 1))


def declare(endpoint: str, count: int, told: "Queue[float]", stop: Event) -> None:
    """In a process of its own: so many tokens, until `stop`."""
    with Link.open(MeshConfig(endpoint=endpoint), "fusion") as link:
        begun_s = time.monotonic()
        for number in range(count):
            link.announce(SceneKeys(f"home{number}").fusion_alive("fusion"))
        told.put(time.monotonic() - begun_s)
        stop.wait(PATIENCE_S)
        told.put(resident_mb())


def listen(endpoint: str, count: int, heard: "Queue[tuple[float | None, float]]") -> None:
    """In a process of its own: how long it takes to know them all, and its memory then."""
    begun_s = time.monotonic()
    with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
        known = link.presence("laban/*/fusion/*/alive").wait_for(count, PATIENCE_S)
        heard.put((time.monotonic() - begun_s if known else None, resident_mb()))


def resident_mb() -> float:
    """Of this process, now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6
