"""One run over one transport: its processes are started, find each other, are measured, and end."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache

from benchmarks.posteriors import NAMES, beliefs, message, scene_of
from benchmarks.transports.actors import Heard, Part, Ready, Spoken, act
from benchmarks.transports.kinds import KINDS
from benchmarks.transports.orders import SOON_S, Actor, Plan, Tally, keep
from benchmarks.transports.table import Found, in_ms, latencies
from common.errors import LabanmeshError
from common.wire import encode
from fusion.engine.engine import FusionEngine

RATE_HZ = 60.0
AHEAD_S = 0.1
"""How long before it begins a plan is told."""
RAMP_S = 0.5
"""What is not counted at the beginning of a run as fast as they can."""
DRAIN_S = 120.0
"""What has piled up in a broker may take so long to be taken."""
QUIET_S = 0.5
"""When the referee has taken nothing for so long, nothing is on its way any more."""
STEP_S = 1 / 60
"""In a run as fast as they can the referee judges not more often than this."""
LADDER_HZ = tuple(5_000 * 1.5**step for step in range(10))
"""Messages a second of all publishers together, from 5,000 to 192,000."""
LADDER_S = 1.0
FAILURES = 2
"""So many steps in a row that did not come through whole end the climb: one may be the machine's mood."""
WHOLE = 0.999
TICK_S = 0.01
LATE_S = 0.1
"""So long after the last put it may take."""
VARIETY = 64
LOOK_S = 0.02


@dataclass(frozen=True, slots=True)
class Cast:
    """All processes of a run; `start` adds one."""

    kind: str
    start: Callable[[Part], Actor]
    broker: Actor | None
    referee: Actor
    listeners: list[Actor]
    publishers: dict[str, Actor]
    meeting_point: str


def paced(kind: str, publishers: int, listeners: int, frames: int) -> Found:
    """Each publisher at RATE_HZ, evenly shifted; then one more is started while they murmur."""
    with _cast(kind, publishers, listeners, frames) as cast:
        _ordered(cast, frames / RATE_HZ, RATE_HZ, 1 / RATE_HZ, noted=True)
        spoken = {name: actor.said(Spoken, frames / RATE_HZ + SOON_S) for name, actor in cast.publishers.items()}
        arrived = _settled(cast.referee)
        newcomer, ready = _joined(cast)
        heard = _ended(cast, newcomer)
    put_ns = {name: one.put_ns for name, one in spoken.items()}
    median_ms, p99_ms = in_ms([each for one in heard for each in latencies(put_ns, one.judgements)])
    put = sum(one.count for one in spoken.values())
    first_ns = max(one.first_ns[NEWCOMER] for one in heard)
    return {
        "median_ms": median_ms,
        "p99_ms": p99_ms,
        "arrived": arrived / put,
        "sent_bytes": sum(one.sent_bytes for one in spoken.values()) / put,
        "start_ms": (first_ns - newcomer.started_ns) / 1e6,
        "link_ms": (first_ns - ready.began_ns) / 1e6,
    }


def flooded(kind: str, publishers: int, seconds: float) -> Found:
    """What comes through whole; then what one referee takes of publishers as fast as they can, and what that costs."""
    with _cast(kind, publishers, 1, VARIETY, apart=True) as cast:
        whole_hz = _whole_hz(cast)
        taken_before = cast.referee.tally().messages
        begin_s = _ordered(cast, RAMP_S + seconds)
        _clock_at(begin_s + RAMP_S)
        before = _tallies(cast)
        _clock_at(begin_s + RAMP_S + seconds)
        after = _tallies(cast)
        spoken = [actor.said(Spoken) for actor in cast.publishers.values()]
        arrived = _settled(cast.referee) - taken_before
        _ended(cast)
    taken, put = max(after[0].messages - before[0].messages, 1), sum(one.count for one in spoken)
    spent_us = [(late.cpu_s - early.cpu_s) / taken * 1e6 for early, late in zip(before, after, strict=True)]
    return {
        "whole_hz": whole_hz,
        "taken_hz": taken / (after[0].at_s - before[0].at_s),
        "put_hz": put / (RAMP_S + seconds),
        "arrived": arrived / put,
        "publisher_us": sum(one.cpu_s for one in spoken) / put * 1e6,
        **dict(zip(("receiver_us", "broker_us"), spent_us, strict=False)),
    }


def _whole_hz(cast: Cast) -> float:
    """The highest step of the ladder that came through whole; 0 when none did."""
    best, failed = 0.0, 0
    for rate_hz in LADDER_HZ:
        best, failed = (rate_hz, 0) if _carried(cast, rate_hz) else (best, failed + 1)
        if failed == FAILURES:
            break
    return best


def _carried(cast: Cast, rate_hz: float) -> bool:
    """Whether WHOLE of what was put arrived, in time: nothing piled up on the way."""
    before = cast.referee.tally().messages
    begin_s = _ordered(cast, LADDER_S, rate_hz / len(cast.publishers), TICK_S, tick_s=TICK_S)
    _clock_at(begin_s + LADDER_S + TICK_S + LATE_S)
    in_time = cast.referee.tally().messages - before
    put = sum(actor.said(Spoken).count for actor in cast.publishers.values())
    _settled(cast.referee)
    return in_time >= WHOLE * put


