"""The measurements in measured.json: costs of fusion, sizes, whole runs, liveliness tokens. Pure.

`python -m benchmarks.scale.measure --write benchmarks/scale/measured.json` measures all of it on this machine.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

T = TypeVar("T")
WAKE_RANKS = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0)
"""Quantiles of the delay with which a sleeping process is woken."""


@dataclass(frozen=True, slots=True)
class Costs:
    """Processor time of a fusion process in microseconds, of its loop unless stated otherwise.

    receive, burst: of Zenoh's threads, per posterior and per simultaneous arrival of several.
    call: the same for a process of one scene, where a thread hands each posterior to the loop.
    take: a posterior taken from its ring. decode: a posterior decoded, checked and added.
    judge: a judgement, and everything else of a scene that is due. publish: its encoding and put.
    cold: once for all scenes that are judged together.
    status: a status. round: a scene that is not due, per round. turn: a round without scenes.
    take_over: taking over a scene.
    forward: a message that a router forwards.
    hop: from a put to the arrival on the loopback; elapsed time, not processor time.
    """

    receive: float
    burst: float
    call: float
    take: float
    decode: float
    judge: float
    publish: float
    cold: float
    status: float
    round: float
    turn: float
    take_over: float
    forward: float
    hop: float


@dataclass(frozen=True, slots=True)
class MessageSizes:
    """Bytes of messages with four observers and twenty movements; memory in MB."""

    posterior: int
    judgement: int
    verdict: int
    observer_status: int
    fusion_status: int
    vocabulary: int
    process_mb: float
    scene_mb: float


@dataclass(frozen=True, slots=True)
class CrowdRun:
    """A run of the crowd. wake_ms: wake-up delays during it, at WAKE_RANKS; load: of the machine.

    left: processors that all other processes, including the crowd, left to the fusion process.
    """

    scenes: int
    rate_hz: float
    seconds: float
    core_share: float
    left: float
    judgements_hz: float
    age_median_ms: float
    age_p99_ms: float
    crowd_late_ms: float
    memory_mb: float
    wake_ms: tuple[float, ...]
    load: float

    @property
    def observers(self) -> int:
        """Four in each scene."""
        return 4 * self.scenes


@dataclass(frozen=True, slots=True)
class TokenCosts:
    """One process declares that many liveliness tokens: what another session needs to know them all."""

    declared: int
    declare_s: float
    known_s: float
    listener_mb: float
    declarer_mb: float


@dataclass(frozen=True, slots=True)
class Measured:
    """All measurements, with date and machine."""

    date: str
    machine: str
    costs: Costs
    sizes: MessageSizes
    runs: tuple[CrowdRun, ...]
    tokens: tuple[TokenCosts, ...]


def parse_measured(text: str) -> Measured:
    """Parse measured.json; raises ValueError, KeyError or TypeError for another text."""
    values = json.loads(text)
    return Measured(
        date=values["date"],
        machine=values["machine"],
        costs=_made(Costs, values["costs_us"]),
        sizes=_made(MessageSizes, values["sizes"]),
        runs=tuple(_made(CrowdRun, {**run, "wake_ms": tuple(run["wake_ms"])}) for run in values["runs"]),
        tokens=tuple(_made(TokenCosts, tokens) for tokens in values["tokens"]),
    )


def _made(kind: type[T], values: Mapping[str, Any]) -> T:
    return kind(**{field.name: values[field.name] for field in fields(kind)})  # type: ignore[arg-type]
