"""The cost of one fusion step with four observers and twenty movements, and of each fusion rule.

Floors:
- from bytes to bytes, as the service does it (decode and hear four posteriors, judge, encode): the four posteriors
  unpacked by bare msgpack, their weighted sum in numpy with weights that are given, and the sum packed.
- from messages to judgement (hear four, judge): the four lists made an array, and the weighted sum.
- a rule: the plain mean over observers of the same array.
Checking what strangers send, ageing it, entropies, votes and the judgement's many fields are what comes on top.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import msgpack
import numpy as np

from benchmarks.posteriors import NAMES, beliefs, message, scene_of
from benchmarks.timing import BATCH_S, ROUNDS, Row, compare
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


def rows(rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Iterator[Row]:
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
        if referee.hear(said.observer or "", said, now_ns) is not None:
            raise AssertionError("a posterior of the benchmark was refused: it measures nothing")
    return referee.judge(now_ns).judgement


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