def _ordered(
    cast: Cast, seconds: float, rate_hz: float = 0.0, shift_s: float = 0.0, *, noted: bool = False, tick_s: float = 0.0
) -> float:
    """A plan for each publisher, evenly shifted within `shift_s`; when the first of them begins."""
    begin_s = time.monotonic() + AHEAD_S
    for number, actor in enumerate(cast.publishers.values()):
        later_s = number / len(cast.publishers) * shift_s
        actor.tell(Plan(begin_s + later_s, seconds, rate_hz, noted, tick_s))
    return begin_s


def _tallies(cast: Cast) -> list[Tally]:
    """The referee's and, where there is one, the broker's."""
    return [actor.tally() for actor in (cast.referee, cast.broker) if actor]


NEWCOMER = "cam99"


@contextmanager
def _cast(kind: str, publishers: int, listeners: int, frames: int, apart: bool = False) -> Iterator[Cast]:
    """All started, and every listener has heard judgements of every publisher's murmurs."""
    alone, rest = _apart() if apart else (None, None)
    with ExitStack() as stack:

        def start(part: Part) -> Actor:
            return stack.enter_context(Actor(act, part))

        needed = KINDS[kind].broker
        broker = stack.enter_context(Actor(keep, needed, rest)) if needed else None
        place = broker.said(str) if broker else ""
        payloads, pause_s = (judgement(publishers),), STEP_S if apart else 0.0
        referee = start(Part(kind, "referee", "the referee", place, payloads, pause_s, alone))
        meeting_point = referee.said(Ready).meeting_point
        ears = [
            start(Part(kind, "listener", f"listener {n + 1}", meeting_point, processors=rest)) for n in range(listeners)
        ]
        mouths = {
            name: start(Part(kind, "publisher", name, meeting_point, posteriors(name, frames), processors=rest))
            for name in names(publishers)
        }
        for actor in (*ears, *mouths.values()):
            actor.said(Ready)
        _until(
            lambda: all(ear.tally().messages >= publishers for ear in ears),
            f"every publisher heard over {KINDS[kind].name}",
        )
        yield Cast(kind, start, broker, referee, ears, mouths, meeting_point)


def processors() -> int:
    """How many there are for a run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _apart() -> tuple[frozenset[int] | None, frozenset[int] | None]:
    """One processor for the referee and the others for all else; None twice where there is but one, or no choice."""
    some = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    return (frozenset(some[:1]), frozenset(some[1:])) if len(some) > 1 else (None, None)


def _joined(cast: Cast) -> tuple[Actor, Ready]:
    """One more publisher and what it said first; all listeners have heard of it."""
    part = Part(cast.kind, "publisher", NEWCOMER, cast.meeting_point, posteriors(NEWCOMER, 0))
    newcomer = cast.start(part)
    ready = newcomer.said(Ready)
    wanted = len(cast.publishers) + 1
    _until(lambda: all(ear.tally().messages >= wanted for ear in cast.listeners), f"{part} heard")
    return newcomer, ready


def _settled(referee: Actor) -> int:
    """How many messages it has taken, once no more come."""
    changed = referee.tally()

    def quiet() -> bool:
        nonlocal changed
        now = referee.tally()
        if now.messages != changed.messages:
            changed = now
        return now.at_s - changed.at_s > QUIET_S

    _until(quiet, "all taken that was put", DRAIN_S)
    return changed.messages


def _ended(cast: Cast, *more: Actor) -> list[Heard]:
    """All stopped, who listens first, since only what is put wakes them."""
    heard = [ear.stop(Heard) for ear in cast.listeners]
    for actor in (cast.referee, *cast.publishers.values(), *more, *([cast.broker] if cast.broker else [])):
        actor.stop(str)
    return heard


def _clock_at(at_s: float) -> None:
    _until(lambda: time.monotonic() >= at_s, "a time of this run", at_s - time.monotonic() + SOON_S)


def _until(condition: Callable[[], bool], what: str, seconds: float = SOON_S) -> None:
    pause, deadline = threading.Event(), time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise LabanmeshError(f"not within {seconds:g} s: {what}; a machine with less to do may help")
        pause.wait(LOOK_S)


START_NS = 1_700_000_000_000_000_000
FRAME_NS = 16_666_667


def names(publishers: int) -> list[str]:
    """cam1, cam2, ..."""
    return list(scene_of(publishers).roster)


def posteriors(name: str, count: int) -> tuple[bytes, ...]:
    """`count` + 1 of them: sequence number 0 is the murmur."""
    p = beliefs(count + 1, seed=int(name.removeprefix("cam")))
    return tuple(encode(message(name, seq, START_NS + seq * FRAME_NS, belief)) for seq, belief in enumerate(p))


@cache
def judgement(publishers: int) -> bytes:
    """What the referee says when it has heard one posterior of each."""
    scene = scene_of(publishers)
    referee = FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)
    for name, belief in zip(scene.roster, beliefs(publishers), strict=True):
        referee.receive(name, message(name, 0, START_NS, belief), START_NS)
    return encode(referee.step(START_NS).judgement)
