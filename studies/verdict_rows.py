"""Verdicts side by side: those that were recorded and those of the same time that are judged anew. Pure.

A movement is one row: all that was said of it (when it was decided, and when it had ended) under one id. Verdicts of
other ids, as a changed referee gives them, belong together when their movements overlap in time.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from common.messages import VerdictMessage

Likeness = Literal["bit for bit", "same label", "another label", "not judged", "not recorded"]


@dataclass(frozen=True, slots=True)
class Saying:
    """One verdict, and as which bytes it was or would be said."""

    verdict: VerdictMessage
    payload: bytes


@dataclass(frozen=True, slots=True)
class Row:
    """One movement: what was recorded of it and what is said of it now, in the order of saying; one may be empty.

    `partly`: something happened meanwhile that is not in the capture, so that the two need not agree.
    """

    recorded: tuple[Saying, ...]
    anew: tuple[Saying, ...]
    partly: bool = False

    @property
    def said(self) -> VerdictMessage | None:
        """The last word that was recorded."""
        return self.recorded[-1].verdict if self.recorded else None

    @property
    def judged(self) -> VerdictMessage | None:
        """The last word now."""
        return self.anew[-1].verdict if self.anew else None

    @property
    def began_ns(self) -> int:
        """When the movement began, as recorded if it was."""
        return (self.recorded or self.anew)[0].verdict.began_ns

    @property
    def likeness(self) -> Likeness:
        """How far the two agree: on every bit of all that was said, on the label, or not."""
        if self.said is None:
            return "not recorded"
        if self.judged is None:
            return "not judged"
        if [saying.payload for saying in self.recorded] == [saying.payload for saying in self.anew]:
            return "bit for bit"
        return "same label" if self.said.label == self.judged.label else "another label"


def rows_of(recorded: Iterable[Saying], anew: Iterable[Saying], unsure: Sequence[tuple[int, int]]) -> list[Row]:
    """One row for each movement, by time; those that go on in one of the `unsure` spans are known in part only."""
    rows = [
        Row(tuple(was), tuple(now), _partly(was or now, unsure)) for was, now in _paired(_by_id(recorded), _by_id(anew))
    ]
    return sorted(rows, key=lambda row: row.began_ns)


def _partly(said: Sequence[Saying], unsure: Sequence[tuple[int, int]]) -> bool:
    began_ns, until_ns = said[0].verdict.began_ns, said[-1].verdict.at_ns
    return any(began_ns <= last_ns and first_ns <= until_ns for first_ns, last_ns in unsure)


def _by_id(sayings: Iterable[Saying]) -> dict[str, list[Saying]]:
    """What was said of each movement; a copy that came twice is one saying."""
    movements: dict[str, list[Saying]] = {}
    for saying in sayings:
        said = movements.setdefault(saying.verdict.id, [])
        if saying not in said:
            said.append(saying)
    return movements


def _paired(
    recorded: Mapping[str, list[Saying]], anew: Mapping[str, list[Saying]]
) -> Iterator[tuple[list[Saying], list[Saying]]]:
    """Movements of both, by their ids, else by overlap in time, else alone."""
    yield from ((recorded[name], anew[name]) for name in recorded if name in anew)
    later = sorted((said for name, said in anew.items() if name not in recorded), key=_span)
    for said in sorted((said for name, said in recorded.items() if name not in anew), key=_span):
        began_ns, ended_ns = _span(said)
        while later and _span(later[0])[1] <= began_ns:
            yield [], later.pop(0)
        yield said, later.pop(0) if later and _span(later[0])[0] < ended_ns else []
    yield from (([], said) for said in later)


def _span(said: Sequence[Saying]) -> tuple[int, int]:
    last = said[-1].verdict
    return last.began_ns, last.at_ns if last.ended_ns is None else last.ended_ns
