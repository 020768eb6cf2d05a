"""Homes by factors of ten: processes, traffic over each link, costs; and fusion processes that share scenes. Pure.

A region consists of independent cells. Each has routers and, where fusion runs in the region, fusion processes that
share its homes; so only the number of cells grows. Scenes are shared by `fusion.ownership.rendezvous_rank`, the
function that the processes themselves use.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from benchmarks.scale.measured import Costs, MessageSizes
from benchmarks.scale.process import Load, ProcessTrace, Stay, simulate_many
from fusion.ownership import rendezvous_rank

NOTICE_S = 0.02
"""The other processes notice a kill within this time, when its sockets close."""
HOURS = 730.0
"""Of a month."""
DAY_S = 86_400.0
FULL = 0.6
"""Greatest planned share of a core; the rest is for the work of a failed process, and for bad moments."""
AGE_MS = 100.0
"""Greatest 99th percentile of the age of judgements."""
SPARE = 1
"""Fusion processes of a cell that may fail at once."""
TRIED_S = 2.0
ROUTERS = 2


@dataclass(frozen=True, slots=True)
class MembershipChange:
    """A fusion process starts (`alive`) or dies."""

    at_s: float
    service: str
    alive: bool


@dataclass(frozen=True, slots=True, eq=False)
class RegionTrace:
    """A trace for each process; gap_s: the longest time without a judgement of each scene; moved: scenes that moved."""

    traces: Mapping[str, ProcessTrace]
    gap_s: np.ndarray
    moved: int

    @property
    def core_shares(self) -> tuple[float, ...]:
        """Of each process, the busiest first."""
        return tuple(sorted((trace.core_share for trace in self.traces.values()), reverse=True))

    def age_ms(self, percent: float) -> float:
        """A percentile of the ages of all judgements."""
        return float(np.percentile(np.concatenate([trace.age_s for trace in self.traces.values()]), percent)) * 1e3


@dataclass(frozen=True, slots=True)
class SceneOwnership:
    """For each service the scenes that it owns and when; moved: how many times a scene changed its owner."""

    stays: Mapping[str, Sequence[Stay]]
    moved: int


def scene_counts(scenes: Sequence[str], services: Iterable[str]) -> dict[str, int]:
    """How many scenes each service owns."""
    count = dict.fromkeys(services, 0)
    for scene in scenes:
        count[rendezvous_rank(scene, count)[0]] += 1
    return count


def simulate_region(
    costs: Costs,
    load: Load,
    scenes: int,
    services: Sequence[str],
    seconds: float,
    changes: Sequence[MembershipChange] = (),
    seed: int = 0,
) -> RegionTrace:
    """Simulate all processes; services that a change starts are absent before it."""
    ownership = ownership_of([f"home{n}" for n in range(scenes)], services, changes)
    traces = {
        service: simulate_many(costs, load, own, seconds, scenes, seed) for service, own in ownership.stays.items()
    }
    published = [(s, t) for trace in traces.values() for s, t in zip(trace.scene, trace.published_s, strict=True)]
    by_scene: dict[int, list[float]] = {}
    for scene, at_s in sorted(published):
        by_scene.setdefault(scene, []).append(at_s)
    gaps = [max((b - a for a, b in pairwise(times)), default=seconds) for times in by_scene.values()]
    return RegionTrace(traces, np.array(gaps), ownership.moved)


def ownership_of(scenes: Sequence[str], services: Sequence[str], changes: Sequence[MembershipChange]) -> SceneOwnership:
    """Which service owns which scene when, with these changes."""
    coming = {change.service for change in changes if change.alive}
    alive = set(services) - coming
    stays: dict[str, list[Stay]] = {service: [] for service in (*services, *sorted(coming - set(services)))}
    owner = {n: (rendezvous_rank(scene, alive)[0], 0.0) for n, scene in enumerate(scenes)}
    moved = 0
    for change in sorted(changes, key=lambda change: change.at_s):
        alive = alive | {change.service} if change.alive else alive - {change.service}
        for n, scene in enumerate(scenes):
            before, begin_s = owner[n]
            first = rendezvous_rank(scene, alive)[0]
            if first != before:
                moved += 1
                stays[before].append(Stay(n, begin_s, change.at_s))
                owner[n] = first, change.at_s + (0.0 if change.alive else NOTICE_S)
    for n, (last, begin_s) in owner.items():
        stays[last].append(Stay(n, begin_s))
    return SceneOwnership({service: sorted(own, key=lambda stay: stay.scene) for service, own in stays.items()}, moved)


class Design(Enum):
    """Where fusion runs."""

    HOME = "fusion in the home"
    REGION = "fusion in the region"


@dataclass(frozen=True, slots=True)
class Assumptions:
    """Unmeasured values: habits, setup and prices. Each is an option of the command.

    movements: per home and day. watched: share of the time in which judgements are watched elsewhere.
    said_hz: posteriors per second of an observer over a slow link. overhead: bytes of Zenoh, TLS, TCP and IP a message.
    cell: homes that share routers and fusion processes. keep_days: for verdicts. core_hour, egress_gb, storage_gb (a
    month), person_hour, kwh: prices in dollars. support_min: per home and year. core_watts: of a busy core at home.
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
    """The traffic of one home under one key over one link."""

    key: str
    link: str
    messages_hz: float
    bytes_hz: float


