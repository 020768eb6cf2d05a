"""When something was done, as people type it: a verdict's id, `last`, a time of day, or how long ago. Pure."""

import re
from collections.abc import Sequence
from datetime import datetime, timedelta

from common import MS_NS, SECOND_NS
from common.errors import BadInput
from common.messages import VerdictMessage
from hub.scene_state import SceneState
from hub.teaching.correcting import Correction
from hub.wording import clock_time, label_words

NOTHING = "nothing"
"""Stands for something else than any movement; it can be no movement's name then."""
NEAR_NS = 1.5 * SECOND_NS
"""A verdict this near to a time is meant by it."""
_TIME = re.compile(r"(\d{1,2}):(\d\d):(\d\d)\Z")
_AGO = re.compile(r"(\d{1,6}(?:\.\d{1,6})?)\s*(s|min)\Z")
_ID = re.compile(r"(?P<scene>[a-z0-9_-]+)-(?P<began_ms>\d{12,14})\Z")
MOMENT_FORMS = (
    "the id of a verdict, last, a time of day (20:14:03), two (20:14:03..20:14:06), or how long ago (30s, 2min)"
)


def correction_of(when: str, label: str, verdicts: Sequence[VerdictMessage], now: datetime) -> Correction:
    """The correction that `--was WHEN LABEL` asks for.

    verdicts: those that are remembered, newest first. now: local, by the fusion service's clock. Raises BadInput.
    """
    label = "" if label == NOTHING else label
    if when == "last":
        if not verdicts:
            raise BadInput("--was last: no verdict is remembered; say when it was: " + MOMENT_FORMS)
        return Correction.of_verdict(verdicts[0], label)
    if (verdict := next((each for each in verdicts if each.id == when), None)) is not None:
        return Correction.of_verdict(verdict, label)
    if (match := _ID.match(when)) is not None:
        # The id of a verdict that the fusion service no longer remembers: its movement began then.
        return Correction(when, label, int(match["began_ms"]) * MS_NS)
    begin, separator, end = when.partition("..")
    began_ns = _moment_ns(begin, now)
    if separator:
        ended_ns = _moment_ns(end, now)
        if began_ns is None or ended_ns is None or ended_ns <= began_ns:
            raise BadInput(f"--was {when}: the end is not after the begin; two times are expected: 20:14:03..20:14:06")
        return Correction(f"span-{began_ns // MS_NS}", label, began_ns, ended_ns)
    if began_ns is None:
        raise BadInput(f"--was {when}: {MOMENT_FORMS} is expected{remembered(verdicts)}")
    near = [each for each in verdicts if _distance_ns(each, began_ns) <= NEAR_NS]
    if near:
        return Correction.of_verdict(min(near, key=lambda each: _distance_ns(each, began_ns)), label)
    return Correction(f"moment-{began_ns // MS_NS}", label, began_ns, began_ns)


def fusion_ns(state: SceneState, machine_ns: int) -> int:
    """The time now by the clock of the fusion service, ns; this machine's if it says none."""
    if state.judgement is None:
        return machine_ns
    return state.judgement.at_ns + round(state.silence_s * SECOND_NS)


def remembered(verdicts: Sequence[VerdictMessage]) -> str:
    """The verdicts that can be named, as the end of a line; "" without any."""
    known = ", ".join(f"{each.id} ({clock_time(each.began_ns)} {label_words(each)})" for each in verdicts)
    return f"; the last verdicts: {known}" if known else ""


def _moment_ns(text: str, now: datetime) -> int | None:
    """A time of day, the last before now, or how long ago; None for anything else."""
    if (match := _AGO.match(text)) is not None:
        at = now - timedelta(seconds=float(match[1]) * (60 if match[2] == "min" else 1))
    elif (match := _TIME.match(text)) is not None and int(match[1]) < 24 and int(match[2]) < 60 and int(match[3]) < 60:
        at = now.replace(hour=int(match[1]), minute=int(match[2]), second=int(match[3]), microsecond=0)
        at = at if at <= now else at - timedelta(days=1)
    else:
        return None
    return round(at.timestamp() * SECOND_NS)


def _distance_ns(verdict: VerdictMessage, at_ns: int) -> int:
    """How far a moment is from the movement of a verdict; 0 within it."""
    ended_ns = verdict.ended_ns or verdict.decided_ns
    return max(verdict.began_ns - at_ns, at_ns - ended_ns, 0)
