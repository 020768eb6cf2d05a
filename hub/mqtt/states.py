"""The retained messages of a scene: what is at the broker now. Pure.

Numbers are rounded to what a person can tell apart, so that a sensor changes only when something has changed.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from common.facets import FACETS
from common.fall_messages import FallMessage
from common.messages import JudgementMessage, Vote
from common.vocabulary import ABSTAIN
from hub.anticipation import probability
from hub.mqtt.entities import FACING, Topics
from hub.scene_state import ObserverState, SceneState, is_waiting
from hub.wording import facing, leanings, moment, rounded

REST_STATE: Final = "rest"
UNDECIDED_STATE: Final = "undecided"
ONLINE: Final = "online"
OFFLINE: Final = "offline"
FAST_S = 0.25
SLOW_S = 1.0
STATE_REPEAT_S = 10.0
"""How often a movement's binary sensor is repeated; it expires at Home Assistant otherwise."""
PRESENT_S = 1.4
"""An observer without a frame and without a status for this long is absent; a status comes every second."""
JUDGED_S = 1.5
"""A scene without a judgement for this long, plus the time of one step, is no longer judged."""


@dataclass(frozen=True, slots=True)
class RetainedState:
    """The wanted payload of a topic: published at once when `urgent` changes, otherwise every `pace_s` at most.

    repeat_s: it is published again after this long without a change; 0: it is not.
    """

    payload: str
    urgent: object = None
    pace_s: float = 0.0
    repeat_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SceneSnapshot:
    """A scene now: its state, the observers with a liveliness token, and the age of each observer's status in s."""

    state: SceneState
    tokens: frozenset[str] = frozenset()
    status_age_s: Mapping[str, float] | None = None
    step_s: float = 0.1

    @property
    def judged(self) -> bool:
        """Whether a fusion service publishes judgements."""
        return self.state.silence_s <= JUDGED_S + self.step_s

    def is_present(self, observer: ObserverState) -> bool:
        """Whether an observer's frames arrive, or its process runs and publishes its status."""
        if observer.status is not None and observer.status.state in ("failed", "stopping"):
            return False
        if observer.is_heard and observer.age_s is not None and observer.age_s <= PRESENT_S:
            return True
        if observer.name not in self.tokens:
            return False
        # A foreign observer may never publish a status: then its vote has to do.
        age_s = (self.status_age_s or {}).get(observer.name)
        return observer.state != "silent" if age_s is None else age_s <= PRESENT_S


def retained_states(
    topics: Topics, snapshot: SceneSnapshot, observers: Sequence[str], movements: Sequence[str], facets: frozenset[str]
) -> dict[str, RetainedState]:
    """All states of the scene by topic, availability first. facets: those that have been announced."""
    states = dict(_scene(topics, snapshot, movements))
    for observer in snapshot.state.observers:
        if observer.name in observers:
            states |= dict(_observer(topics, snapshot, observer))
    judgement = snapshot.state.judgement
    states |= {
        topics.of("person", each.person): RetainedState(_json(_now(each) | _word(each)), _now(each)["movement"], FAST_S)
        for each in snapshot.state.people
        if each.person is not None
    }
    if facets and judgement is not None:
        states[topics.of("facets")] = RetainedState(_json(_facets_state(judgement, facets)), None, FAST_S)
    return states


def _scene(topics: Topics, snapshot: SceneSnapshot, movements: Sequence[str]) -> Iterator[tuple[str, RetainedState]]:
    yield topics.of("availability"), RetainedState(ONLINE if snapshot.judged else OFFLINE)
    if snapshot.state.fall is not None:
        yield from _fall(topics, snapshot.state.fall)
    judgement = snapshot.state.judgement
    decided = judgement.movement.label if judgement and judgement.movement else None
    for label in movements:
        on = snapshot.judged and label == decided
        yield topics.movement(label), RetainedState("ON" if on else "OFF", repeat_s=STATE_REPEAT_S)
    if judgement is not None:
        now, word = _now(judgement), _word(judgement)
        urgent = now["movement"], word["stage"]
        yield topics.of("state"), RetainedState(_json(now | word), urgent, FAST_S)
        yield topics.of("votes"), RetainedState(_json(votes(judgement) | word), urgent, SLOW_S)


def _fall(topics: Topics, fall: FallMessage) -> Iterator[tuple[str, RetainedState]]:
    """Before somebody has been seen up there is no state, and one that an earlier hub has left stays."""
    if fall.stage != "unknown":
        yield topics.of("fallen"), RetainedState("ON" if fall.stage == "fallen" else "OFF")
    fields = {
        "stage": fall.stage,
        "id": fall.id,
        "since": moment(fall.since_ns),
        "confidence": None if fall.lying is None else round(100 * fall.lying),
        "agreement": f"{fall.agreement.k} of {fall.agreement.n}",
        **({} if fall.person is None else {"person": fall.person}),
    }
    yield topics.of("fall"), RetainedState(_json(fields), fall.stage, SLOW_S)


