"""What security costs: from a posterior put to the judgement received, through a plain and a secured router by turns.

Another process runs two routers, one plain, one with mutual TLS and the scene's access rules, and a fusion service at
each. Here one observer publishes to either in turn, at RATE_HZ each, and a hub receives the judgements. Only TLS and
the rules differ.
"""

import multiprocessing
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.bare_zenoh import TIMEOUT_S
from benchmarks.mesh import FRAMES, RATE_HZ, WARM_UP, Captured, first_judged
from benchmarks.posteriors import message, random_posteriors, scene_of
from benchmarks.timing import BenchmarkRow, row
from common.config import MeshConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link, Publisher
from common.wire import encode
from deploy.security.issuing import create_authority, open_authority
from deploy.security.register import Roles
from deploy.security.router_config import router_config

OBSERVER, FUSION, HUB, ROUTER = "cam1", "fusion", "hub", "router"
MACHINES = {
    ROUTER: Roles(router=True),
    OBSERVER: Roles(observers=(OBSERVER,)),
    FUSION: Roles(fusions=(FUSION,)),
    HUB: Roles(hub=True),
}


def rows(frames: int = FRAMES) -> Iterator[BenchmarkRow]:
    """Median and 99th percentile, secured against plain; raises LabanmeshError when the processes do not connect."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "secure"
        _certify(folder)
        plain, secured = _measured(folder, frames)
    for word, percentile in (("median", 50), ("p99", 99)):
        ours, floor = (float(np.percentile(times, percentile)) / 1e6 for times in (secured, plain))
        yield row(f"put to judgement, TLS and rules, {word}, floor: plain router", ours, floor, "ms", len(secured))


def _certify(folder: Path) -> None:
    now = datetime.now(UTC)
    authority = create_authority(folder, [scene_of(1)], now)
    for name, roles in MACHINES.items():
        authority.add(name, roles, ("127.0.0.1",), now)


def _mesh(endpoint: str, folder: Path, name: str) -> MeshConfig:
    credentials = str(folder / f"{name}.1") if endpoint.startswith("tls/") else ""
    return MeshConfig(mode="router", endpoint=endpoint, credentials=credentials)


def _scene(mesh: MeshConfig) -> Scene:
    return scene_of(1).model_copy(update={"mesh": mesh})


def _measured(folder: Path, frames: int) -> tuple[list[int], list[int]]:
    """Nanoseconds from put to judgement: through the plain router, through the secured one."""
    # Spawn: a child forked from a process with a Zenoh session hangs when it closes.
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    other = spawn.Process(target=_fusion_process, args=(folder, there), daemon=True)
    other.start()
    there.close()
    try:
        endpoints = here.recv() if here.poll(TIMEOUT_S) else []
        with ExitStack() as links:
            ways = [_connected(_mesh(endpoint, folder, ROUTER), folder, links) for endpoint in endpoints]
            if len(ways) != 2:
                raise LabanmeshError("the fusion process of the benchmark did not start; its output above says why")
            plain, secured = _publish(ways, frames)
            return plain, secured
    finally:
        here.close()
        other.join(TIMEOUT_S)


def _fusion_process(folder: Path, pipe: Connection) -> None:
    """Both routers and a fusion service at each, until the pipe breaks."""
    from fusion.server import serve

    stop = threading.Event()
    threads, endpoints = [], []
    with ExitStack() as links:
        for listen in ("tcp/127.0.0.1:0", "tls/127.0.0.1:0"):
            scene = _scene(_mesh(listen, folder, ROUTER))
            register = open_authority(folder, [scene]).register if scene.mesh.credentials else None
            router = links.enter_context(
                Link.router(router_config([scene], register, [listen]), "the benchmark's router")
            )
            endpoints.append(router.locator)
            link = links.enter_context(Link.open(_mesh(router.locator, folder, FUSION), "fusion", process_id=FUSION))
            threads.append(threading.Thread(target=serve, args=([scene], scene.fusion.id, link, stop), daemon=True))
            threads[-1].start()
        pipe.send(endpoints)
        # A broken pipe ends the benchmark, whatever the reason.
        with suppress(EOFError, OSError):
            pipe.recv()
        stop.set()
        for thread in threads:
            thread.join(TIMEOUT_S)


def _connected(mesh: MeshConfig, folder: Path, links: ExitStack) -> tuple[Publisher, Inbox]:
    """An observer's publisher and a hub's inbox at one router."""
    keys = _scene(mesh).keys
    hub = links.enter_context(Link.open(_mesh(mesh.endpoint, folder, HUB), "hub"))
    observer = links.enter_context(Link.open(_mesh(mesh.endpoint, folder, OBSERVER), "observer", process_id=OBSERVER))
    inbox, publisher = hub.inbox(keys.judgement, limit=1_000_000), observer.publisher(keys.posterior(OBSERVER))
    if not publisher.wait_for_subscriber(TIMEOUT_S) or not inbox.take(TIMEOUT_S):
        raise LabanmeshError(f"{mesh.endpoint}: observer and fusion did not connect; is loopback TCP allowed here?")
    return publisher, inbox


def _publish(ways: list[tuple[Publisher, Inbox]], frames: int) -> list[list[int]]:
    """Frames at RATE_HZ through each router, half an interval apart; how long each took to be judged."""
    put: list[dict[Captured, int]] = [{} for _ in ways]
    due = time.monotonic()
    for seq in range(WARM_UP + frames):
        for times, (publisher, _) in zip(put, ways, strict=True):
            captured_ns, (p,) = time.time_ns(), random_posteriors(1, seed=seq)
            payload = encode(message(seq, captured_ns, p))
            if seq >= WARM_UP:
                times[Captured(OBSERVER, captured_ns)] = time.time_ns()
            publisher.put(payload)
            due += 0.5 / RATE_HZ
            time.sleep(max(due - time.monotonic(), 0.0))
    time.sleep(0.5)  # the last judgements are on their way
    return [_latencies(times, inbox) for times, (_, inbox) in zip(put, ways, strict=True)]


def _latencies(put: dict[Captured, int], inbox: Inbox) -> list[int]:
    judged = first_judged(put, inbox.take(0.0))
    if len(judged) < 0.9 * len(put):
        raise LabanmeshError(f"{len(put) - len(judged)} of {len(put)} posteriors were never judged")
    return [judged[captured] - put[captured] for captured in judged]
