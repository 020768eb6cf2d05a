"""Recorded verdicts beside those judged again, as rows, text and JSON. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from common.messages import VerdictMessage
from studies.replay.from_judgements import Change

Source = Literal["judgements", "posteriors"]
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


@dataclass(frozen=True, slots=True)
class Replayed:
    """A capture judged anew.

    `judgements` were recorded, of which `same` came out bit for bit; `missing` were made and not heard.
    """

    source: Source
    change: Change
    rows: Sequence[Row]
    records: int
    seconds: float
    began_ns: int
    judgements: int = 0
    same: int = 0
    missing: int = 0

    @property
    def faithful(self) -> bool:
        """Whether nothing came out otherwise than it may: with a change anything may, and so may what began before."""
        if self.change.any:
            return True
        enough = {"bit for bit"} if self.source == "judgements" else {"bit for bit", "same label"}
        recorded = any(row.recorded for row in self.rows) or self.judgements > 0
        return not recorded or all(row.likeness in enough for row in self.rows if not row.partly)


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


NONE = "-"


def as_text(found: Replayed, name: str, complete: bool) -> str:
    """The table of verdicts, with what the capture is above it and the sum of it below."""
    what = _worded(found.change)
    head = ["began", "lasted", "recorded", "agreed", what or "judged anew", "agreed", "stands" if what else "same"]
    cells = [_cells(row, found) for row in found.rows]
    table = _aligned([head, *cells]) if cells else "no verdict in it, neither recorded nor judged anew"
    return "\n".join([_title(found, name, complete), "", table, "", *_sum(found)])


def as_json(found: Replayed, name: str, complete: bool) -> dict[str, Any]:
    """The same for programs; times in ns since 1970, labels null where nothing was said."""
    change = found.change
    return {
        "version": 1,
        "capture": name,
        "complete": complete,
        "from": found.source,
        "change": {
            "without": list(change.without), "rule": change.rule, "quorum": change.quorum,
            "threshold": change.threshold,
        },
        "judgements": {"recorded": found.judgements, "same": found.same, "missing": found.missing},
        "verdicts": [_row_as_json(row) for row in found.rows],
        "faithful": found.faithful,
    }  # fmt: skip


def _row_as_json(row: Row) -> dict[str, Any]:
    said = {"recorded": _verdict_as_json(row.said), "anew": _verdict_as_json(row.judged)}
    return {"began_ns": row.began_ns, "likeness": row.likeness, "stands": _stands(row), "partly": row.partly, **said}


def _verdict_as_json(verdict: VerdictMessage | None) -> dict[str, Any] | None:
    if verdict is None:
        return None
    fields = ("id", "label", "began_ns", "decided_ns", "ended_ns", "certainty_bits")
    agreement = {"agreement": verdict.agreement.model_dump()}
    return {name: getattr(verdict, name) for name in fields} | agreement


def _title(found: Replayed, name: str, complete: bool) -> str:
    began = datetime.fromtimestamp(found.began_ns / 1e9, tz=UTC)
    cut = "" if complete else "; it was cut off, what was heard until then is there"
    missing = f", {found.missing} more were not heard" if found.missing else ""
    return (
        f"{name}: {found.seconds:.1f} s from {began:%Y-%m-%d %H:%M:%S} UTC, {found.records} messages, "
        f"{found.judgements} judgements{missing}{cut}\njudged anew from its {found.source}"
    )


def _cells(row: Row, found: Replayed) -> list[str]:
    last = row.said or row.judged
    lasted = "" if last is None or last.ended_ns is None else f"{(last.ended_ns - last.began_ns) / 1e9:.1f}s"
    compared = ("yes" if _stands(row) else "no") if found.change.any else row.likeness
    began = f"{(row.began_ns - found.began_ns) / 1e9:.1f}s"
    known = f"{compared}; not all of it is in the capture" if _in_part(row) else compared
    return [began, lasted, _label(row.said), _agreed(row.said), _label(row.judged), _agreed(row.judged), known]


def _sum(found: Replayed) -> list[str]:
    recorded = [row for row in found.rows if row.recorded and not _in_part(row)]
    parts = sum(map(_in_part, found.rows))
    rest = f"; {parts} more not all of which is in the capture" if parts else ""
    if found.change.any:
        stand = sum(map(_stands, recorded))
        new = sum(not row.recorded and not row.partly for row in found.rows)
        more = f"; {new} that were not said before" if new else ""
        return [f"{_worded(found.change)}: {stand} of {len(recorded)} verdicts stand{more}{rest}"]
    if found.source == "posteriors":
        same = sum(row.likeness in ("bit for bit", "same label") for row in recorded)
        judged = sum(row.judged is not None for row in found.rows)
        compared = f"; {same} of {len(recorded)} recorded ones the same{rest}" if recorded else ""
        return [f"{judged} verdicts{compared}"]
    same = sum(row.likeness == "bit for bit" for row in recorded)
    steps = f"{found.same} of {found.judgements} judgements"
    lines = [f"{same} of {len(recorded)} verdicts the same bit for bit, {steps}{rest}"]
    if not found.faithful:
        lines.append(
            "they differ: another version of labanmesh or numpy, another processor, a capture of a replay at another "
            "speed, or settings from the environment of the fusion service, which the capture does not know"
        )
    return lines


def _in_part(row: Row) -> bool:
    """Known in part, and it shows: one that is the same all the same needs no excuse."""
    return row.partly and row.likeness != "bit for bit"


def _stands(row: Row) -> bool:
    return row.said is not None and row.judged is not None and row.said.label == row.judged.label


def _worded(change: Change) -> str:
    """`without shelf, rule log`; empty for no change."""
    said = [f"without {observer}" for observer in change.without]
    values = (("rule", change.rule), ("quorum", change.quorum), ("threshold", change.threshold))
    return ", ".join([*said, *(f"{name} {value}" for name, value in values if value is not None)])


def _label(verdict: VerdictMessage | None) -> str:
    return NONE if verdict is None else verdict.label


def _agreed(verdict: VerdictMessage | None) -> str:
    return "" if verdict is None else f"{verdict.agreement.k} of {verdict.agreement.n}"


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    """Columns as wide as their widest cell; the first two, numbers, to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(_padded(n, cell, widths[n]) for n, cell in enumerate(row)) for row in rows]
    ruled = [lines[0].rstrip(), "-" * sum(widths, 2 * (len(widths) - 1)), *(line.rstrip() for line in lines[1:])]
    return "\n".join(ruled)


def _padded(column: int, cell: str, width: int) -> str:
    return cell.rjust(width) if column < 2 else cell.ljust(width)
