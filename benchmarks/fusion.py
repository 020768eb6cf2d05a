"""What fusion costs: one step, each fusion rule, and posteriors per second from sixteen publishers.

Floors:
- a step from bytes to bytes, as in the service (decode, receive four posteriors, fuse, encode): the four posteriors
  unpacked by bare msgpack, their weighted sum with fixed weights in numpy, and the sum packed.
- a step from messages to judgement: four lists made an array, and the weighted sum.
- a rule: the plain mean over observers of the same array.
- posteriors per second: bare Zenoh into a FIFO channel that one loop drains and unpacks. Of a flood, `labanmesh fuse`
  decodes only the newest posterior of each observer, so both its counts are shown: received, and decoded.
"""

import multiprocessing
import os
import re
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from statistics import median
from subprocess import Popen
from typing import TypeVar

import msgpack
import numpy as np

from benchmarks.bare_zenoh import TIMEOUT_S, drain
from benchmarks.crowd.crowd import NAMES as CROWD_NAMES
from benchmarks.crowd.crowd import PosteriorTemplate
from benchmarks.crowd.trial import stop_process
from benchmarks.posteriors import NAMES, engine_of, message, random_posteriors, scene_of
from benchmarks.timing import BATCH_S, ROUNDS, BenchmarkRow, compare, free_port, row
from common.config import FusionConfig, MeshConfig
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage
from common.probability import uniform
from common.wire import decode_from, encode
from fusion.engine.rules import RULES
from studies.fusion_engine import FusionEngine

OBSERVERS = 4
STEPS = 200
"""Different steps before a new engine receives them all again: an engine takes no posterior twice."""
START_NS = 1_700_000_000_000_000_000
FRAME_NS = 16_666_667
AGE_NS = 5_000_000
"""Age of the posteriors when they are fused."""
BYTES_GOALS_US = {0: 150.0, 2: 220.0, 3: 260.0}
"""By the number of facets that each observer sends: none, those that a front view shows, those beside it."""
STEP_GOAL_US, POOL_GOAL_US = 100.0, 30.0
T = TypeVar("T")


def pace_rows(rounds: int = ROUNDS, batch_s: float = BATCH_S) -> list[BenchmarkRow]:
    """A step from bytes to bytes by facets, one from messages to judgement, and the pool of the default rule."""
    return [
        *(row for facets in BYTES_GOALS_US for row in _step_rows(facets, rounds, batch_s)),
        replace(pool_row(FusionConfig().rule, rounds, batch_s), goal=POOL_GOAL_US),
    ]


def _step_rows(facets: int, rounds: int, batch_s: float) -> Iterator[BenchmarkRow]:
    """A step with as many facets from bytes to bytes; without facets also from messages to judgement."""
    steps = _steps(facets)
    payloads = [(now_ns, [encode(one) for one in messages]) for now_ns, messages in steps]
    packed, lists = payloads[0][1], [one.p for one in steps[0][1]]
    weights = np.full(OBSERVERS, 1 / OBSERVERS)

    def bare_bytes() -> bytes:
        p = np.array([msgpack.unpackb(payload)["p"] for payload in packed])
        summed: bytes = msgpack.packb((weights @ p).tolist())
        return summed

    keys = SceneKeys(scene_of(OBSERVERS).scene)
    places = [keys.posterior(f"cam{n + 1}") for n in range(OBSERVERS)]

    def judged_bytes(engine: FusionEngine, now_ns: int, own: Sequence[bytes]) -> bytes:
        messages = [decode_from(key, PosteriorMessage, payload) for key, payload in zip(places, own, strict=True)]
        return encode(_judgement(engine, now_ns, messages))

    name = f"fusion step, {OBSERVERS} observers, {facets or 'no'} facets"
    whole = compare(f"{name}, bytes to bytes", _repeated(payloads, judged_bytes), bare_bytes, rounds, batch_s)
    yield replace(whole, goal=BYTES_GOALS_US[facets])
    if not facets:
        judging = _repeated(steps, _judgement)
        judged = compare(f"{name}, messages to judgement", judging, lambda: weights @ np.array(lists), rounds, batch_s)
        yield replace(judged, goal=STEP_GOAL_US)


