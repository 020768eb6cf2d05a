"""A row of the history as a line. Pure."""

import json

from common import SECOND_NS
from common.message_types import printable
from common.vocabulary import ABSTAIN
from hub.history.records import HistoryRow
from hub.wording import calendar_time, clock_time, percent


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
