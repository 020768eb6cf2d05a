"""Households for corrections: two people in the sight of one camera, what one of them teaches, and what both do."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np

from benchmarks.taught.few_takes import RecordedRoom, florence3d_room, life_in, msr_room, nw_ucla_room
from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, labels_of

TAUGHT_TAKES = 2
LABELS, UNLEARNED = 4, 8
"""Movements that are taught, and others that are done, or as many as there are."""
LEAST_LABELS = 3
LIFE_S = 120.0
PEOPLE = {
    "msr": ("2", "4", "6", "8", "10"),
    "nw_ucla": ("1", "2", "3", "4", "5", "6"),
    "florence3d": tuple(map(str, range(1, 11))),
}
"""The figures are of these people; ways of learning were chosen with the others of MSR Action3D."""
ROOMS = {"msr": msr_room, "nw_ucla": nw_ucla_room, "florence3d": florence3d_room}


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
    """So many households of these people (none: as in PEOPLE) out of `recordings`, a name in ROOMS.

    whole_body: with every body part that was recorded, not hands and head alone.
    """

    recordings: str
    people: Sequence[str]
    count: int
    seed: int
    whole_body: bool = False


def one_camera(data: Path, name: str = "msr", whole_body: bool = False) -> RecordedRoom:
    """The recordings of this name as the first camera of the room sees it."""
    room = ROOMS[name](data, whole_body)
    name = next(iter(room.views))
    return replace(room, space={name: room.space[name]}, views={name: room.views[name]})


def ordinary_life(room: RecordedRoom, data: Path) -> dict[str, MotionArchive]:
    """LIFE_S of storytelling, as a lesson records ordinary life."""
    whole = life_in(room, data)
    return {name: replace(a, recordings=(_beginning(a.recordings[0]),)) for name, a in whole.items()}


def _beginning(recording: Recording) -> Recording:
    return replace(recording, positions=recording.positions[: round(LIFE_S * recording.rate_hz)])


def households(room: RecordedRoom, people: Sequence[str], count: int, seed: int) -> list[Household]:
    """`count` draws of two people, and of movements of which both have enough takes.

    Raises BadInput if no two of the people have enough.
    """
    rng = np.random.default_rng(seed)
    first = next(iter(room.space.values()))
    counts = Counter((r.subject, r.label) for r in first.recordings)
    least, needed = min(room.least, TAUGHT_TAKES + 1), min(LABELS + UNLEARNED, len(labels_of(first)))

    def labels_for(teacher: str, other: str) -> list[str]:
        """All that both can show; none if too few of them can be taught."""
        enough = [label for label in labels_of(first) if min(counts[teacher, label], counts[other, label]) >= least]
        can_be_taught = sum(counts[teacher, label] > TAUGHT_TAKES for label in enough)
        return enough if len(enough) >= needed and can_be_taught >= LEAST_LABELS else []

    if not any(labels_for(*pair) for pair in permutations(people, 2)):
        raise BadInput(f"--people {','.join(people)}: no two of them have enough takes of {needed} movements each")
    result: list[Household] = []
    for n in range(count):
        enough: list[str] = []
        while not enough:
            teacher, other = (people[k] for k in rng.permutation(len(people))[:2])
            enough = labels_for(teacher, other)
        labels = [enough[k] for k in rng.permutation(len(enough))]
        taught = [label for label in labels if counts[teacher, label] > TAUGHT_TAKES][:LABELS]
        others = [label for label in labels if label not in taught][:UNLEARNED]
        result.append(Household(teacher, other, tuple(taught), tuple(others), n))
    return result
