"""Recorded verdicts beside those judged again, as rows, text and JSON. Pure.

A movement is one row: all messages with one verdict id (decided, revised, ended). Verdicts with different ids, as a
changed engine gives them, share a row when their movements overlap in time.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from common import SECOND_NS
from common.messages import VerdictMessage
from common.text import plural
from studies.replay.from_judgements import Gap, ReplayChange

Likeness = Literal["bit for bit", "same label", "another label", "not judged", "not recorded"]
NO_VALUE = "-"


@dataclass(frozen=True, slots=True)
class VerdictRecord:
    """A verdict and its bytes on the wire."""

    verdict: VerdictMessage
    payload: bytes


@dataclass(frozen=True, slots=True)
class VerdictComparison:
    """The messages about one movement, as recorded and as judged again, in order; one may be empty.

    `partly`: part of the movement is in a gap of the capture, so the two need not agree.
    """

    recorded: tuple[VerdictRecord, ...]
    replayed: tuple[VerdictRecord, ...]
    partly: bool = False

    @property
    def last_recorded(self) -> VerdictMessage | None:
        """The last recorded message; None without one."""
        return self.recorded[-1].verdict if self.recorded else None

    @property
    def last_replayed(self) -> VerdictMessage | None:
        """The last message of the replay; None without one."""
        return self.replayed[-1].verdict if self.replayed else None

    @property
    def began_ns(self) -> int:
        """The begin of the movement, the recorded one if there is one."""
        return (self.recorded or self.replayed)[0].verdict.began_ns

    @property
    def likeness(self) -> Likeness:
        """Whether the two agree in every bit, in the label, or not."""
        recorded, replayed = self.last_recorded, self.last_replayed
        if recorded is None:
            return "not recorded"
        if replayed is None:
            return "not judged"
        if [record.payload for record in self.recorded] == [record.payload for record in self.replayed]:
            return "bit for bit"
        return "same label" if recorded.label == replayed.label else "another label"

    @property
    def stands(self) -> bool:
        """Whether both have a verdict with the same label."""
        return self.likeness in ("bit for bit", "same label")

    @property
    def comparable(self) -> bool:
        """Whether the row counts: not partly in a gap, or equal all the same."""
        return not self.partly or self.likeness == "bit for bit"


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """A capture judged again: `same` of its `judgements` are equal bit for bit; `missing` were not captured."""

    change: ReplayChange
    rows: Sequence[VerdictComparison]
    records: int
    seconds: float
    began_ns: int
    judgements: int = 0
    same: int = 0
    missing: int = 0

    @property
    def faithful(self) -> bool:
        """Whether the replay agrees with the recording wherever it should: not with a change, not in a gap."""
        if self.change.any:
            return True
        return all(row.likeness == "bit for bit" for row in self.rows if not row.partly)


def compare_verdicts(
    recorded: Iterable[VerdictRecord], replayed: Iterable[VerdictRecord], gaps: Sequence[Gap]
) -> list[VerdictComparison]:
    """One row per movement, by time; rows that overlap a gap are `partly`."""
    rows = [
        VerdictComparison(tuple(was), tuple(now), _in_gap(was or now, gaps))
        for was, now in _paired(_by_id(recorded), _by_id(replayed))
    ]
    return sorted(rows, key=lambda row: row.began_ns)


def _in_gap(records: Sequence[VerdictRecord], gaps: Sequence[Gap]) -> bool:
    began_ns, until_ns = records[0].verdict.began_ns, records[-1].verdict.at_ns
    return any(began_ns <= gap.last_ns and gap.first_ns <= until_ns for gap in gaps)


def _by_id(records: Iterable[VerdictRecord]) -> dict[str, list[VerdictRecord]]:
    """The messages of each movement, by the movement's id, without duplicates."""
    movements: dict[str, list[VerdictRecord]] = {}
    for record in records:
        own = movements.setdefault(record.verdict.id, [])
        if record not in own:
            own.append(record)
    return movements


def _paired(
    recorded: Mapping[str, list[VerdictRecord]], replayed: Mapping[str, list[VerdictRecord]]
) -> Iterator[tuple[list[VerdictRecord], list[VerdictRecord]]]:
    """Movements of both, paired by id, else by overlap in time, else alone."""
    yield from ((recorded[name], replayed[name]) for name in recorded if name in replayed)
    later = sorted((own for name, own in replayed.items() if name not in recorded), key=_span_ns)
    for own in sorted((own for name, own in recorded.items() if name not in replayed), key=_span_ns):
        began_ns, ended_ns = _span_ns(own)
        while later and _span_ns(later[0])[1] <= began_ns:
            yield [], later.pop(0)
        yield own, later.pop(0) if later and _span_ns(later[0])[0] < ended_ns else []
    yield from (([], own) for own in later)


def _span_ns(records: Sequence[VerdictRecord]) -> tuple[int, int]:
    last = records[-1].verdict
    return last.began_ns, last.at_ns if last.ended_ns is None else last.ended_ns


