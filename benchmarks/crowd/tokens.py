"""What liveliness tokens cost: one process declares thousands, another's session is told of all of them.

On a mesh without borders every process that asks who is alive holds every token that matches; a router holds all.
"""

import multiprocessing
import time
from collections.abc import Iterator
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path

from benchmarks.crowd.trial import PAGE, free_port
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link
from studies.scale.measured import Tokens

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
