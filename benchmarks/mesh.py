"""From a posterior put to the judgement received, between two processes on real Zenoh, beside bare Zenoh.

One process says what one or four cameras see, 60 times a second each, and hears judgements; in the other runs the
fusion service with its referee. By turns with each frame the same bytes are put by bare Zenoh. Floors:
- echo: a bare subscriber in the other process puts the same bytes back: the two hops that a judgement takes.
- one way: they arrive there; the two processes share a clock.
A posterior is judged by the first judgement that weighs it, or a newer one of the same observer; the cameras of a frame
speak one after the other.
Received is when the bytes are in the inbox: `arrived_ns` there, the callback's first line in bare Zenoh.
"""

import multiprocessing
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import TypeVar

import numpy as np

from benchmarks.bare_zenoh import BACK, LOOPBACK, PUT, SOON_S, Bare, bare_peer
from benchmarks.posteriors import beliefs, message, scene_of
from benchmarks.timing import Row, row
from common.config import MeshConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Arrival
from common.link import Link
from common.messages import JudgementMessage
from common.wire import decode, encode

RATE_HZ = 60.0
FRAMES = 480
WARM_UP = 30
"""Frames that are not counted: routes, threads and caches of both sides settle."""
T = TypeVar("T")
Said = tuple[str, int]
"""Which observer, and when its frame was captured (ns): what a judgement tells of the posteriors in it."""


@dataclass(slots=True)
class Log:
    """When each posterior was put, on the mesh and bare (Unix epoch, ns), and its bytes."""

    ours: dict[Said, int] = field(default_factory=dict)
    bare: dict[Said, int] = field(default_factory=dict)
    payloads: dict[Said, bytes] = field(default_factory=dict)


def rows(frames: int = FRAMES) -> Iterator[Row]:
    """Median and 99th percentile for one observer and for four, against the echo and against one bare put."""
    for observers in (1, 4):
        yield from measure(observers, frames)


def measure(observers: int, frames: int = FRAMES) -> list[Row]:
    """Two processes, started for this measurement and ended with it; raises LabanmeshError when they do not meet."""
    # Spawn: a child forked from a process with a Zenoh session hangs when it closes.
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    other = spawn.Process(target=referee_process, args=(observers, there), daemon=True)
    other.start()
    there.close()
    try:
        meeting_point, bare_meeting_point = _received(here, tuple)
        scene = scene_of(observers, meeting_point)
        with Link.open(scene.mesh, "observer") as link, bare_peer(bare_meeting_point) as bare:
            log, arrivals = _speak(scene, link, bare, frames)
            here.send("stop")
            one_way = _received(here, dict)
            return _rows(log, first_judged(log.ours, arrivals), bare.arrived, one_way, observers)
    finally:
        here.close()
        other.join(SOON_S)


def referee_process(observers: int, pipe: Connection) -> None:
    """The other process: fusion service and bare echo, until the pipe says stop or breaks; then what came when."""
    from fusion.server import serve

    scene, stop = scene_of(observers), threading.Event()

    def wait_for_end() -> None:
        # The end of the pipe is the end of the benchmark, however it came about.
        with suppress(EOFError, OSError):
            pipe.recv()
        stop.set()

    with Link.open(MeshConfig(), "fusion", listen=[LOOPBACK]) as link, bare_peer() as bare:
        bare.echo(PUT, BACK)
        pipe.send((link.locator, bare.locator))
        threading.Thread(target=wait_for_end, daemon=True).start()
        serve([scene], scene.fusion.id, link, stop)
        # Nobody listens when the other side gave up; it has said why.
        with suppress(OSError):
            pipe.send(bare.arrived)