def as_text(result: ReplayResult, name: str, complete: bool) -> str:
    """The capture's title, the table of verdicts, and the counts."""
    change = _change_text(result.change)
    head = ["began", "lasted", "recorded", "agreed", change or "judged again", "agreed", "stands" if change else "same"]
    cells = [_cells(row, result) for row in result.rows]
    table = _aligned([head, *cells]) if cells else "no verdicts, neither recorded nor judged again"
    gone = result.change.gone
    rule = f"; its rule {gone!r} is gone, {result.change.rule!r} judges in its place" if gone else ""
    return "\n".join([_title(result, name, complete) + rule, "", table, "", *_counts(result)])


def as_json(result: ReplayResult, name: str, complete: bool) -> dict[str, Any]:
    """The same for programs; times in ns since 1970, null where there is no verdict."""
    change = result.change
    return {
        "version": 1,
        "capture": name,
        "complete": complete,
        "from": "judgements",
        "change": {
            "without": list(change.without), "rule": change.rule, "quorum": change.quorum,
            "threshold": change.threshold, "gone": change.gone,
        },
        "judgements": {"recorded": result.judgements, "same": result.same, "missing": result.missing},
        "verdicts": [_row_as_json(row) for row in result.rows],
        "faithful": result.faithful,
    }  # fmt: skip


def _row_as_json(row: VerdictComparison) -> dict[str, Any]:
    verdicts = {"recorded": _verdict_as_json(row.last_recorded), "anew": _verdict_as_json(row.last_replayed)}
    return {
        "began_ns": row.began_ns, "likeness": row.likeness, "stands": row.stands, "partly": row.partly, **verdicts
    }  # fmt: skip


def _verdict_as_json(verdict: VerdictMessage | None) -> dict[str, Any] | None:
    if verdict is None:
        return None
    fields = ("id", "label", "stage", "revises", "why", "began_ns", "decided_ns", "ended_ns", "certainty_bits")
    return {name: getattr(verdict, name) for name in fields} | {"agreement": verdict.agreement.model_dump()}


def _title(result: ReplayResult, name: str, complete: bool) -> str:
    began = datetime.fromtimestamp(result.began_ns / SECOND_NS, tz=UTC)
    cut = "" if complete else "; the capture was cut off"
    missing = f", {result.missing} more not captured" if result.missing else ""
    return (
        f"{name}: {result.seconds:.1f} s from {began:%Y-%m-%d %H:%M:%S} UTC, {plural(result.records, 'message')}, "
        f"{plural(result.judgements, 'judgement')}{missing}{cut}\njudged again from its judgements"
    )


def _cells(row: VerdictComparison, result: ReplayResult) -> list[str]:
    recorded, replayed = row.last_recorded, row.last_replayed
    last = recorded or replayed
    lasted = "" if last is None or last.ended_ns is None else f"{(last.ended_ns - last.began_ns) / SECOND_NS:.1f}s"
    compared = ("yes" if row.stands else "no") if result.change.any else row.likeness
    began = f"{(row.began_ns - result.began_ns) / SECOND_NS:.1f}s"
    known = compared if row.comparable else f"{compared}; partly captured"
    return [began, lasted, _label(recorded), _agreed(recorded), _label(replayed), _agreed(replayed), known]


def _counts(result: ReplayResult) -> list[str]:
    recorded = [row for row in result.rows if row.recorded and row.comparable]
    parts = sum(not row.comparable for row in result.rows)
    rest = f"; {parts} more partly captured" if parts else ""
    total = plural(len(recorded), "verdict")
    if result.change.any:
        stand = sum(row.stands for row in recorded)
        new = sum(not row.recorded and not row.partly for row in result.rows)
        return [f"{_change_text(result.change)}: {stand} of {total} stand{f'; {new} new' if new else ''}{rest}"]
    same = sum(row.likeness == "bit for bit" for row in recorded)
    lines = [f"{same} of {total} the same bit for bit, {result.same} of {result.judgements} judgements{rest}"]
    if not result.faithful:
        lines.append(
            "reasons for a difference: another version of labanmesh or numpy, another processor, a capture of a replay "
            "at another speed, or environment variables of the fusion service, which are not in the capture"
        )
    return lines


def _change_text(change: ReplayChange) -> str:
    """`without shelf, rule log`; empty for no change."""
    without = [f"without {observer}" for observer in change.without]
    values = (("rule", change.rule), ("quorum", change.quorum), ("threshold", change.threshold))
    return ", ".join([*without, *(f"{name} {value}" for name, value in values if value is not None)])


def _label(verdict: VerdictMessage | None) -> str:
    """The label; of a corrected verdict `bowing -> lunging`."""
    if verdict is None:
        return NO_VALUE
    return verdict.label if verdict.revises is None else f"{verdict.revises} -> {verdict.label}"


def _agreed(verdict: VerdictMessage | None) -> str:
    return "" if verdict is None else f"{verdict.agreement.k} of {verdict.agreement.n}"


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    """Columns as wide as their widest cell; the first two, numbers, aligned to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.rjust(widths[n]) if n < 2 else cell.ljust(widths[n]) for n, cell in enumerate(row)).rstrip()
        for row in rows
    ]
    return "\n".join([lines[0], "-" * sum(widths, 2 * (len(widths) - 1)), *lines[1:]])
