"""What was measured, as measured.json holds it: costs of fusion, sizes, whole runs, liveliness tokens. Pure.

`python -m benchmarks.scale.measure --write studies/scale/measured.json` makes all of it anew on the machine at hand.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

T = TypeVar("T")
WAKE_RANKS = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0)
"""Of how late a sleeper was woken these quantiles are kept."""


@dataclass(frozen=True, slots=True)
class Costs:
    """Processor time of a fusion process, in microseconds; of its loop where nothing else is said.

    receive, burst: of Zenoh's threads, for each posterior that comes and each time that some come at once.
    call: the same for a process of one scene, where each posterior is brought to the loop by a thread.
    take: a posterior out of its ring. hear: a posterior decoded, checked and heard.
    judge: a judgement, and what else belongs to a scene that is due. say: its encoding and putting.
    cold: once for all that are judged together.
    tell: a status. round: a scene that is not due, each round. turn: a round by itself. sit: a scene taken over.
    forward: a message that a router passes on.
    hop: from a put until it has arrived, on the loopback; time, and no processor's.
    """

    receive: float
    burst: float
    call: float
    take: float
    hear: float
    judge: float
    say: float
    cold: float
    tell: float
    round: float
    turn: float
    sit: float
    forward: float
    hop: float


@dataclass(frozen=True, slots=True)
class Sizes:
    """Bytes of messages of four observers and twenty movements; of memory, in MB."""

    posterior: int
    judgement: int
    verdict: int
    observer_status: int
    fusion_status: int
    vocabulary: int
    process_mb: float
    scene_mb: float


@dataclass(frozen=True, slots=True)
class Run:
    """A run of the crowd. wake_ms: how late sleepers were woken meanwhile, at WAKE_RANKS; load: on the machine.

    left: processors that all others, the crowd among them, left to the fusion process.
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
class Tokens:
    """So many liveliness tokens were declared by one process: what another's session came to by knowing them."""

    declared: int
    declare_s: float
    known_s: float
    listener_mb: float
    declarer_mb: float


@dataclass(frozen=True, slots=True)
class Measured:
    """All of it, where and when."""

    date: str
    machine: str
    costs: Costs
    sizes: Sizes
    runs: tuple[Run, ...]
    tokens: tuple[Tokens, ...]


def parsed(text: str) -> Measured:
    """From the text of measured.json."""
    told = json.loads(text)
    return Measured(
        date=told["date"],
        machine=told["machine"],
        costs=_made(Costs, told["costs_us"]),
        sizes=_made(Sizes, told["sizes"]),
        runs=tuple(_made(Run, {**run, "wake_ms": tuple(run["wake_ms"])}) for run in told["runs"]),
        tokens=tuple(_made(Tokens, tokens) for tokens in told["tokens"]),
    )


def _made(kind: type[T], told: Mapping[str, Any]) -> T:
    return kind(**{field.name: told[field.name] for field in fields(kind)})  # type: ignore[arg-type]
