"""From a posterior put to the judgement received, between two processes on real Zenoh, beside bare Zenoh.

One process publishes the posteriors of one or four cameras at 60 Hz each and receives judgements; the other runs the
fusion service. With each frame, alternately, bare Zenoh puts the same bytes. The floor is the echo: a bare subscriber
in the other process puts the same bytes back, the two hops of a judgement.
A posterior counts as judged by the first judgement that contains it or a newer one of the same observer. Messages are
received when their bytes are in the inbox: `arrived_ns`, and the first line of the callback in bare Zenoh.
"""

import multiprocessing
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import NamedTuple, TypeVar

import numpy as np

from benchmarks.bare_zenoh import BACK, LOOPBACK, PUT, TIMEOUT_S, BarePeer, bare_peer
from benchmarks.posteriors import message, random_posteriors, scene_of
from benchmarks.timing import BenchmarkRow, row
from common import SECOND_NS
from common.config import MeshConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Arrival
from common.link import Link
from common.messages import JudgementMessage
from common.text import plural
from common.wire import decode, encode

RATE_HZ = 60.0
FRAMES = 240
OVER_ECHO = (("median", 50, 0.5), ("p99", 99, 2.0))
"""Percentiles, and the goals: judging may take so many ms longer than the echo."""
WARM_UP = 30
"""Frames that do not count, while routes, threads and caches settle."""
SINGLE_NS = 1000
"""Ages up to a second are more precise than this; frames are further apart."""
T = TypeVar("T")


class Captured(NamedTuple):
    """Identifies a posterior: its observer, and when its frame was captured."""

    observer: str
    captured_ns: int


@dataclass(slots=True)
class PutLog:
    """When each posterior was put, on the mesh and bare (Unix epoch, ns), and its bytes."""

    ours: dict[Captured, int] = field(default_factory=dict)
    bare: dict[Captured, int] = field(default_factory=dict)
    payloads: dict[Captured, bytes] = field(default_factory=dict)


def pace_rows(observers: int, frames: int) -> list[BenchmarkRow]:
    """What judging costs over the echo of the same bytes, median and p99, with their goals.

    Raises LabanmeshError when the two processes do not connect.
    """
    # Spawn: a child forked from a process with a Zenoh session hangs when it closes.
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    other = spawn.Process(target=_fusion_process, args=(observers, there), daemon=True)
    other.start()
    there.close()
    try:
        endpoint, bare_endpoint = _received(here, tuple)
        scene = scene_of(observers, endpoint)
        with Link.open(scene.mesh, "observer") as link, bare_peer(bare_endpoint) as bare:
            log, arrivals = _publish(scene, link, bare, frames)
            here.send("stop")
            return _rows(log, first_judged(log.ours, arrivals), bare.arrived, observers)
    finally:
        here.close()
        other.join(TIMEOUT_S)


def _fusion_process(observers: int, pipe: Connection) -> None:
    """Fusion service and bare echo, until the pipe sends stop or breaks."""
    from fusion.server import serve

    scene, stop = scene_of(observers), threading.Event()

    def wait_for_end() -> None:
        # A broken pipe ends the benchmark, whatever the reason.
        with suppress(EOFError, OSError):
            pipe.recv()
        stop.set()

    with Link.open(MeshConfig(), "fusion", listen=[LOOPBACK]) as link, bare_peer() as bare:
        bare.echo(PUT, BACK)
        pipe.send((link.locator, bare.locator))
        threading.Thread(target=wait_for_end, daemon=True).start()
        serve([scene], scene.fusion.id, link, stop)


