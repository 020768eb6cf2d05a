"""One run over one transport: its processes are started, find each other, are measured, and end.

In a run as fast as possible the fusion process has a processor to itself, if there are two; all others share the rest.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from statistics import median, quantiles

from benchmarks.comparisons.transports.actors import (
    ActorRole,
    ListenerReport,
    PublisherReport,
    Ready,
    ReceivedJudgement,
    act,
)
from benchmarks.comparisons.transports.clients import KINDS
from benchmarks.comparisons.transports.orders import TIMEOUT_S, Actor, PublishOrder, Tally, keep_broker
from benchmarks.posteriors import engine_of, message, random_posteriors, scene_of
from common.errors import LabanmeshError
from common.wire import encode

RunFigures = dict[str, float]
"""The figures of one run by name."""
RATE_HZ = 60.0
AHEAD_S = 0.1
"""How long before its begin an order is sent."""
RAMP_S = 0.5
"""Begin of a run as fast as possible that does not count."""
DRAIN_S = 120.0
"""Timeout for the backlog of a broker."""
QUIET_S = 0.5
"""When fusion has taken nothing for this time, nothing is under way."""
STEP_S = 1 / 60
"""In a run as fast as possible fusion judges at most this often."""
LADDER_HZ = tuple(5_000 * 1.5**step for step in range(10))
"""Messages per second of all publishers together, from 5,000 to 192,000."""
LADDER_S = 1.0
FAILURES = 2
"""Incomplete steps in a row that end the climb; a single one may be a disturbance."""
WHOLE = 0.999
TICK_S = 0.01
LATE_S = 0.1
"""Time after the last put in which messages may arrive."""
VARIETY = 64
POLL_S = 0.02
NEWCOMER = "cam99"
START_NS = 1_700_000_000_000_000_000
FRAME_NS = 16_666_667


def names(publishers: int) -> list[str]:
    """cam1, cam2, ..."""
    return list(scene_of(publishers).roster)


def posteriors(name: str, count: int) -> tuple[bytes, ...]:
    """`count` + 1 encoded posteriors: sequence number 0 is the keep-alive."""
    p = random_posteriors(count + 1, seed=int(name.removeprefix("cam")))
    # The bare fusion process knows the observer by this field alone.
    sent = (message(seq, START_NS + seq * FRAME_NS, own) for seq, own in enumerate(p))
    return tuple(encode(own.with_fields(observer=name)) for own in sent)


@cache
def judgement(publishers: int) -> bytes:
    """The encoded judgement of the fusion engine after one posterior of each."""
    scene = scene_of(publishers)
    engine = engine_of(scene)
    for name, p in zip(scene.roster, random_posteriors(publishers), strict=True):
        engine.receive(name, message(0, START_NS, p), START_NS)
    return encode(engine.step(START_NS).judgement)


@dataclass(frozen=True, slots=True)
class RunProcesses:
    """All processes of a run; `start` adds one."""

    kind: str
    start: Callable[[ActorRole], Actor]
    broker: Actor | None
    fusion: Actor
    listeners: list[Actor]
    publishers: dict[str, Actor]
    meeting_point: str


def paced(kind: str, publishers: int, listeners: int, frames: int) -> RunFigures:
    """Each publisher at RATE_HZ, evenly shifted; then one more publisher starts."""
    with _started(kind, publishers, listeners, frames) as run:
        _order(run, frames / RATE_HZ, RATE_HZ, 1 / RATE_HZ, timed=True)
        timeout_s = frames / RATE_HZ + TIMEOUT_S
        reports = {name: actor.receive(PublisherReport, timeout_s) for name, actor in run.publishers.items()}
        arrived = _settled(run.fusion)
        newcomer, ready = _join(run)
        listened = _end(run, newcomer)
    put_ns = {name: report.put_ns for name, report in reports.items()}
    median_ms, p99_ms = in_ms([time_ns for one in listened for time_ns in latencies(put_ns, one.judgements)])
    put = sum(report.count for report in reports.values())
    first_ns = max(one.first_ns[NEWCOMER] for one in listened)
    return {
        "median_ms": median_ms,
        "p99_ms": p99_ms,
        "arrived": arrived / put,
        "sent_bytes": sum(report.sent_bytes for report in reports.values()) / put,
        "start_ms": (first_ns - newcomer.started_ns) / 1e6,
        "link_ms": (first_ns - ready.began_ns) / 1e6,
    }


def latencies(put_ns: Mapping[str, Sequence[int]], judgements: Iterable[ReceivedJudgement]) -> list[int]:
    """Nanoseconds from each put to the first judgement with it or a later message of the same publisher.

    put_ns: by publisher, from sequence number 1 on. Messages that are in no judgement are left out.
    """
    answered = dict.fromkeys(put_ns, 0)
    times = []
    for received in judgements:
        for name, seq in received.newest.items():
            if name in answered and seq > answered[name]:
                times += [received.arrived_ns - at for at in put_ns[name][answered[name] : seq]]
                answered[name] = seq
    return times


def in_ms(times_ns: Sequence[int]) -> tuple[float, float]:
    """Median and 99th percentile."""
    return median(times_ns) / 1e6, quantiles(times_ns, n=100, method="inclusive")[98] / 1e6


def flooded(kind: str, publishers: int, seconds: float) -> RunFigures:
    """The rate that arrives whole; then what one fusion process takes of publishers as fast as possible, and costs."""
    with _started(kind, publishers, 1, VARIETY, apart=True) as run:
        whole_hz = _whole_hz(run)
        taken_before = run.fusion.tally().messages
        begin_s = _order(run, RAMP_S + seconds)
        _wait_for_clock(begin_s + RAMP_S)
        before = _tallies(run)
        _wait_for_clock(begin_s + RAMP_S + seconds)
        after = _tallies(run)
        reports = [actor.receive(PublisherReport) for actor in run.publishers.values()]
        arrived = _settled(run.fusion) - taken_before
        _end(run)
    taken, put = max(after[0].messages - before[0].messages, 1), sum(report.count for report in reports)
    spent_us = [(late.cpu_s - early.cpu_s) / taken * 1e6 for early, late in zip(before, after, strict=True)]
    return {
        "whole_hz": whole_hz,
        "taken_hz": taken / (after[0].at_s - before[0].at_s),
        "put_hz": put / (RAMP_S + seconds),
        "arrived": arrived / put,
        "publisher_us": sum(report.cpu_s for report in reports) / put * 1e6,
        **dict(zip(("receiver_us", "broker_us"), spent_us, strict=False)),
    }


def _whole_hz(run: RunProcesses) -> float:
    """The highest step of the ladder that arrives whole; 0 when none does."""
    best, failed = 0.0, 0
    for rate_hz in LADDER_HZ:
        best, failed = (rate_hz, 0) if _is_carried(run, rate_hz) else (best, failed + 1)
        if failed == FAILURES:
            break
    return best


def _is_carried(run: RunProcesses, rate_hz: float) -> bool:
    """Whether the share WHOLE of all messages arrives in time, without a backlog."""
    before = run.fusion.tally().messages
    begin_s = _order(run, LADDER_S, rate_hz / len(run.publishers), TICK_S, tick_s=TICK_S)
    _wait_for_clock(begin_s + LADDER_S + TICK_S + LATE_S)
    in_time = run.fusion.tally().messages - before
    put = sum(actor.receive(PublisherReport).count for actor in run.publishers.values())
    _settled(run.fusion)
    return in_time >= WHOLE * put


def _order(
    run: RunProcesses,
    seconds: float,
    rate_hz: float = 0.0,
    shift_s: float = 0.0,
    *,
    timed: bool = False,
    tick_s: float = 0.0,
) -> float:
    """Order each publisher to put, evenly shifted within `shift_s`; returns the begin of the first."""
    begin_s = time.monotonic() + AHEAD_S
    for number, actor in enumerate(run.publishers.values()):
        later_s = number / len(run.publishers) * shift_s
        actor.send(PublishOrder(begin_s + later_s, seconds, rate_hz, timed, tick_s))
    return begin_s


def _tallies(run: RunProcesses) -> list[Tally]:
    """Of fusion and, where there is one, of the broker."""
    return [actor.tally() for actor in (run.fusion, run.broker) if actor]


@contextmanager
def _started(kind: str, publishers: int, listeners: int, frames: int, apart: bool = False) -> Iterator[RunProcesses]:
    """All processes, once every listener has judgements with every publisher's keep-alive."""
    alone, rest = _processor_sets() if apart else (None, None)
    with ExitStack() as stack:

        def start(role: ActorRole) -> Actor:
            return stack.enter_context(Actor(act, role))

        needed = KINDS[kind].broker
        broker = stack.enter_context(Actor(keep_broker, needed, rest)) if needed else None
        place = broker.receive(str) if broker else ""
        payloads, pause_s = (judgement(publishers),), STEP_S if apart else 0.0
        fusion = start(ActorRole(kind, "fusion", "fusion", place, payloads, pause_s, alone))
        meeting_point = fusion.receive(Ready).meeting_point
        listening = [
            start(ActorRole(kind, "listener", f"listener {n + 1}", meeting_point, processors=rest))
            for n in range(listeners)
        ]
        publishing = {
            name: start(ActorRole(kind, "publisher", name, meeting_point, posteriors(name, frames), processors=rest))
            for name in names(publishers)
        }
        for actor in (*listening, *publishing.values()):
            actor.receive(Ready)
        _wait_until(
            lambda: all(listener.tally().messages >= publishers for listener in listening),
            f"every publisher connected over {KINDS[kind].name}",
        )
        yield RunProcesses(kind, start, broker, fusion, listening, publishing, meeting_point)


