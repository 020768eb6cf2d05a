"""Fusion processes that share scenes, simulated: who judges which, and what one's death or coming does. Pure.

The share is found by the very function by which the processes find it: fusion/sharing.py:ranked.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fusion.sharing import ranked
from studies.scale.measured import Costs
from studies.scale.process import Load, Stay, Trace, shared

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
        count[ranked(scene, count)[0]] += 1
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
    holder = {n: (ranked(scene, alive)[0], 0.0) for n, scene in enumerate(scenes)}
    moved = 0
    for change in sorted(changes, key=lambda change: change.at_s):
        alive = alive | {change.service} if change.alive else alive - {change.service}
        for n, scene in enumerate(scenes):
            before, begin_s = holder[n]
            heaviest = ranked(scene, alive)[0]
            if heaviest != before:
                moved += 1
                stays[before].append(Stay(n, begin_s, change.at_s))
                holder[n] = heaviest, change.at_s + (0.0 if change.alive else NOTICE_S)
    for n, (last, begin_s) in holder.items():
        stays[last].append(Stay(n, begin_s))
    return {service: sorted(own, key=lambda stay: stay.scene) for service, own in stays.items()}, moved
