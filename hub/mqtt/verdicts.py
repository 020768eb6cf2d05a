"""Verdicts as events: which are said to the broker, each once, also over a restart of the hub. Pure.

1. `verdict`: once a movement, when it is decided (stage `decided`); again only if the judges have come to hold another
   label when it has ended (stage `revised`).
2. `ended`: once a movement, when it has ended.
3. What was said before the hub came is no event, but for what was said since the hub was last here.
4. An event that could not be delivered for EVENT_S is left out: a light that goes on later would be a riddle.
"""

import json
from collections import OrderedDict
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from common.messages import VerdictMessage
from hub.mqtt.facets import facets_of, facing_of
from hub.mqtt.names import Names
from hub.mqtt.picture import confidence, rounded, unlearned, votes

EVENT_S = 30.0
REMEMBERED = 64


class Herald:
    """What was said of which verdict; `hear` gives the events that a verdict makes, topic and payload."""

    def __init__(self, names: Names) -> None:
        self._names = names
        self._told: OrderedDict[str, tuple[str, bool]] = OrderedDict()
        self.last: VerdictMessage | None = None

    def hear(self, verdict: VerdictMessage) -> list[tuple[str, str]]:
        """The events that `verdict` makes; none for a copy."""
        before = self._told.get(verdict.id)
        self.learn(verdict)
        return list(self._events(verdict, before))

    def learn(self, verdict: VerdictMessage) -> None:
        """Know a verdict that is no event any more."""
        label, ended = self._told.pop(verdict.id, ("", False))
        self._told[verdict.id] = (verdict.label, ended or verdict.ended_ns is not None)
        while len(self._told) > REMEMBERED:
            self._told.popitem(last=False)
        if self.last is None or self.last.id == verdict.id or not label:
            self.last = verdict

    def _events(self, verdict: VerdictMessage, before: tuple[str, bool] | None) -> Iterator[tuple[str, str]]:
        if before is None or before[0] != verdict.label:
            stage = "decided" if before is None else "revised"
            yield self._names.verdict, json.dumps(said_of(verdict, stage), allow_nan=False)
        if verdict.ended_ns is not None and not (before and before[1]):
            yield self._names.ended, json.dumps(said_of(verdict, "ended"), allow_nan=False)


def said_of(verdict: VerdictMessage, stage: str) -> dict[str, Any]:
    """A verdict as an event: `event_type` is its label."""
    how = {"facets": facets_of(verdict), "facing": facing_of(verdict), "contributions": _contributions(verdict)}
    return {"event_type": verdict.label, "stage": stage, **_facts(verdict), **votes(verdict), **how}


def remembered(verdict: VerdictMessage) -> str:
    """A verdict as the retained state of a sensor; `said_ns` is where the hub goes on after a restart."""
    return json.dumps({"label": verdict.label, **_facts(verdict), "said_ns": verdict.at_ns}, allow_nan=False)


def recalled(payload: bytes | str) -> int | None:
    """The `said_ns` of what an earlier hub has left at the broker; None where that is not ours."""
    try:
        said = json.loads(payload)
    except ValueError:
        return None
    said_ns = said.get("said_ns") if isinstance(said, dict) else None
    return said_ns if isinstance(said_ns, int) else None


def _facts(verdict: VerdictMessage) -> dict[str, Any]:
    ended = verdict.ended_ns
    return {
        "id": verdict.id,
        "began": moment(verdict.began_ns),
        "decided": moment(verdict.decided_ns),
        "ended": None if ended is None else moment(ended),
        "duration": None if ended is None else rounded((ended - verdict.began_ns) / 1e9, 1),
        "confidence": confidence(verdict),
        "entropy": rounded(verdict.certainty_bits, 2),
        "unlearned": unlearned(verdict),
    }


def _contributions(verdict: VerdictMessage) -> dict[str, Any] | None:
    """What each judge did to it: nats, and whether it stands without him; None where the referee does not say it."""
    said = verdict.contributions
    return said and {name: {"nats": rounded(each.nats, 2), "stands": each.stands} for name, each in said.items()}


def moment(at_ns: int) -> str | None:
    """ISO 8601, UTC; None for a time that no calendar has."""
    try:
        return datetime.fromtimestamp(at_ns / 1e9, UTC).isoformat(timespec="milliseconds")
    except (ValueError, OverflowError, OSError):
        return None
