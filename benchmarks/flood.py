"""How many posteriors a second one fusion process takes on one core, judged ten times a second and scene.

SIMULATED observers (benchmarks/crowd) publish ever faster to one real `labanmesh fuse` process. A rate holds if the
process uses at most one core, all threads together, publishes the judgements that are due, and these are young when
they arrive. Floor: a bare Zenoh process that keeps the newest posterior of each observer and reads none, with the
processor time that it takes for each.
"""

import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median

import numpy as np
import zenoh

from benchmarks.bare_zenoh import TIMEOUT_S, open_bare
from benchmarks.crowd.crowd import OBSERVERS, Crowd, CrowdCounts, scene_name
from benchmarks.crowd.trial import IDS, FusionProcess, started, write_scenes
from benchmarks.timing import BenchmarkRow, cpu_seconds, free_port, row
from common.config import FusionConfig, MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link

SCENES = 250
RATES_HZ = (30.0, 60.0, 80.0, 100.0)
"""Of each observer: 30,000 to 100,000 posteriors a second in all."""
WARM_UP_S, WINDOW_S, SETTLE_S = 3.0, 3.0, 0.5
SHARING_S = 4.0
"""How long two processes take to share the scenes, and to settle."""
CORES = 4
START_TIMEOUT_S = 30.0
RUNS = 3
AGE_LIMIT_MS = 100.0
DUE = 0.95
"""Of the judgements that are due so many must arrive."""
FULL = 1.02
"""Of a core; processor time is counted in hundredths of a second."""


@dataclass(frozen=True, slots=True)
class FloodWindow:
    """One measured span. posteriors, judgements: per second; share: of one core; age_ms: p99 on arrival."""

    posteriors: float
    judgements: float
    share: float
    age_ms: float

    def holds(self, scenes: int) -> bool:
        """Whether the process kept up on one core."""
        due = scenes * FusionConfig().step_hz
        return self.share <= FULL and self.age_ms < AGE_LIMIT_MS and self.judgements >= DUE * due


def flood_rows(
    window_s: float = WINDOW_S, scenes: int = SCENES, rates_hz: Sequence[float] = RATES_HZ
) -> Iterator[BenchmarkRow]:
    """Posteriors a second at the highest rate that holds, and the share of a core and the ages meanwhile.

    Raises LabanmeshError when not even the lowest rate holds.
    """
    with flooded(scenes) as flood:
        windows = flood.climb(rates_hz, window_s)
    n = len(windows)
    posteriors, share = median(own.posteriors for own in windows), median(own.share for own in windows)
    age_ms = median(own.age_ms for own in windows)
    bare_us = bare_cost_us(scenes, rates_hz[0])
    name = f"posteriors a second into one fusion process, {scenes * OBSERVERS} observers"
    yield row(name, posteriors, 1e6 / bare_us, "/s", n, goal=100_000, at_least=True)
    yield row("of a core meanwhile, floor: bare Zenoh", share, posteriors * bare_us / 1e6, "core", n, goal=1.0)
    period_ms = 1e3 / FusionConfig().step_hz
    yield row("age of a judgement meanwhile, p99, floor: the step", age_ms, period_ms, "ms", n, goal=AGE_LIMIT_MS)