def _now(judgement: JudgementMessage) -> dict[str, Any]:
    if is_waiting(judgement):
        return dict.fromkeys(("movement", "label", "confidence", "entropy", "unlearned"))
    movement = judgement.movement
    # A verdict that is revised to an abstention names no movement.
    label = None if movement is None or movement.label == ABSTAIN else movement.label
    return {
        "movement": REST_STATE if movement is None else label or UNDECIDED_STATE,
        "label": judgement.label,
        "confidence": confidence(judgement),
        "entropy": rounded(judgement.certainty_bits, 2),
        "unlearned": unlearned(judgement),
    }


def _word(judgement: JudgementMessage) -> dict[str, Any]:
    """The last word on the movement in progress, or why there is none yet; all null at rest."""
    movement = None if is_waiting(judgement) else judgement.movement
    label, revises = (None, None) if movement is None else (movement.label, movement.revises)
    stage = None if label is None else "decided" if revises is None else "revised"
    return {"stage": stage, "revises": revises, "why": None if movement is None else judgement.why}


def _observer(topics: Topics, snapshot: SceneSnapshot, observer: ObserverState) -> Iterator[tuple[str, RetainedState]]:
    present, status = snapshot.is_present(observer), observer.status
    yield topics.observer(observer.name, "availability"), RetainedState(ONLINE if present else OFFLINE)
    yield topics.observer(observer.name, "connected"), RetainedState("ON" if present else "OFF")
    # A vote is valid only while fusion publishes judgements.
    vote = observer if snapshot.judged else None
    health = {
        "state": status.state if status else None,
        "reason": status.reason if status else "",
        "vote": vote.state if vote else None,
        "opinion": vote.label if vote else None,
    }
    yield topics.observer(observer.name, "health"), RetainedState(_json(health), health["state"], FAST_S)
    numbers = {
        "entropy": rounded(vote.entropy, 2) if vote else None,
        "weight": rounded(100 * vote.weight, 0) if vote else None,
        "reliability": rounded(vote.reliability, 2) if vote else None,
        "age": rounded(vote.age_s, 1) if vote else None,
        "rate": rounded(status.rate_hz, 0) if status else None,
        "skew": rounded(vote.skew_s, 2) if vote else None,
        "rejected": observer.rejected,
    }
    yield topics.observer(observer.name, "state"), RetainedState(_json(numbers), None, SLOW_S)


def confidence(judgement: JudgementMessage) -> int:
    """The probability of the most probable movement among all answers, in percent."""
    return round(100 * probability(judgement))


def unlearned(judgement: JudgementMessage) -> int | None:
    """The probability that it is none of the movements, in percent; None where it is unknown."""
    return None if judgement.unlearned is None else round(100 * judgement.unlearned)


def votes(judgement: JudgementMessage) -> dict[str, Any]:
    """The rule, the agreement, and each observer's label, weight in percent, entropy in bits, and state."""
    agreement = f"{judgement.agreement.k} of {judgement.agreement.n}"
    each = {name: _vote(vote) for name, vote in judgement.votes.items()}
    return {"rule": judgement.rule, "agreement": agreement, "votes": each}


def _vote(vote: Vote) -> dict[str, Any]:
    weight = rounded(100 * vote.weight, 0)
    return {"label": vote.label, "weight": weight, "entropy": rounded(vote.entropy, 1), "state": vote.state}


def reported_facets(judgement: JudgementMessage | None) -> frozenset[str]:
    """The facets in the judgement, FACING among them."""
    if judgement is None:
        return frozenset()
    direction = [] if facing(judgement.facing_deg) is None else [FACING]
    return frozenset([*(leaning.facet for leaning in leanings(judgement.facets)), *direction])


def facet_poles(judgement: JudgementMessage) -> dict[str, Any] | None:
    """The pole of each facet and its probability in percent; None when there are no facets."""
    poles = {
        leaning.facet: {"pole": leaning.value, "probability": round(100 * leaning.p)}
        for leaning in leanings(judgement.facets)
    }
    return poles or None


def facing_degrees(judgement: JudgementMessage) -> float | None:
    """Which way the person faces, in whole degrees to the left, 0 to 359; None if unknown."""
    whole = rounded(facing(judgement.facing_deg), 0)
    return None if whole is None else whole % 360


def _facets_state(judgement: JudgementMessage, announced: frozenset[str]) -> dict[str, Any]:
    unknown = {"pole": None, "probability": None}
    poles = facet_poles(judgement) or {}
    state = {facet: poles.get(facet, unknown) for facet in FACETS if facet in announced}
    return state | ({FACING: facing_degrees(judgement)} if FACING in announced else {})


def _json(fields: Mapping[str, Any]) -> str:
    return json.dumps(fields, allow_nan=False)
