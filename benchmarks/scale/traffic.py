"""The cost of Zenoh's threads: for arriving messages, for messages that a router forwards, and for liveliness tokens.

A second process publishes in bursts, as a crowd does, while the loop of the first one sleeps.
"""

import multiprocessing
import time
from collections.abc import Iterator
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path

from benchmarks.crowd.crowd import templates
from benchmarks.crowd.trial import PAGE, cpu_seconds, free_port
from benchmarks.scale.measured import TokenCosts
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link

TIMEOUT_S = 20.0
MICRO = 1e6
BURSTS_HZ = 240
BURSTS_S = 3.0
SMALL, LARGE = 12, 125
"""Posteriors per burst: of a hundred observers at 30 Hz in eight slots, and of a thousand."""
SUBSCRIBED = 1000
"""Keys to which the measured link subscribes."""
DECLARED = (0, 1_000, 3_000, 10_000)
TOKENS_TIMEOUT_S = 120.0


def receiving_costs(link: Link, endpoint: str) -> dict[str, float]:
    """Microseconds of Zenoh's threads per posterior and burst into rings, and per posterior with a callback thread."""
    key = SceneKeys("burst").posterior
    with link.sub_session(polled=True) as polled:
        polled.inbox(*(key(f"cam{n}") for n in range(SUBSCRIBED)), ring=1)
        small, large = _burst_cost(endpoint, SMALL), _burst_cost(endpoint, LARGE)
    each = max((large - small) / (LARGE - SMALL), 0.0)
    with link.sub_session() as called:
        called.inbox(key("*"))
        call = _burst_cost(endpoint, SMALL)
    burst = max(small - SMALL * each, 0.0)
    return {"receive": each, "burst": burst, "call": (call - burst) / SMALL}


def _burst_cost(endpoint: str, size: int) -> float:
    """Processor time of this process per burst that another process publishes, in microseconds, minus idle time."""
    begun_s = time.process_time()
    time.sleep(BURSTS_S / 2)
    idle_s = (time.process_time() - begun_s) * 2
    context = multiprocessing.get_context("spawn")
    ready, go = context.Event(), context.Event()
    other = context.Process(target=publish_bursts, args=(MeshConfig(endpoint=endpoint), size, ready, go))
    other.start()
    if not ready.wait(TIMEOUT_S):
        raise LabanmeshError(f"the publishing process found no subscriber within {TIMEOUT_S:g} s")
    begun_s = time.process_time()
    go.set()
    other.join()
    return (time.process_time() - begun_s - idle_s) * MICRO / (BURSTS_HZ * BURSTS_S)


def publish_bursts(mesh: MeshConfig, size: int, ready: Event, go: Event) -> None:
    """In its own process: bursts of posteriors for BURSTS_S."""
    template = templates("burst", None)[0]
    with Link.open(mesh, "observer") as link:
        publishers = [link.publisher(SceneKeys("burst").posterior(f"cam{n}")) for n in range(size)]
        if all(publisher.wait_for_subscriber(10) for publisher in publishers):
            ready.set()
        go.wait(10)
        due_s = time.monotonic()
        for number in range(round(BURSTS_HZ * BURSTS_S)):
            payload = template.at(number, time.time_ns())
            for publisher in publishers:
                publisher.put(payload)
            due_s += 1 / BURSTS_HZ
            time.sleep(max(due_s - time.monotonic(), 0))


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
            known_s, listener_mb = known.get(timeout=TOKENS_TIMEOUT_S)
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
        results.put(_resident_mb())


def query(endpoint: str, count: int, results: "Queue[tuple[float | None, float]]") -> None:
    """In its own process: wait until all tokens are known; sends the seconds and the memory in MB."""
    begun_s = time.monotonic()
    with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
        known = link.presence("laban/*/fusion/*/alive").wait_for(count, TOKENS_TIMEOUT_S)
        results.put((time.monotonic() - begun_s if known else None, _resident_mb()))


def _resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6
