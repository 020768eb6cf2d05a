"""What is kept of a verdict or a fall: one row for each, with its last word. Pure."""

import json
from dataclasses import dataclass
from typing import Any, Literal

from common import MS_NS, SECOND_NS
from common.fall_messages import FallMessage
from common.messages import VerdictMessage
from hub.anticipation import probability
from hub.wording import moment, rounded

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