def rule_rows(rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Iterator[BenchmarkRow]:
    """One row per rule that is not the default."""
    for rule in RULES:
        if rule != FusionConfig().rule:
            yield pool_row(rule, rounds, batch_s)


def pool_row(name: str, rounds: int = ROUNDS, batch_s: float = BATCH_S) -> BenchmarkRow:
    """`pool` of one rule against the plain mean."""
    rule, prior = RULES[name], uniform(NAMES.size)
    p = random_posteriors(OBSERVERS)
    label = f"pool, {OBSERVERS} observers, {name}"
    return compare(label, lambda: rule.pool(p, prior), lambda: p.mean(axis=0), rounds, batch_s)


def _steps(facets: int) -> list[tuple[int, Sequence[PosteriorMessage]]]:
    p = random_posteriors(STEPS * OBSERVERS).reshape(STEPS, OBSERVERS, NAMES.size)
    times_ns = [START_NS + seq * FRAME_NS for seq in range(STEPS)]
    return [
        (at_ns + AGE_NS, [message(seq, at_ns, p[seq, n], facets) for n in range(OBSERVERS)])
        for seq, at_ns in enumerate(times_ns)
    ]


def _judgement(engine: FusionEngine, now_ns: int, messages: Sequence[PosteriorMessage]) -> JudgementMessage:
    for n, one in enumerate(messages, 1):
        if engine.receive(f"cam{n}", one, now_ns) is not None:
            raise AssertionError("a posterior of the benchmark was rejected: it measures nothing")
    return engine.step(now_ns).judgement


def _repeated(steps: Sequence[tuple[int, T]], work: Callable[[FusionEngine, int, T], object]) -> Callable[[], object]:
    """`work` on one step per call, in order and over and over, each time with a new engine."""
    scene = scene_of(OBSERVERS)
    queue: list[tuple[int, T]] = []
    engine = engine_of(scene)

    def once() -> object:
        nonlocal engine
        if not queue:
            queue.extend(reversed(steps))
            engine = engine_of(scene)
        return work(engine, *queue.pop())

    return once


PUBLISHERS = 16
FLOOD_S = 2.0
FLOOD_ROUNDS = 1
SCENE = "bench"


@dataclass(frozen=True, slots=True)
class FloodCounts:
    """Posteriors that arrived at `labanmesh fuse`, and that it decoded."""

    received: float
    decoded: float


def flood_rows(rounds: int = FLOOD_ROUNDS, flood_s: float = FLOOD_S) -> Iterator[BenchmarkRow]:
    """Received and decoded per second, against the floor; here a greater ratio is better."""
    bare, ours = [], []
    for _ in range(rounds):
        bare.append(_bare_rate(flood_s))
        ours.append(_fuse_rate(flood_s))
    name = f"posteriors a second from {PUBLISHERS} publishers"
    yield row(f"{name}, taken", median(rate.received for rate in ours), median(bare), "/s", rounds)
    yield row(f"{name}, of these read", median(rate.decoded for rate in ours), median(bare), "/s", rounds)


def _bare_rate(flood_s: float) -> float:
    """Messages per second of the bare loop."""
    port = free_port()
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    receiver = spawn.Process(target=_drain, args=(port, flood_s, there), daemon=True)
    receiver.start()
    try:
        with flooding(port):
            if not here.poll(TIMEOUT_S + flood_s):
                raise LabanmeshError("the bare receiver of the benchmark got no messages; is loopback TCP allowed?")
            count: float = here.recv()
            return count
    finally:
        receiver.join(TIMEOUT_S)


def _fuse_rate(flood_s: float) -> FloodCounts:
    """Posteriors per second at `labanmesh fuse`."""
    port, metrics = free_port(), free_port()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder) / "scene.toml"
        path.write_text(_scene(port, metrics))
        command = [str(Path(sys.executable).with_name("labanmesh")), "fuse", str(path)]
        fusion = Popen(command, env={**os.environ, "LABANMESH_LOG": "error"})  # noqa: S603 - our own command
        stack.callback(stop_process, fusion)
        with flooding(port):
            begin, begun_s = _first_counts(metrics), time.monotonic()
            time.sleep(flood_s)
            end, took_s = _counts(metrics), time.monotonic() - begun_s
        return FloodCounts((end.received - begin.received) / took_s, (end.decoded - begin.decoded) / took_s)


@contextmanager
def flooding(port: int) -> Iterator[None]:
    """PUBLISHERS processes that put as fast as they can; all have a subscriber when the context begins."""
    spawn = multiprocessing.get_context("spawn")
    stop, ready = spawn.Event(), spawn.Semaphore(0)
    publishers = [spawn.Process(target=_flood, args=(n, port, ready, stop), daemon=True) for n in range(PUBLISHERS)]
    for publisher in publishers:
        publisher.start()
    try:
        for _ in publishers:
            if not ready.acquire(timeout=60):
                raise LabanmeshError("the publishers of the benchmark found no subscriber within a minute")
        yield
    finally:
        stop.set()
        for publisher in publishers:
            publisher.join(TIMEOUT_S)


def _flood(number: int, port: int, ready: "multiprocessing.synchronize.Semaphore", stop: Event) -> None:
    template = PosteriorTemplate(number, CROWD_NAMES.labels[number % CROWD_NAMES.size])
    with Link.open(MeshConfig(endpoint=f"tcp/127.0.0.1:{port}"), "observer") as link:
        publisher = link.publisher(f"laban/{SCENE}/observer/cam{number}/posterior")
        publisher.wait_for_subscriber(60)
        ready.release()
        seq, parent = 0, os.getppid()
        while not stop.is_set() and os.getppid() == parent:
            for _ in range(256):
                seq += 1
                publisher.put(template.at(seq, time.time_ns()))


def _drain(port: int, flood_s: float, pipe: Connection) -> None:
    drain(f"tcp/127.0.0.1:{port}", f"laban/{SCENE}/**", flood_s, PUBLISHERS, pipe.send)


def _scene(port: int, metrics: int) -> str:
    labels = ", ".join(f'"{label}"' for label in CROWD_NAMES.labels)
    observers = "".join(f'[observers.cam{n}]\nsource = "bench"\n' for n in range(PUBLISHERS))
    return (
        f'scene = "{SCENE}"\nvocabulary = [{labels}]\nvocabulary_name = "{CROWD_NAMES.name}"\n'
        f'[mesh]\nendpoint = "tcp/127.0.0.1:{port}"\n[metrics]\nlisten = "127.0.0.1:{metrics}"\n{observers}'
    )


def _first_counts(port: int) -> FloodCounts:
    """The service listens to the mesh a moment before it answers over HTTP."""
    end_s = time.monotonic() + TIMEOUT_S
    while True:
        try:
            return _counts(port)
        except OSError:
            if time.monotonic() > end_s:
                raise LabanmeshError(f"labanmesh fuse does not answer on port {port}") from None
            time.sleep(0.05)


def _counts(port: int) -> FloodCounts:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer:
        text = answer.read().decode()

    def total(name: str) -> float:
        match = re.search(rf"^labanmesh_{name}_total\S* (\S+)", text, re.M)
        return float(match[1]) if match else 0.0

    return FloodCounts(total("posteriors_received"), total("posteriors_read"))
