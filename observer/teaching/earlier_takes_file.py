"""Takes that an observer has set aside because another lesson began: they stay beside the file of its takes.

1. A set stays until a lesson with all its movements has ended well; the one that was set aside last stays in any case.
2. An observer keeps EARLIER_LIMIT sets: of more, the one with the fewest takes goes, the oldest of several.
3. Each is an archive with an id, NAME.before-ID.npz, and a note, NAME.before-ID.json, if its lesson had not ended.
   NAME.before.npz, of a version that kept one set, has the id `before`.
"""

import json
from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.errors import BadInput, LabanmeshError, reason_of
from common.teaching_messages import EARLIER_LIMIT, EarlierTakes
from common.vocabulary import LABEL
from observer.files import remove_file
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import read_archive

BEFORE = ".before"
ID_LENGTH = 8
"""Characters of an id, the first of the id of the teacher whose lesson came then: the same on all observers."""


@dataclass(frozen=True, slots=True)
class TakesSet:
    """One set of takes: the archive at `path`, and beside it the note of a lesson that has not ended."""

    path: Path

    @property
    def note(self) -> Path:
        """Where the note is, if there is one."""
        return self.path.with_suffix(".json")

    @property
    def unfinished(self) -> list[str] | None:
        """The movements of the lesson that has not ended; None: it has."""
        with suppress(OSError, ValueError, TypeError, AttributeError):
            labels = json.loads(self.note.read_text(encoding="utf-8")).get("labels")
            return [str(label) for label in labels]
        return None

    @property
    def archive(self) -> MotionArchive | None:
        """The recordings; None if they cannot be read."""
        with suppress(LabanmeshError):
            return read_archive(self.path)
        return None

    @property
    def lengths(self) -> list[tuple[str, float]]:
        """The label and the seconds of each recording; none if they cannot be read. The tracks are not: frames wait."""
        # The errors of zipfile and numpy for broken files have no common base class.
        # Opened here: numpy leaves a broken zip open.
        with suppress(Exception), self.path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            seconds = np.nan_to_num(arrays["lengths"] / arrays["rate_hz"]).clip(0)
            return list(zip(map(str, arrays["labels"]), map(float, seconds), strict=True))
        return []

    @property
    def counts(self) -> Counter[str]:
        """How many takes there are of each movement."""
        return Counter(label for label, _ in self.lengths if label)

    def move(self, path: Path) -> "TakesSet":
        """The set under another path; raises LabanmeshError. A move needs no space on the disk."""
        moved = TakesSet(path)
        try:
            if self.note.exists():
                self.note.replace(moved.note)
            self.path.replace(path)
        except OSError as error:
            raise LabanmeshError(f"{self.path}: cannot be renamed: {reason_of(error)}") from None
        return moved

    def remove(self) -> None:
        """Remove both files; raises LabanmeshError."""
        remove_file(self.path)
        remove_file(self.note)


class EarlierSets:
    """The sets beside the takes file `path`, as ID of NAME.before-ID.npz."""

    def __init__(self, path: Path) -> None:
        self._current, self._name = TakesSet(path), path.stem + BEFORE

    @property
    def sets(self) -> dict[str, TakesSet]:
        """All sets by id, the newest last."""
        names = [each for each in self._current.path.parent.glob("*.npz") if self._id_of(each)]
        return {self._id_of(path): TakesSet(path) for path in sorted(names, key=_changed_ns)}

    def set_aside(self, lesson: str) -> None:
        """Make the takes an earlier set, because `lesson` begins; raises LabanmeshError."""
        if not self._current.path.exists():
            return
        known = self.sets
        ids = (f"{lesson[:ID_LENGTH]}{f'-{n}' if n else ''}" for n in range(len(known) + 1))
        own = next(each for each in ids if each not in known)
        moved = self._current.move(self._current.path.with_name(f"{self._name}-{own}.npz"))
        with suppress(OSError):
            moved.path.touch()

    def resume(self, labels: Sequence[str]) -> None:
        """Take back the newest set of a lesson with these movements that has not ended, if there is one.

        Raises LabanmeshError.
        """
        begun = [each for each in self.sets.values() if each.unfinished == list(labels)]
        if begun and not self._current.path.exists():
            begun[-1].move(self._current.path)

    def restore(self, wanted: str, lesson: str) -> list[str]:
        """This set becomes the takes again, those of now an earlier set; returns its movements. Raises BadInput."""
        earlier = self.sets.get(wanted)
        if earlier is None:
            raise BadInput(f"no earlier takes {wanted or '(no id)'}; known: {', '.join(self.sets) or 'none'}")
        labels = earlier.unfinished or list(earlier.counts)
        self.set_aside(lesson)
        earlier.move(self._current.path)
        return labels

    def thin_out(self) -> None:
        """Remove what is over the limit; raises LabanmeshError."""
        sets = list(self.sets.values())
        if len(sets) > EARLIER_LIMIT:
            # The newest, which was set aside right now, stays.
            for each in sorted(sets[:-1], key=lambda each: each.counts.total())[: len(sets) - EARLIER_LIMIT]:
                each.remove()

    def ended_well(self, labels: Collection[str]) -> None:
        """Remove sets of these movements alone, but for the newest: a lesson with them has ended well."""
        for each in list(self.sets.values())[:-1]:
            counts = each.counts
            if counts and set(counts) <= set(labels):
                each.remove()

    def reports(self) -> list[EarlierTakes]:
        """What the sets hold, for people; the newest last."""
        return [_report(own, each) for own, each in list(self.sets.items())[-EARLIER_LIMIT:]]

    def _id_of(self, path: Path) -> str:
        """The id of a set; "" for any other file."""
        if path.stem == self._name:
            return BEFORE[1:]
        return path.stem.removeprefix(f"{self._name}-") if path.stem.startswith(f"{self._name}-") else ""


def _report(own: str, earlier: TakesSet) -> EarlierTakes:
    lengths = earlier.lengths
    return EarlierTakes(
        id=own,
        takes=Counter(label for label, _ in lengths if LABEL.match(label)),
        labels=[label for label in earlier.unfinished or () if LABEL.match(label)],
        other_s=sum(seconds for label, seconds in lengths if not label),
        at_ns=max(_changed_ns(earlier.path), 0),
    )


def _changed_ns(path: Path) -> int:
    with suppress(OSError):
        return path.stat().st_mtime_ns
    return 0