def first_judged(put: Iterable[Said], arrivals: Iterable[Arrival]) -> dict[Said, int]:
    """When the first judgement arrived that weighs each posterior or a newer one; both in the order of time."""
    waiting: dict[str, deque[int]] = {}
    for observer, captured_ns in put:
        waiting.setdefault(observer, deque()).append(captured_ns)
    first: dict[Said, int] = {}
    for arrival in arrivals:
        judgement = decode(JudgementMessage, arrival.payload)
        for observer, vote in judgement.votes.items():
            # A judgement does not name what it weighs; its votes tell their age to the nanosecond.
            weighed_ns = -1 if vote.age_s is None else judgement.at_ns - round(vote.age_s * 1e9)
            queue = waiting.get(observer, deque())
            while queue and queue[0] <= weighed_ns:
                first[observer, queue.popleft()] = arrival.arrived_ns
    return first


def _speak(scene: Scene, link: Link, bare: Bare, frames: int) -> tuple[Log, list[Arrival]]:
    """Frames at RATE_HZ, each put on the mesh and bare, half an interval apart; and all judgements that came."""
    inbox = link.inbox(scene.keys.judgement, limit=1_000_000)
    voices = {observer: link.publisher(scene.keys.posterior(observer)) for observer in scene.roster}
    bare.note(BACK)
    bare_voice = bare.publisher(PUT)
    if not all(voice.wait_for_subscriber(SOON_S) for voice in voices.values()) or not inbox.take(SOON_S):
        raise LabanmeshError("observer and fusion did not meet on the mesh; is loopback TCP allowed here?")
    log, discarded = Log(), Log()
    due = time.monotonic()
    for seq in range(WARM_UP + frames):
        kept = log if seq >= WARM_UP else discarded
        frame = _frame(scene.roster, seq)
        kept.payloads.update(frame)
        for said, payload in frame.items():
            kept.ours[said] = time.time_ns()
            voices[said[0]].put(payload)
        due = _wait(due + 0.5 / RATE_HZ)
        for said, payload in frame.items():
            kept.bare[said] = time.time_ns()
            bare_voice.put(payload)
        due = _wait(due + 0.5 / RATE_HZ)
    # The last judgement and echo have had half an interval; give a busy machine a little more.
    _wait(due + 0.5)
    return log, inbox.take(0.0)


def _frame(observers: Sequence[str], seq: int) -> dict[Said, bytes]:
    """What all observers say of the frame captured now."""
    captured_ns, p = time.time_ns(), beliefs(len(observers), seed=seq)
    said = zip(observers, p, strict=True)
    return {(observer, captured_ns): encode(message(observer, seq, captured_ns, belief)) for observer, belief in said}


def _rows(
    log: Log, judged: dict[Said, int], echoed: dict[bytes, int], one_way: dict[bytes, int], observers: int
) -> list[Row]:
    """Those posteriors count that all three ways brought through; on a quiet machine that is all of them."""
    whole = [
        said for said, payload in log.payloads.items() if said in judged and payload in echoed and payload in one_way
    ]
    if len(whole) < 0.9 * len(log.payloads):
        raise LabanmeshError(f"{len(log.payloads) - len(whole)} of {len(log.payloads)} posteriors never came back")
    ours = [judged[said] - log.ours[said] for said in whole]
    floors = {
        "echo": [echoed[log.payloads[said]] - log.bare[said] for said in whole],
        "one way": [one_way[log.payloads[said]] - log.bare[said] for said in whole],
    }
    who = "1 observer" if observers == 1 else f"{observers} observers"
    return [
        row(f"put to judgement, {who}, {word}, floor: {name}", _ms(ours, q), _ms(floor, q), "ms", len(whole))
        for name, floor in floors.items()
        for word, q in (("median", 50), ("p99", 99))
    ]


def _received(pipe: Connection, kind: type[T]) -> T:
    """What the other process says next."""
    said: object = None
    with suppress(EOFError, OSError):
        said = pipe.recv() if pipe.poll(SOON_S) else None
    if not isinstance(said, kind):
        raise LabanmeshError("the fusion process of the benchmark ended early; what it wrote above says why")
    return said


def _ms(times_ns: Sequence[int], percentile: float) -> float:
    return float(np.percentile(times_ns, percentile)) / 1e6


def _wait(until: float) -> float:
    time.sleep(max(until - time.monotonic(), 0.0))
    return until