def processors() -> int:
    """The processors that a run may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor_sets() -> tuple[frozenset[int] | None, frozenset[int] | None]:
    """One processor for fusion and the others for all else; None twice with one processor, or without a choice."""
    some = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    return (frozenset(some[:1]), frozenset(some[1:])) if len(some) > 1 else (None, None)


def _join(run: RunProcesses) -> tuple[Actor, Ready]:
    """Start one more publisher and wait until it appears in all listeners; returns it and its first reply."""
    role = ActorRole(run.kind, "publisher", NEWCOMER, run.meeting_point, posteriors(NEWCOMER, 0))
    newcomer = run.start(role)
    ready = newcomer.receive(Ready)
    count = len(run.publishers) + 1
    _wait_until(lambda: all(listener.tally().messages >= count for listener in run.listeners), f"{role} connected")
    return newcomer, ready


def _settled(fusion: Actor) -> int:
    """How many messages fusion has taken once no more arrive."""
    changed = fusion.tally()

    def quiet() -> bool:
        nonlocal changed
        now = fusion.tally()
        if now.messages != changed.messages:
            changed = now
        return now.at_s - changed.at_s > QUIET_S

    _wait_until(quiet, "all messages taken", DRAIN_S)
    return changed.messages


def _end(run: RunProcesses, *more: Actor) -> list[ListenerReport]:
    """Stop all; the listeners first, because only messages wake them."""
    reports = [listener.stop(ListenerReport) for listener in run.listeners]
    for actor in (run.fusion, *run.publishers.values(), *more, *([run.broker] if run.broker else [])):
        actor.stop(str)
    return reports


def _wait_for_clock(at_s: float) -> None:
    _wait_until(lambda: time.monotonic() >= at_s, "a time of this run", at_s - time.monotonic() + TIMEOUT_S)


def _wait_until(condition: Callable[[], bool], what: str, seconds: float = TIMEOUT_S) -> None:
    pause, deadline = threading.Event(), time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise LabanmeshError(f"not within {seconds:g} s: {what}; close other programs and try again")
        pause.wait(POLL_S)