def first_judged(put: Iterable[Captured], arrivals: Iterable[Arrival]) -> dict[Captured, int]:
    """When the first judgement arrived that contains each posterior or a newer one; both in the order of time."""
    waiting: dict[str, deque[int]] = {}
    for observer, captured_ns in put:
        waiting.setdefault(observer, deque()).append(captured_ns)
    first: dict[Captured, int] = {}
    for arrival in arrivals:
        judgement = decode(JudgementMessage, arrival.payload)
        for observer, vote in judgement.votes.items():
            # A judgement does not identify its posteriors, but the ages of its votes are right to the microsecond.
            newest_ns = -1 if vote.age_s is None else judgement.at_ns - round(vote.age_s * SECOND_NS) + SINGLE_NS
            queue = waiting.get(observer, deque())
            while queue and queue[0] <= newest_ns:
                first[Captured(observer, queue.popleft())] = arrival.arrived_ns
    return first


def _publish(scene: Scene, link: Link, bare: BarePeer, frames: int) -> tuple[PutLog, list[Arrival]]:
    """Put frames at RATE_HZ on the mesh and, half an interval later, bare; returns all judgements as well."""
    inbox = link.inbox(scene.keys.judgement, limit=1_000_000)
    publishers = {observer: link.publisher(scene.keys.posterior(observer)) for observer in scene.roster}
    bare.note(BACK)
    bare_publisher = bare.publisher(PUT)
    if not all(own.wait_for_subscriber(TIMEOUT_S) for own in publishers.values()) or not inbox.take(TIMEOUT_S):
        raise LabanmeshError("observer and fusion did not connect; is loopback TCP allowed here?")
    log, discarded = PutLog(), PutLog()
    due = time.monotonic()
    for seq in range(WARM_UP + frames):
        current = log if seq >= WARM_UP else discarded
        frame = _frame(scene.roster, seq)
        current.payloads.update(frame)
        for captured, payload in frame.items():
            current.ours[captured] = time.time_ns()
            publishers[captured.observer].put(payload)
        due = _wait(due + 0.5 / RATE_HZ)
        for captured, payload in frame.items():
            current.bare[captured] = time.time_ns()
            bare_publisher.put(payload)
        due = _wait(due + 0.5 / RATE_HZ)
    # The last judgement and echo had half an interval; a busy machine needs a little more.
    _wait(due + 0.5)
    return log, inbox.take(0.0)


def _frame(observers: Sequence[str], seq: int) -> dict[Captured, bytes]:
    """The posteriors of all observers about a frame captured now."""
    captured_ns, posteriors = time.time_ns(), random_posteriors(len(observers), seed=seq)
    return {
        Captured(observer, captured_ns): encode(message(seq, captured_ns, p))
        for observer, p in zip(observers, posteriors, strict=True)
    }


def _rows(log: PutLog, judged: dict[Captured, int], echoed: dict[bytes, int], observers: int) -> list[BenchmarkRow]:
    """Counts the posteriors that arrived by both ways; on a quiet machine that is all of them."""
    whole = [own for own, payload in log.payloads.items() if own in judged and payload in echoed]
    if len(whole) < 0.9 * len(log.payloads):
        raise LabanmeshError(f"{len(log.payloads) - len(whole)} of {len(log.payloads)} posteriors never came back")
    ours = [judged[own] - log.ours[own] for own in whole]
    floor = [echoed[log.payloads[own]] - log.bare[own] for own in whole]
    name, rows = f"put to judgement, {plural(observers, 'observer')}", []
    for word, percentile, goal_ms in OVER_ECHO:
        own_ms, echo_ms = _ms(ours, percentile), _ms(floor, percentile)
        rows.append(row(f"{name}, {word}, over the echo", own_ms - echo_ms, echo_ms, "ms", len(whole), goal_ms))
    return rows


def _received(pipe: Connection, kind: type[T]) -> T:
    """The next object from the other process."""
    received: object = None
    with suppress(EOFError, OSError):
        received = pipe.recv() if pipe.poll(TIMEOUT_S) else None
    if not isinstance(received, kind):
        raise LabanmeshError("the fusion process of the benchmark ended early; its output above says why")
    return received


def _ms(times_ns: Sequence[int], percentile: float) -> float:
    return float(np.percentile(times_ns, percentile)) / 1e6


def _wait(until: float) -> float:
    time.sleep(max(until - time.monotonic(), 0.0))
    return until