UP, DOWN, OUT = "home to region", "region to home", "region to listeners"


def flows(design: Design, sizes: MessageSizes, assumed: Assumptions, load: Load) -> Iterator[Flow]:
    """The flows of one home that cross a link; local traffic is left out."""

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
    """Dollars per home and month, without the power of the home's own machines."""

    machines: float
    traffic: float
    storage: float
    people: float

    @property
    def total(self) -> float:
        """The sum."""
        return self.machines + self.traffic + self.storage + self.people


@dataclass(frozen=True, slots=True)
class Scale:
    """A number of homes in one design. cores: busy ones in the region; messages_hz, bytes_hz: incoming there."""

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
    """How many homes one process judges with FULL of a core in its loop and AGE_MS kept: simulation and bisection."""
    fits, too_many = 1, 2
    while _fits(costs, load, too_many):
        fits, too_many = too_many, too_many * 2
    while too_many - fits > max(1, fits // 50):
        middle = (fits + too_many) // 2
        fits, too_many = (middle, too_many) if _fits(costs, load, middle) else (fits, middle)
    return fits


def simulate_homes(costs: Costs, load: Load, homes: int, seconds: float = TRIED_S) -> ProcessTrace:
    """One process with that many homes."""
    return simulate_many(costs, load, [Stay(n) for n in range(homes)], seconds)


def _fits(costs: Costs, load: Load, homes: int) -> bool:
    trace = simulate_homes(costs, load, homes)
    return trace.loop_share <= FULL and trace.age_ms(99) <= AGE_MS


def processes(homes: int, full: int) -> int:
    """Fusion processes of a cell such that none owns more than `full` homes after SPARE of them fail."""
    names = [f"home{n}" for n in range(homes)]
    count = max(math.ceil(homes / full), 1)
    while max(scene_counts(names, [f"north{n}" for n in range(count)]).values()) > full:
        count += 1
    return count + SPARE


def scaled(
    homes: int, design: Design, costs: Costs, sizes: MessageSizes, assumed: Assumptions, load: Load, full: int
) -> Scale:
    """What that many homes need and cost."""
    cells = math.ceil(homes / assumed.cell)
    in_cell = math.ceil(homes / cells)
    lone = homes == 1 and design is Design.HOME
    # A single home with its own fusion needs no region.
    crossing = [] if lone else list(flows(design, sizes, assumed, load))
    incoming = [flow for flow in crossing if flow.link == UP]
    routed_hz = homes * sum(flow.messages_hz for flow in crossing)
    router_cores = routed_hz * costs.forward * 1e-6
    routers = 0 if lone else cells * max(ROUTERS, math.ceil(router_cores / cells / FULL))
    fusion, cores, memory_mb = 0, router_cores, routers * sizes.process_mb
    if design is Design.REGION:
        each = processes(in_cell, full)
        fusion = cells * each
        cores += fusion * simulate_homes(costs, load, max(in_cell // each, 1)).core_share
        memory_mb += fusion * sizes.process_mb + homes * sizes.scene_mb
    bill = _bill(homes, fusion + routers, crossing, sizes, assumed)
    messages_hz = homes * sum(flow.messages_hz for flow in incoming)
    bytes_hz = homes * sum(flow.bytes_hz for flow in incoming)
    return Scale(homes, design, cells, fusion, routers, cores, memory_mb / 1e3, messages_hz, bytes_hz, bill)


def _bill(homes: int, machines: int, crossing: list[Flow], sizes: MessageSizes, assumed: Assumptions) -> Bill:
    out_hz = sum(flow.bytes_hz for flow in crossing if flow.link in (DOWN, OUT))
    stored_gb = 2 * assumed.movements * assumed.keep_days * sizes.verdict / 1e9
    return Bill(
        machines=machines * assumed.core_hour * HOURS / homes,
        traffic=out_hz * HOURS * 3600 / 1e9 * assumed.egress_gb,
        storage=stored_gb * assumed.storage_gb,
        people=assumed.support_min / 60 * assumed.person_hour / 12,
    )


def power_cost(share: float, assumed: Assumptions) -> float:
    """Dollars per month for the power of that share of a busy core at home."""
    return share * assumed.core_watts / 1e3 * HOURS * assumed.kwh