def sharing_row(scenes: int = SCENES // 2) -> BenchmarkRow:
    """How many times the load of one process two of them can take: its share of a core over that of the busier one.

    Raises LabanmeshError with fewer cores than the processes of the benchmark.
    """
    cores = len(os.sched_getaffinity(0))
    if cores < CORES:
        raise LabanmeshError(f"this machine has {cores} cores; two fusion processes and the crowd need {CORES}")
    shares = []
    for processes in (1, 2):
        with flooded(scenes, processes) as flood:
            flood.settle(SHARING_S)
            shares.append(max(window.share for window in flood.window(RATES_HZ[0], 2 * WINDOW_S)))
    one, two = shares
    return row("load of two fusion processes against one", one / two, 1.0, "times", 1, goal=1.8, at_least=True)


class Flood:
    """Fusion processes that run, and the crowd that publishes to them."""

    def __init__(self, crowd: Crowd, scenes: int, processes: Sequence[FusionProcess]) -> None:
        self._crowd, self._scenes, self._processes = crowd, scenes, processes

    def settle(self, seconds: float) -> None:
        """Publish for so long at the lowest rate, without measuring."""
        self._crowd.rate_hz = RATES_HZ[0]
        self._crowd.publish(seconds)

    def climb(self, rates_hz: Sequence[float], window_s: float) -> list[FloodWindow]:
        """RUNS windows at the highest rate that holds; raises LabanmeshError when none does."""
        self.settle(WARM_UP_S)
        best: tuple[float, FloodWindow] | None = None
        for rate_hz in rates_hz:
            (window,) = self.window(rate_hz, window_s)
            if not window.holds(self._scenes):
                break
            best = rate_hz, window
        if best is None:
            raise LabanmeshError(
                f"{window.posteriors:,.0f} posteriors a second were too many here, now: {window.share:.2f} of a core, "
                f"{window.judgements:,.0f} judgements a second, p99 of their age {window.age_ms:.0f} ms"
            )
        again = [own for _ in range(RUNS - 1) for own in self.window(best[0], window_s)]
        return [best[1], *again]

    def window(self, rate_hz: float, seconds: float) -> list[FloodWindow]:
        """One span at this rate, as each of the processes took it."""
        self._crowd.rate_hz = rate_hz
        # What piled up before, or while the rate changed, does not count.
        self._crowd.publish(SETTLE_S)
        self._crowd.counts = CrowdCounts()
        begun_s, cpu_s = time.monotonic(), [process.cpu_s for process in self._processes]
        self._crowd.publish(seconds)
        took_s, counts = time.monotonic() - begun_s, self._crowd.counts
        age_ms = float(np.percentile(counts.ages_s or [0.0], 99)) * 1e3
        return [
            FloodWindow(counts.put / took_s, counts.judgements / took_s, (process.cpu_s - before) / took_s, age_ms)
            for process, before in zip(self._processes, cpu_s, strict=True)
        ]


@contextmanager
def flooded(scenes: int, processes: int = 1) -> Iterator[Flood]:
    """Start fusion processes of `scenes` scenes, and connect the crowd; raises LabanmeshError if that fails."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
        write_scenes(Path(place), scenes, endpoint)
        running = [stack.enter_context(started(Path(place), name)) for name in IDS[:processes]]
        link = stack.enter_context(Link.open(MeshConfig(endpoint=endpoint), "observer"))
        crowd = Crowd(link, scenes, RATES_HZ[0])
        if not crowd.ready(START_TIMEOUT_S):
            raise LabanmeshError(f"not all observers found the fusion process within {START_TIMEOUT_S:g} s")
        yield Flood(crowd, scenes, running)


def bare_cost_us(scenes: int, rate_hz: float, seconds: float = 2.0) -> float:
    """Processor time of bare Zenoh for each posterior that it receives and nobody reads; all threads."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    receiver = spawn.Process(target=_keep_newest, args=(endpoint, scenes, there), daemon=True)
    receiver.start()
    there.close()
    try:
        if not here.poll(TIMEOUT_S):
            raise LabanmeshError("the bare receiver of the benchmark did not start")
        with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
            crowd = Crowd(link, scenes, rate_hz)
            if not crowd.ready(START_TIMEOUT_S):
                raise LabanmeshError("the bare receiver of the benchmark got no messages; is loopback TCP allowed?")
            crowd.publish(SETTLE_S)
            put, begun_s = crowd.counts.put, cpu_seconds(receiver.pid)
            crowd.publish(seconds)
            return (cpu_seconds(receiver.pid) - begun_s) / (crowd.counts.put - put) * 1e6
    finally:
        here.close()
        receiver.join(TIMEOUT_S)


def _keep_newest(endpoint: str, scenes: int, pipe: Connection) -> None:
    """A ring of one for each observer, until the pipe breaks."""
    keys = [
        SceneKeys(scene_name(n)).posterior(f"cam{observer}") for n in range(scenes) for observer in range(OBSERVERS)
    ]
    with open_bare({"mode": "peer", "listen/endpoints": [endpoint]}) as session:
        rings = [session.declare_subscriber(key, zenoh.handlers.RingChannel(1)) for key in keys]
        pipe.send(len(rings))
        with suppress(EOFError, OSError):
            pipe.recv()
