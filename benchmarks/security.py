"""What security costs: from a posterior put to the judgement received, at a plain router and a secured one by turns.

In another process run two routers, one plain, one with mutual TLS and the scene's access rules, and a fusion service
with its referee at each. Here one observer speaks to either in turn, RATE_HZ times a second each, and a hub hears the
judgements. All that differs are TLS and the rules.
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

from benchmarks.bare_zenoh import SOON_S
from benchmarks.mesh import first_judged
from benchmarks.posteriors import beliefs, message, scene_of
from benchmarks.timing import Row, row
from common.config import MeshConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link, Publisher
from common.wire import encode
from deploy.security.issuing import create_authority, open_authority
from deploy.security.register import Roles
from deploy.security.router_config import router_config

RATE_HZ = 60.0
FRAMES = 480
WARM_UP = 30
OBSERVER, FUSION, HUB, ROUTER = "cam1", "fusion", "hub", "router"
MACHINES = {
    ROUTER: Roles(router=True),
    OBSERVER: Roles(observers=(OBSERVER,)),
    FUSION: Roles(fusions=(FUSION,)),
    HUB: Roles(hub=True),
}


def rows(frames: int = FRAMES) -> Iterator[Row]:
    """Median and 99th percentile, secured against plain; raises LabanmeshError when the processes do not meet."""
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
    other = spawn.Process(target=judging_process, args=(folder, there), daemon=True)
    other.start()
    there.close()
    try:
        endpoints = here.recv() if here.poll(SOON_S) else []
        with ExitStack() as links:
            ways = [_way(_mesh(endpoint, folder, ROUTER), folder, links) for endpoint in endpoints]
            if len(ways) != 2:
                raise LabanmeshError("the fusion process of the benchmark did not start; what it wrote above says why")
            plain, secured = _spoken(ways, frames)
            return plain, secured
    finally:
        here.close()
        other.join(SOON_S)


def judging_process(folder: Path, pipe: Connection) -> None:
    """The other process: both routers, and a fusion service at each, until the pipe breaks."""
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
        # The end of the pipe is the end of the benchmark, however it came about.
        with suppress(EOFError, OSError):
            pipe.recv()
        stop.set()
        for thread in threads:
            thread.join(SOON_S)


def _way(mesh: MeshConfig, folder: Path, links: ExitStack) -> tuple[Publisher, Inbox]:
    """An observer's voice and a hub's ear at one router."""
    keys = _scene(mesh).keys
    ear = links.enter_context(Link.open(_mesh(mesh.endpoint, folder, HUB), "hub"))
    mouth = links.enter_context(Link.open(_mesh(mesh.endpoint, folder, OBSERVER), "observer", process_id=OBSERVER))
    inbox, voice = ear.inbox(keys.judgement, limit=1_000_000), mouth.publisher(keys.posterior(OBSERVER))
    if not voice.wait_for_subscriber(SOON_S) or not inbox.take(SOON_S):
        raise LabanmeshError(f"{mesh.endpoint}: observer and fusion did not meet; is loopback TCP allowed here?")
    return voice, inbox


def _spoken(ways: list[tuple[Publisher, Inbox]], frames: int) -> list[list[int]]:
    """Frames at RATE_HZ to each way, half an interval apart; how long each took to be judged."""
    put: list[dict[tuple[str, int], int]] = [{} for _ in ways]
    due = time.monotonic()
    for seq in range(WARM_UP + frames):
        for times, (voice, _) in zip(put, ways, strict=True):
            captured_ns, (belief,) = time.time_ns(), beliefs(1, seed=seq)
            payload = encode(message(OBSERVER, seq, captured_ns, belief))
            if seq >= WARM_UP:
                times[OBSERVER, captured_ns] = time.time_ns()
            voice.put(payload)
            due += 0.5 / RATE_HZ
            time.sleep(max(due - time.monotonic(), 0.0))
    time.sleep(0.5)  # the last judgements are on their way
    return [_taken(times, inbox) for times, (_, inbox) in zip(put, ways, strict=True)]


def _taken(put: dict[tuple[str, int], int], inbox: Inbox) -> list[int]:
    judged = first_judged(put, inbox.take(0.0))
    if len(judged) < 0.9 * len(put):
        raise LabanmeshError(f"{len(put) - len(judged)} of {len(put)} posteriors were never judged")
    return [judged[said] - put[said] for said in judged]
