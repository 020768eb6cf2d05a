"""What a replay found, as text for people and as JSON for programs. Pure."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from common.messages import VerdictMessage
from studies.rejudging import Change
from studies.replay import Replayed
from studies.verdict_rows import Row

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
