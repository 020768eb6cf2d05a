"""Homes by factors of ten: processes, traffic over each link, costs; and fusion processes that share scenes. Pure."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from benchmarks.scale.measured import Costs, Sizes
from benchmarks.scale.process import Load, Stay, Trace, shared
from fusion.ownership import rendezvous_rank

NOTICE_S = 0.02
"""A killed process is gone for the others within so long: its sockets close."""


@dataclass(frozen=True, slots=True)
class Change:
    """A process dies at a time, or comes (`alive`)."""

    at_s: float
    service: str
    alive: bool


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """What came of it: a trace for each process, and of each scene the longest time without a judgement."""

    traces: Mapping[str, Trace]
    gap_s: np.ndarray
    moved: int

    @property
    def core_shares(self) -> tuple[float, ...]:
        """Of each process, the busiest first."""
        return tuple(sorted((trace.core_share for trace in self.traces.values()), reverse=True))

    def age_ms(self, percent: float) -> float:
        """Of the judgements of all processes."""
        return float(np.percentile(np.concatenate([trace.age_s for trace in self.traces.values()]), percent)) * 1e3


def shares(scenes: Sequence[str], services: Iterable[str]) -> dict[str, int]:
    """How many scenes each service judges."""
    count = dict.fromkeys(services, 0)
    for scene in scenes:
        count[rendezvous_rank(scene, count)[0]] += 1
    return count


def play(
    costs: Costs,
    load: Load,
    scenes: int,
    services: Sequence[str],
    seconds: float,
    changes: Sequence[Change] = (),
    seed: int = 0,
) -> Region:
    """Those of `services` that no change brings judge from the start; a scene that moves is taken at the next round."""
    stays, moved = stays_of([f"home{n}" for n in range(scenes)], services, changes)
    traces = {service: shared(costs, load, own, seconds, scenes, seed) for service, own in stays.items()}
    said = [(s, t) for trace in traces.values() for s, t in zip(trace.scene, trace.said_s, strict=True)]
    by_scene: dict[int, list[float]] = {}
    for scene, said_s in sorted(said):
        by_scene.setdefault(scene, []).append(said_s)
    gaps = [max((b - a for a, b in pairwise(times)), default=seconds) for times in by_scene.values()]
    return Region(traces, np.array(gaps), moved)


def stays_of(
    scenes: Sequence[str], services: Sequence[str], changes: Sequence[Change]
) -> tuple[dict[str, list[Stay]], int]:
    """For each service its stays; and how many times a scene moved."""
    coming = {change.service for change in changes if change.alive}
    alive = set(services) - coming
    stays: dict[str, list[Stay]] = {service: [] for service in (*services, *sorted(coming - set(services)))}
    holder = {n: (rendezvous_rank(scene, alive)[0], 0.0) for n, scene in enumerate(scenes)}
    moved = 0
    for change in sorted(changes, key=lambda change: change.at_s):
        alive = alive | {change.service} if change.alive else alive - {change.service}
        for n, scene in enumerate(scenes):
            before, begin_s = holder[n]
            heaviest = rendezvous_rank(scene, alive)[0]
            if heaviest != before:
                moved += 1
                stays[before].append(Stay(n, begin_s, change.at_s))
                holder[n] = heaviest, change.at_s + (0.0 if change.alive else NOTICE_S)
    for n, (last, begin_s) in holder.items():
        stays[last].append(Stay(n, begin_s))
    return {service: sorted(own, key=lambda stay: stay.scene) for service, own in stays.items()}, moved


HOURS = 730.0
"""Of a month."""
DAY_S = 86_400.0
FULL = 0.6
"""A process or router is given so much work of its core at most: the rest is for who dies, and for bad moments."""
AGE_MS = 100.0
"""A judgement is older than this one time in a hundred at most."""
SPARE = 1
"""So many fusion processes of a cell may be gone at once."""
TRIED_S = 2.0
ROUTERS = 2


class Design(Enum):
    """Where fusion runs."""

    HOME = "fusion in the home"
    REGION = "fusion in the region"


@dataclass(frozen=True, slots=True)
class Assumed:
    """What nobody has measured: people's habits, how it is set up, and prices. Every one is an option of the verb.

    movements: judged in a home, a day. watched: share of the time in which somebody elsewhere looks at judgements.
    said_hz: posteriors a second of an observer over a slow link. overhead: bytes of Zenoh, TLS, TCP and IP a message.
    cell: homes that share routers and fusion processes. keep_days: verdicts are kept. core_hour, egress_gb,
    storage_gb (a month), person_hour, kwh: prices, in dollars. support_min: of somebody's time, a home and year.
    core_watts: what a busy core in the home draws.
    """

    movements: float = 500.0
    watched: float = 0.01
    said_hz: float = 12.6
    overhead: float = 110.0
    cell: float = 1000
    keep_days: float = 30.0
    core_hour: float = 0.04
    egress_gb: float = 0.08
    storage_gb: float = 0.02
    support_min: float = 15.0
    person_hour: float = 50.0
    kwh: float = 0.30
    core_watts: float = 8.0


@dataclass(frozen=True, slots=True)
class Flow:
    """What one home says under one key across one link."""

    key: str
    link: str
    messages_hz: float
    bytes_hz: float


UP, DOWN, OUT = "home to region", "region to home", "region to who listens"


def flows(design: Design, sizes: Sizes, assumed: Assumed, load: Load) -> Iterator[Flow]:
    """Of one home, those that cross a link; what stays at home is not among them."""

    def flow(key: str, link: str, hz: float, size: int) -> Flow:
        return Flow(key, link, hz, hz * (size + assumed.overhead))

    verdicts_hz, watched_hz = 2 * assumed.movements / DAY_S, assumed.watched * load.step_hz
    back = UP if design is Design.HOME else DOWN
    if design is Design.REGION:
        yield flow("posterior", UP, load.observers * assumed.said_hz, sizes.posterior)
        yield flow("observer status", UP, load.observers, sizes.observer_status)
    yield flow("verdict", back, verdicts_hz, sizes.verdict)
    yield flow("judgement", back, watched_hz, sizes.judgement)
    if design is Design.HOME:
        yield flow("fusion status", UP, 1.0, sizes.fusion_status)
    yield flow("verdict", OUT, verdicts_hz, sizes.verdict)
    yield flow("judgement", OUT, watched_hz, sizes.judgement)


@dataclass(frozen=True, slots=True)
class Bill:
    """Dollars a home and month, without what the home's own machines draw."""

    machines: float
    traffic: float
    storage: float
    people: float

    @property
    def total(self) -> float:
        """All of it."""
        return self.machines + self.traffic + self.storage + self.people


