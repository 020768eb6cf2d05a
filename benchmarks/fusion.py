"""What fusion costs: one step, each fusion rule, and posteriors a second from sixteen publishers."""

import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from statistics import median
from typing import TypeVar

import msgpack
import numpy as np

from benchmarks.bare_zenoh import SOON_S, drained
from benchmarks.crowd.crowd import NAMES as CROWD_NAMES
from benchmarks.crowd.crowd import Saying, belief
from benchmarks.crowd.trial import free_port
from benchmarks.posteriors import NAMES, beliefs, message, scene_of
from benchmarks.timing import BATCH_S, ROUNDS, Row, compare, row
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage
from common.probability import uniform
from common.wire import decode, encode
from fusion.engine.engine import FusionEngine
from fusion.engine.rules import RULES

OBSERVERS = 4
STEPS = 200
"""Different steps, before a new referee hears them all again: no referee takes a posterior twice."""
FRAME_NS = 16_666_667
AGE_NS = 5_000_000
"""How old the posteriors are when they are judged."""

Step = tuple[int, Sequence[PosteriorMessage]]
T = TypeVar("T")


def step_rows(rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Iterator[Row]:
    """Two rows of the whole step, and one a rule."""
    steps = _steps()
    payloads = [(now_ns, [encode(said) for said in heard]) for now_ns, heard in steps]
    packed, lists = payloads[0][1], [said.p for said in steps[0][1]]
    weights = np.full(OBSERVERS, 1 / OBSERVERS)

    def bare_bytes() -> bytes:
        p = np.array([msgpack.unpackb(payload)["p"] for payload in packed])
        summed: bytes = msgpack.packb((weights @ p).tolist())
        return summed

    whole = _again(payloads, lambda referee, now_ns, heard: encode(_judged(referee, now_ns, _read(heard))))
    yield compare(f"fusion step, {OBSERVERS} observers, bytes to bytes", whole, bare_bytes, rounds, batch_s)
    inner = _again(steps, _judged)
    name = f"fusion step, {OBSERVERS} observers, messages to judgement"
    yield compare(name, inner, lambda: weights @ np.array(lists), rounds, batch_s)
    for rule in RULES:
        yield pool_row(rule, rounds, batch_s)


def pool_row(name: str, rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Row:
    """`pool` of one rule against the plain mean."""
    rule, prior = RULES[name], uniform(NAMES.size)
    p = beliefs(min(OBSERVERS, rule.most_observers or OBSERVERS))
    label = f"pool, {len(p)} observers, {name}"
    return compare(label, lambda: rule.pool(p, prior), lambda: p.mean(axis=0), rounds, batch_s)


def _steps() -> list[Step]:
    p = beliefs(STEPS * OBSERVERS).reshape(STEPS, OBSERVERS, NAMES.size)
    start_ns = 1_700_000_000 * 1_000_000_000
    steps: list[Step] = []
    for seq in range(STEPS):
        captured_ns = start_ns + seq * FRAME_NS
        heard = [message(f"cam{n + 1}", seq, captured_ns, p[seq, n]) for n in range(OBSERVERS)]
        steps.append((captured_ns + AGE_NS, heard))
    return steps


def _read(payloads: Sequence[bytes]) -> list[PosteriorMessage]:
    return [decode(PosteriorMessage, payload) for payload in payloads]


def _judged(referee: FusionEngine, now_ns: int, heard: Sequence[PosteriorMessage]) -> JudgementMessage:
    for said in heard:
        if referee.receive(said.observer or "", said, now_ns) is not None:
            raise AssertionError("a posterior of the benchmark was refused: it measures nothing")
    return referee.step(now_ns).judgement


def _again(steps: Sequence[tuple[int, T]], work: Callable[[FusionEngine, int, T], object]) -> Callable[[], object]:
    """`work` on one step a call, in order and over and over, each time round with a new referee."""
    scene = scene_of(OBSERVERS)
    queue: list[tuple[int, T]] = []
    referee = FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)

    def once() -> object:
        nonlocal referee
        if not queue:
            queue.extend(reversed(steps))
            referee = FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)
        return work(referee, *queue.pop())

    return once


PUBLISHERS = 16
FLOOD_S = 3.0
FLOOD_ROUNDS = 3
SCENE = "bench"


def flood_rows(rounds: int = FLOOD_ROUNDS, flood_s: float = FLOOD_S) -> Iterator[Row]:
    """Arrived, and read, against the floor."""
    bare, arrived, read = [], [], []
    for _ in range(rounds):
        bare.append(floor(flood_s))
        taken, used = ours(flood_s)
        arrived.append(taken)
        read.append(used)
    name = f"posteriors a second from {PUBLISHERS} publishers"
    # Ratio as everywhere ours / floor: here more is better.
    yield row(f"{name}, taken", median(arrived), median(bare), "/s", rounds)
    yield row(f"{name}, of these read", median(read), median(bare), "/s", rounds)


