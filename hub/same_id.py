"""Ids that two processes have now, as the fusion services report it. Pure: times are passed in."""

from collections.abc import Iterator, Mapping

from common import SECOND_NS
from common.message_types import SAME_ID_REASON
from common.messages import StatusMessage

SHOWN_S = 10.0
"""Shown for so long after the last report; a service reports each second."""
REASON = "same_id"
"""Under which a fusion service counts messages of the other process."""

Reports = Mapping[str, int]
"""By id when it was last reported (ns)."""


def with_reports(known: Reports, before: StatusMessage | None, status: StatusMessage, now_ns: int) -> Reports:
    """`known` with what a fusion service reports now. before: its status before this one."""
    ids = dict.fromkeys(_reported(before, status), now_ns)
    return {**known, **ids} if ids else known


def _reported(before: StatusMessage | None, status: StatusMessage) -> Iterator[str]:
    if status.reason == SAME_ID_REASON:
        yield status.id
    counted = (before.observers if before else None) or {}
    for name, statistics in (status.observers or {}).items():
        past = counted[name].rejected.get(REASON, 0) if name in counted else 0
        if statistics.rejected.get(REASON, 0) > past:
            yield name


def at(reports: Reports, now_ns: int) -> tuple[str, ...]:
    """The ids that two processes have now."""
    return tuple(sorted(name for name, at_ns in reports.items() if now_ns - at_ns < SHOWN_S * SECOND_NS))


def in_words(ids: tuple[str, ...]) -> str:
    """One clear line; "" without any."""
    return f"two processes have the id {', '.join(ids)}" if ids else ""
