"""What fusion costs: one step, and the pool of a fusion rule.

Floors:
- a step from bytes to bytes, as in the service (decode, receive four posteriors, fuse, encode): the four posteriors
  unpacked by bare msgpack, their weighted sum with fixed weights in numpy, and the sum packed.
- a step from messages to judgement: four lists made an array, and the weighted sum.
- a rule: the plain mean over observers of the same array.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import msgpack
import numpy as np

from benchmarks.posteriors import NAMES, engine_of, message, random_posteriors, scene_of
from benchmarks.timing import BATCH_S, ROUNDS, BenchmarkRow, compare
from common.config import FusionConfig
from common.keys import SceneKeys
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
