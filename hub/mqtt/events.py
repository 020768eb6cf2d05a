"""Verdicts and early words as events: each is published once, also over a restart of the hub. Pure.

1. `verdict`: the first word on a movement, once (stage `decided`), also if that word is its last; again only when
   another label replaces it (stage `revised`, with the label before in `revises`).
2. `ended`: once a movement, when it has ended, with its last label.
3. `early`: one event when a movement is named early, one when that word is settled (hub/anticipation.py).
4. A verdict from before the hub started, or lost its link, is no event, unless the hub was away only for a moment.
5. An event that could not be delivered within EVENT_S is left out: a light that reacts later would confuse people.
"""

import json
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from common import SECOND_NS
from common.fall_messages import FallMessage
from common.messages import VerdictMessage, VerdictStage
from hub.anticipation import EarlyWord
from hub.mqtt.entities import Topics
from hub.mqtt.states import confidence, facet_poles, facing_degrees, unlearned, votes
from hub.wording import moment, rounded

EVENT_S = 30.0
HISTORY_LIMIT = 64


@dataclass(frozen=True, slots=True)
class Publication:
    """One message for the broker."""

    topic: str
    payload: str
    retain: bool = True


@dataclass(frozen=True, slots=True)
class _Published:
    label: str
    ended: bool
    at_ns: int


class VerdictEvents:
    """Remembers which verdicts were published; `update` returns the events of a verdict."""

    def __init__(self, topics: Topics) -> None:
        self._topics = topics
        self._published: OrderedDict[str, _Published] = OrderedDict()
        self.last: VerdictMessage | None = None

    def update(self, verdict: VerdictMessage) -> list[Publication]:
        """The events of `verdict`; none for a copy, nor for an older word that comes late."""
        before = self._published.get(verdict.id)
        if before is not None and verdict.at_ns < before.at_ns:
            return []
        self.remember(verdict)
        return list(self._events(verdict, before))

    def remember(self, verdict: VerdictMessage) -> None:
        """Note a verdict that is no event any more."""
        before = self._published.pop(verdict.id, None)
        ended = verdict.ended_ns is not None or (before is not None and before.ended)
        self._published[verdict.id] = _Published(verdict.label, ended, verdict.at_ns)
        while len(self._published) > HISTORY_LIMIT:
            self._published.popitem(last=False)
        if self.last is None or self.last.id == verdict.id or before is None:
            self.last = verdict

    def _events(self, verdict: VerdictMessage, before: _Published | None) -> Iterator[Publication]:
        if before is None or before.label != verdict.label:
            # A fusion service of an earlier version revises at the end and does not say what.
            replaced = verdict.revises if before is None else before.label
            stage: VerdictStage = "decided" if before is None and verdict.stage != "revised" else "revised"
            revises = replaced if stage == "revised" else None
            yield _event(self._topics.of("verdict"), verdict_event(verdict, stage, revises))
        if verdict.ended_ns is not None and not (before and before.ended):
            yield _event(self._topics.of("ended"), verdict_event(verdict, "ended", verdict.revises))


def verdict_event(verdict: VerdictMessage, stage: VerdictStage, revises: str | None = None) -> dict[str, Any]:
    """A verdict as an event; `event_type` is its label. revises: the label that it replaces."""
    how = {"facets": facet_poles(verdict), "facing": facing_degrees(verdict), "contributions": _contributions(verdict)}
    words = {"event_type": verdict.label, "stage": stage, "revises": revises, "why": verdict.why}
    return {**words, **_facts(verdict), **votes(verdict), **how}


def early_event(topics: Topics, word: EarlyWord) -> Publication:
    """An early word as an event; `event_type` is the movement's label now."""
    fields = {
        "event_type": word.label,
        "stage": word.stage,
        "early": word.early,
        "confidence": rounded(100 * word.p, 0),
        "id": word.id,
        "began": moment(word.began_ns),
        "said": moment(word.at_ns),
    }
    return _event(topics.of("early"), fields)


def last_verdict_state(verdict: VerdictMessage) -> str:
    """A verdict as the retained state of a sensor; a restarted hub continues from its `said_ns`."""
    words = {"label": verdict.label, "stage": verdict.stage, "revises": verdict.revises, "why": verdict.why}
    return json.dumps({**words, **_facts(verdict), "said_ns": verdict.at_ns}, allow_nan=False)


def last_event_state(verdict: VerdictMessage | None, fall: FallMessage | None) -> str | None:
    """What happened last, a movement or a fall, as the retained state of a sensor; None: nothing yet."""
    has_fall = fall is not None and fall.id is not None and fall.stage in ("fallen", "up")
    if fall is not None and has_fall and (verdict is None or fall.since_ns >= verdict.began_ns):
        event = "fallen" if fall.stage == "fallen" else "up_again"
        fields = {"event": event, "kind": "fall", "id": fall.id, "when": moment(fall.since_ns)}
        fields |= {} if fall.person is None else {"person": fall.person}
        return json.dumps(fields, allow_nan=False)
    if verdict is None:
        return None
    fields = {"event": verdict.label, "kind": "verdict", "id": verdict.id, "when": moment(verdict.began_ns)}
    return json.dumps({**fields, "confidence": confidence(verdict)}, allow_nan=False)


def recalled_ns(payload: bytes | str) -> int | None:
    """The `said_ns` that an earlier hub left at the broker; None if the payload is not ours."""
    try:
        fields = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    said_ns = fields.get("said_ns") if isinstance(fields, dict) else None
    return said_ns if isinstance(said_ns, int) else None


def _facts(verdict: VerdictMessage) -> dict[str, Any]:
    ended = verdict.ended_ns
    return {
        "id": verdict.id,
        "began": moment(verdict.began_ns),
        "decided": moment(verdict.decided_ns),
        "ended": None if ended is None else moment(ended),
        "duration": None if ended is None else rounded((ended - verdict.began_ns) / SECOND_NS, 1),
        "confidence": confidence(verdict),
        "entropy": rounded(verdict.certainty_bits, 2),
        "unlearned": unlearned(verdict),
        **_score(verdict),
        **({} if verdict.person is None else {"person": verdict.person}),
    }


def _score(verdict: VerdictMessage) -> dict[str, Any]:
    """The score of an ended movement, and how it comes about, or why there is none; else null."""
    scores = None if verdict.scores is None else {name: round(score, 1) for name, score in verdict.scores.items()}
    fields = {"scores": scores, "remarks": verdict.remarks, "unscored": verdict.unscored}
    return {"score": rounded(verdict.score, 1), **fields}


def _contributions(verdict: VerdictMessage) -> dict[str, Any] | None:
    contributions = verdict.contributions
    return contributions and {
        name: {"nats": rounded(each.nats, 2), "stands": each.stands} for name, each in contributions.items()
    }


def _event(topic: str, fields: dict[str, Any]) -> Publication:
    return Publication(topic, json.dumps(fields, allow_nan=False), retain=False)
