"""Households for corrections: two people in the sight of one camera, what one of them teaches, and what both do."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.taught.few_takes import RecordedRoom, life_in, msr_room, nw_ucla_room
from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, labels_of

TAUGHT_TAKES = 2
LABELS, UNLEARNED = 4, 8
"""Movements that are taught, and others that are done, or as many as there are."""
LIFE_S = 120.0
PEOPLE = {"msr": ("2", "4", "6", "8", "10"), "nw_ucla": ("1", "2", "3", "4", "5", "6")}
"""The figures are of these people; ways of learning were chosen with the others of MSR Action3D."""
ROOMS = {"msr": msr_room, "nw_ucla": nw_ucla_room}


@dataclass(frozen=True, slots=True)
class Household:
    """Who teaches, who else lives there; the movements that are taught, and those that are also done."""

    teacher: str
    other: str
    labels: tuple[str, ...]
    unlearned: tuple[str, ...]
    seed: int


@dataclass(frozen=True, slots=True)
class Draws:
    """So many households of these people (none: as in PEOPLE) out of `recordings`, a name in ROOMS."""

    recordings: str
    people: Sequence[str]
    count: int
    seed: int


def one_camera(data: Path, name: str = "msr") -> RecordedRoom:
    """MSR Action3D, or nw_ucla, as the first camera of the room sees it."""
    room = ROOMS[name](data)
    name = next(iter(room.views))
    return replace(room, space={name: room.space[name]}, views={name: room.views[name]})


def ordinary_life(room: RecordedRoom, data: Path) -> dict[str, MotionArchive]:
    """LIFE_S of storytelling, as a lesson records ordinary life."""
    whole = life_in(room, data)
    return {name: replace(a, recordings=(_beginning(a.recordings[0]),)) for name, a in whole.items()}


def _beginning(recording: Recording) -> Recording:
    return replace(recording, positions=recording.positions[: round(LIFE_S * recording.rate_hz)])


def households(room: RecordedRoom, people: Sequence[str], count: int, seed: int) -> list[Household]:
    """`count` draws of two people, and of movements of which both have three takes.

    Raises BadInput if no two of the people have enough.
    """
    rng = np.random.default_rng(seed)
    first = next(iter(room.space.values()))
    counts = Counter((r.subject, r.label) for r in first.recordings)
    needed = min(LABELS + UNLEARNED, len(labels_of(first)))

    def labels_for(pair: Sequence[str]) -> list[str]:
        return [label for label in labels_of(first) if all(counts[s, label] > TAUGHT_TAKES for s in pair)]

    if all(len(labels_for(pair)) < needed for pair in combinations(people, 2)):
        raise BadInput(f"--people {','.join(people)}: no two of them have three takes of {needed} movements each")
    result: list[Household] = []
    for n in range(count):
        enough: list[str] = []
        while len(enough) < needed:
            chosen = [people[k] for k in rng.permutation(len(people))[:2]]
            enough = labels_for(chosen)
        labels = tuple(enough[k] for k in rng.permutation(len(enough)))
        result.append(Household(chosen[0], chosen[1], labels[:LABELS], labels[LABELS : LABELS + UNLEARNED], n))
    return result
