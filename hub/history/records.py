"""What is kept of a verdict or a fall: one row for each, with its last word, and the row as a line. Pure."""

import json
from dataclasses import dataclass
from typing import Any, Literal

from common import MS_NS, SECOND_NS
from common.fall_messages import FallMessage
from common.message_types import printable
from common.messages import VerdictMessage
from common.vocabulary import ABSTAIN
from hub.anticipation import probability
from hub.wording import calendar_time, clock_time, moment, percent, rounded

Kind = Literal["verdict", "fall"]
ROW_KINDS: tuple[Kind, ...] = ("verdict", "fall")
PAGE_FIELDS = (
    "kind", "id", "label", "began", "ended", "p", "agree", "of", "revises", "corrected", "person",
    "repetitions", "score",
)  # fmt: skip
PAGE_DETAIL = ("person", "repetitions", "score")
"""Of these the page shows what is there."""
DETAIL = (
    "person", "why", "unlearned", "repetitions", "score", "scores", "remarks", "unscored", "facing_deg", "rule",
    "fusion",
)  # fmt: skip
"""Further fields of a verdict that are kept where they are there."""


@dataclass(frozen=True, slots=True)
class HistoryRow:
    """One thing that happened. Times in ns since 1970, by the fusion machine's clock.

    stage: of the last word. p: how sure. k, n: how many agreed. revises: the label that was replaced. corrected: what
    somebody said that it was; "": none of the movements. detail: what else was known.
    """

    kind: Kind
    id: str
    label: str
    stage: str
    began_ns: int
    at_ns: int
    ended_ns: int | None = None
    p: float | None = None
    k: int = 0
    n: int = 0
    revises: str | None = None
    corrected: str | None = None
    detail: str = "{}"

    def as_page(self) -> list[Any]:
        """The row for the page, in the order of PAGE_FIELDS, times in ms since 1970."""
        ended = None if self.ended_ns is None else self.ended_ns // MS_NS
        more = json.loads(self.detail) if any(f'"{name}"' in self.detail for name in PAGE_DETAIL) else {}
        p = None if self.p is None else round(self.p, 3)
        return [
            self.kind, self.id, self.label, self.began_ns // MS_NS, ended, p, self.k, self.n, self.revises,
            self.corrected, *map(more.get, PAGE_DETAIL),
        ]  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """The row for programs: times as ISO 8601 (UTC), and `seconds`, how long it took."""
        seconds = None if self.ended_ns is None else rounded((self.ended_ns - self.began_ns) / SECOND_NS, 2)
        return {
            "kind": self.kind,
            "id": self.id,
            "label": self.label,
            "stage": self.stage,
            "began": moment(self.began_ns),
            "ended": None if self.ended_ns is None else moment(self.ended_ns),
            "seconds": seconds,
            "p": rounded(self.p, 3),
            "agree": self.k,
            "of": self.n,
            "revises": self.revises,
            "corrected": self.corrected,
            **json.loads(self.detail),
        }


def row_of(message: VerdictMessage | FallMessage) -> HistoryRow | None:
    """The row of a message; None for a stage of the watch that is no fall."""
    return _of_verdict(message) if isinstance(message, VerdictMessage) else _of_fall(message)


def _of_verdict(verdict: VerdictMessage) -> HistoryRow:
    fields = {name: getattr(verdict, name, None) for name in DETAIL}
    detail = {name: value for name, value in fields.items() if value is not None}
    return HistoryRow(
        "verdict", verdict.id, verdict.label, verdict.stage, verdict.began_ns, verdict.at_ns, verdict.ended_ns,
        probability(verdict), verdict.agreement.k, verdict.agreement.n, verdict.revises,
        detail=json.dumps(detail, allow_nan=False),
    )  # fmt: skip


def _of_fall(fall: FallMessage) -> HistoryRow | None:
    """A fall from the alarm on; lying for a moment is none, and the `up` after it changes nothing that is not kept."""
    if fall.id is None or fall.stage not in ("fallen", "up"):
        return None
    if fall.stage == "up":
        return HistoryRow("fall", fall.id, "fallen", "up", fall.since_ns, fall.at_ns, fall.since_ns)
    of_person = {} if fall.person is None else {"person": fall.person}
    fields = {"fusion": fall.fusion, "observers": dict(fall.observers), **of_person}
    agreement, detail = fall.agreement, json.dumps(fields)
    return HistoryRow(
        "fall", fall.id, "fallen", "fallen", fall.since_ns, fall.at_ns, None, fall.lying, agreement.k, agreement.n,
        detail=detail,
    )  # fmt: skip


def row_line(row: HistoryRow) -> tuple[str, str]:
    """The day, and `14:03:22  wave  3 of 4 agree  97%  1.8 s`, in local time."""
    time = calendar_time(row.began_ns)
    day = "unknown day" if time is None else f"{time.astimezone():%Y-%m-%d, %A}"
    took = "" if row.ended_ns is None else f"{(row.ended_ns - row.began_ns) / SECOND_NS:.1f} s"
    sure = "" if row.p is None else percent(row.p).strip()
    if row.kind == "fall":
        who = printable(json.loads(row.detail).get("person", "somebody"))
        words = [f"{who} fell" if row.ended_ns else f"{who} has fallen", f"{row.k} of {row.n} saw it", sure]
        words.append(f"up again after {took}" if took else "not seen up again")
    else:
        words = [what_of(row), f"{row.k} of {row.n} agree", sure, took]
    return day, "  ".join([clock_time(row.began_ns), *filter(None, words)])


def what_of(row: HistoryRow) -> str:
    """Who, of several people, the label, what it replaced, how often, and what somebody said that it was."""
    label = "no agreement" if row.label == ABSTAIN else row.label
    words = [f"{row.revises} -> {label}" if row.revises else label]
    detail = json.loads(row.detail)
    if (person := detail.get("person")) is not None:
        words.insert(0, f"{person}:")
    if (repetitions := detail.get("repetitions")) is not None:
        words.append(f"{repetitions} times")
    if (score := detail.get("score")) is not None:
        words.append(f"{score:.1f} of 10")
    if (reason := detail.get("unscored")) is not None:
        words.append(f"(not scored, {reason})")
    if row.corrected is not None:
        words.append(f"(was {row.corrected or 'something else'})")
    return printable(" ".join(words))