def floor(flood_s: float) -> float:
    """Messages a second of the bare loop."""
    port = free_port()
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    receiver = spawn.Process(target=_drain, args=(port, flood_s, there), daemon=True)
    receiver.start()
    try:
        with flooding(port):
            if not here.poll(SOON_S + flood_s):
                raise LabanmeshError("the bare receiver of the benchmark heard nothing; is loopback TCP allowed here?")
            count: float = here.recv()
            return count
    finally:
        receiver.join(SOON_S)


def ours(flood_s: float) -> tuple[float, float]:
    """Posteriors a second that arrived at `labanmesh fuse`, and that it read."""
    port, metrics = free_port(), free_port()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder) / "scene.toml"
        path.write_text(_scene(port, metrics))
        command = [str(Path(sys.executable).with_name("labanmesh")), "fuse", str(path)]
        quiet = {**os.environ, "LABANMESH_LOG": "error"}
        fusion = subprocess.Popen(command, env=quiet)  # noqa: S603 - our own command
        stack.callback(_end, fusion)
        with flooding(port):
            begin, begun_s = _first_count(metrics), time.monotonic()
            time.sleep(flood_s)
            end, took_s = _counted(metrics), time.monotonic() - begun_s
        return (end[0] - begin[0]) / took_s, (end[1] - begin[1]) / took_s


@contextmanager
def flooding(port: int) -> Iterator[None]:
    """PUBLISHERS processes that put as fast as they can, all heard when the context begins."""
    spawn = multiprocessing.get_context("spawn")
    stop, ready = spawn.Event(), spawn.Semaphore(0)
    crowd = [spawn.Process(target=_flood, args=(n, port, ready, stop), daemon=True) for n in range(PUBLISHERS)]
    for publisher in crowd:
        publisher.start()
    try:
        for _ in crowd:
            if not ready.acquire(timeout=60):
                raise LabanmeshError("the publishers of the benchmark were not heard within a minute")
        yield
    finally:
        stop.set()
        for publisher in crowd:
            publisher.join(SOON_S)


def _flood(number: int, port: int, ready: "multiprocessing.synchronize.Semaphore", stop: Event) -> None:
    mesh = MeshConfig(endpoint=f"tcp/127.0.0.1:{port}")
    observer = f"cam{number}"
    saying = Saying(SCENE, observer, *belief(CROWD_NAMES.labels[number % CROWD_NAMES.size], number % 4))
    with Link.open(mesh, "observer") as link:
        voice = link.publisher(f"laban/{SCENE}/observer/{observer}/posterior")
        voice.wait_for_subscriber(60)
        ready.release()
        seq, parent = 0, os.getppid()
        while not stop.is_set() and os.getppid() == parent:
            for _ in range(256):
                seq += 1
                voice.put(saying.at(seq, time.time_ns()))


def _drain(port: int, flood_s: float, pipe: Connection) -> None:
    drained(f"tcp/127.0.0.1:{port}", f"laban/{SCENE}/**", flood_s, PUBLISHERS, pipe.send)


def _scene(port: int, metrics: int) -> str:
    labels = ", ".join(f'"{label}"' for label in CROWD_NAMES.labels)
    observers = "".join(f'[observers.cam{n}]\nsource = "bench"\n' for n in range(PUBLISHERS))
    return (
        f'scene = "{SCENE}"\nvocabulary = [{labels}]\nvocabulary_name = "{CROWD_NAMES.name}"\n'
        f'[mesh]\nendpoint = "tcp/127.0.0.1:{port}"\n[metrics]\nlisten = "127.0.0.1:{metrics}"\n{observers}'
    )


def _first_count(port: int) -> tuple[float, float]:
    """The service listens to the mesh a moment before it answers over HTTP."""
    end_s = time.monotonic() + SOON_S
    while True:
        try:
            return _counted(port)
        except OSError:
            if time.monotonic() > end_s:
                raise LabanmeshError(f"labanmesh fuse does not answer on port {port}") from None
            time.sleep(0.05)


def _counted(port: int) -> tuple[float, float]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer:
        text = answer.read().decode()
    found = [
        re.search(rf"^labanmesh_{name}_total\S* (\S+)", text, re.M)
        for name in ("posteriors_received", "posteriors_read")
    ]
    arrived, read = (float(match[1]) if match else 0.0 for match in found)
    return arrived, read


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.terminate()
    try:
        process.wait(SOON_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