@dataclass(frozen=True, slots=True)
class Scale:
    """So many homes in one design. cores: busy ones in the region; messages_hz, bytes_hz: what comes in there."""

    homes: int
    design: Design
    cells: int
    fusion: int
    routers: int
    cores: float
    memory_gb: float
    messages_hz: float
    bytes_hz: float
    bill: Bill


def full_process(costs: Costs, load: Load) -> int:
    """How many homes one process judges with FULL of a core in its loop and AGE_MS kept: the simulation, by halving."""
    fits, too_many = 1, 2
    while _fits(costs, load, too_many):
        fits, too_many = too_many, too_many * 2
    while too_many - fits > max(1, fits // 50):
        middle = (fits + too_many) // 2
        fits, too_many = (middle, too_many) if _fits(costs, load, middle) else (fits, middle)
    return fits


def trial(costs: Costs, load: Load, homes: int, seconds: float = TRIED_S) -> Trace:
    """One process that judges so many homes."""
    return shared(costs, load, [Stay(n) for n in range(homes)], seconds)


def _fits(costs: Costs, load: Load, homes: int) -> bool:
    trace = trial(costs, load, homes)
    return trace.loop_share <= FULL and trace.age_ms(99) <= AGE_MS


def processes(homes: int, full: int) -> int:
    """Fusion processes of a cell: none of those that are left when SPARE have gone judges more than `full` homes."""
    names = [f"home{n}" for n in range(homes)]
    count = max(math.ceil(homes / full), 1)
    while max(shares(names, [f"north{n}" for n in range(count)]).values()) > full:
        count += 1
    return count + SPARE


def scaled(homes: int, design: Design, costs: Costs, sizes: Sizes, assumed: Assumed, load: Load, full: int) -> Scale:
    """What so many homes come to."""
    cells = math.ceil(homes / assumed.cell)
    in_cell = math.ceil(homes / cells)
    lone = homes == 1 and design is Design.HOME
    # One home that judges itself needs no region.
    crossing = [] if lone else list(flows(design, sizes, assumed, load))
    come = [flow for flow in crossing if flow.link == UP]
    routed_hz = homes * sum(flow.messages_hz for flow in crossing)
    router_cores = routed_hz * costs.forward * 1e-6
    routers = 0 if lone else cells * max(ROUTERS, math.ceil(router_cores / cells / FULL))
    fusion, cores, memory_mb = 0, router_cores, routers * sizes.process_mb
    if design is Design.REGION:
        each = processes(in_cell, full)
        fusion = cells * each
        share = trial(costs, load, max(in_cell // each, 1)).core_share
        cores += fusion * share
        memory_mb += fusion * sizes.process_mb + homes * sizes.scene_mb
    paid = _paid(design, homes, fusion, routers, crossing, sizes, assumed)
    come_hz, bytes_hz = (homes * sum(getattr(flow, name) for flow in come) for name in ("messages_hz", "bytes_hz"))
    return Scale(homes, design, cells, fusion, routers, cores, memory_mb / 1e3, come_hz, bytes_hz, paid)


def _paid(
    design: Design, homes: int, fusion: int, routers: int, crossing: list[Flow], sizes: Sizes, assumed: Assumed
) -> Bill:
    out_hz = sum(flow.bytes_hz for flow in crossing if flow.link in (DOWN, OUT))
    kept_gb = 2 * assumed.movements * assumed.keep_days * sizes.verdict / 1e9
    return Bill(
        machines=(fusion + routers) * assumed.core_hour * HOURS / homes,
        traffic=out_hz * HOURS * 3600 / 1e9 * assumed.egress_gb,
        storage=kept_gb * assumed.storage_gb,
        people=assumed.support_min / 60 * assumed.person_hour / 12,
    )


def drawn(share: float, assumed: Assumed) -> float:
    """Dollars a month for what so many busy cores in the home draw."""
    return share * assumed.core_watts / 1e3 * HOURS * assumed.kwh
