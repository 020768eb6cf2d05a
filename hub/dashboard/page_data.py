"""What the page gets as plain JSON: a whole snapshot, the scene's state, a verdict with its reasons. Pure.

All values are text, finite numbers or null, and text is bounded, whatever a peer has sent. The page decides how to draw
them (static/page.js).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from common import MS_NS
from common.messages import JudgementMessage, OngoingMovement, StatusMessage, VerdictMessage, Vote
from hub.dashboard.placement import FloorPosition
from hub.dashboard.verdict_reasons import REASON_NAMES_LIMIT, reasons
from hub.same_id import in_words
from hub.scene_state import ObserverState, RankedLabel, is_abstention, is_heard
from hub.wording import facing, facing_words, leaning_lines, leanings, person_line, rounded

if TYPE_CHECKING:
    from hub.dashboard.history import SceneHistory

FUSED_SHOWN = 5
LABELS_SHOWN = 3
CROWD = 12
"""More observers than this are a list of one line each, with only their most probable label."""
PAGE_TEXT_LIMIT = 80
SENTENCE_LIMIT = 400
COUNT_LIMIT = 999_999

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class PageSetup:
    """The data that do not change while the page is open. span_s: the capture's length; None: the scene is live.

    pictures: the observers whose live pictures are switched on, and how many a second. teaches: there is a Teach page.
    file: the scene file, as it is written in a command; "" of a capture. sure: the probability that a verdict needs.
    phones: the observers that see through a phone. history: there is a day page. names: of people, by person, now.
    """

    scene: str
    positions: Mapping[str, FloorPosition]
    quorum: int | None = None
    span_s: float | None = None
    began_ns: int = 0
    pictures: Mapping[str, float] = field(default_factory=dict)
    teaches: bool = False
    file: str = ""
    sure: float = 0.6
    phones: tuple[str, ...] = ()
    history: bool = False
    names: Callable[[], Mapping[str, str]] = dict


def snapshot_data(setup: PageSetup, history: "SceneHistory") -> Json:
    """Everything, for a browser that knows nothing yet or that fell behind."""
    return {
        "scene": setup.scene,
        "quorum": setup.quorum,
        "span": setup.span_s,
        "began": setup.began_ns // MS_NS,
        "pictures": dict(setup.pictures),
        "teaches": setup.teaches,
        "file": setup.file,
        "sure": setup.sure,
        "phones": list(setup.phones),
        "history": setup.history,
        "positions": {
            name: {"azimuth": each.azimuth_deg, "known": each.known, "view": _text(each.view)}
            for name, each in setup.positions.items()
        },
        "state": state_data(history, setup.names()),
        "verdicts": [verdict_data(each, history, setup.quorum) for each in history.verdicts],
        "minute": [
            [each.at_ns // MS_NS, _text(each.label), round(each.p, 3), round(each.entropy, 3)]
            for each in history.minute
        ],
    }


def state_data(history: "SceneHistory", names: Mapping[str, str] = MappingProxyType({})) -> Json:
    """The scene now; what a judgement says is null before the first one. names: of people, by person."""
    state = history.state
    judgement, observers = state.judgement, state.observers
    shown = LABELS_SHOWN if len(observers) <= CROWD else 1
    return {
        "now": history.now_ns // MS_NS,
        "judged": judgement is not None,
        "waiting": state.waiting,
        "silent": state.silent,
        "silence": rounded(state.silence_s, 1),
        "fusion": None if judgement is None else _text(judgement.fusion),
        "rule": None if judgement is None else _text(judgement.rule),
        "label": None if judgement is None or state.waiting else _text(judgement.label),
        "entropy": None if judgement is None or state.waiting else rounded(judgement.certainty_bits, 3),
        "labels": len(state.labels) or (len(judgement.p) if judgement else 0),
        "agreement": None if judgement is None else [judgement.agreement.k, judgement.agreement.n],
        "moving": judgement is not None and judgement.movement is not None,
        "why": None if judgement is None or not judgement.why else _text(judgement.why, SENTENCE_LIMIT),
        "count": None if judgement is None else _count(judgement, judgement.movement),
        "fused": _ranked(state.fused[:FUSED_SHOWN]),
        **_manner(None if state.waiting else judgement),
        "observers": [_observer(each, history, shown) for each in observers],
        **({"people": [_person(each) for each in state.people]} if state.people else {}),
        **({"person": _text(judgement.person)} if judgement is not None and judgement.person else {}),
        **({"names": dict(names)} if names else {}),
        "standby": [_text(name) for name in state.standing_by],
        "rejected": state.rejected,
        "same_ids": in_words(state.same_ids),
        "fall": None
        if (fall := state.fall) is None
        else {
            "stage": fall.stage,
            "since": fall.since_ns // MS_NS,
            "agreement": [fall.agreement.k, fall.agreement.n],
            **({} if fall.person is None else {"person": _text(fall.person)}),
        },
    }


def verdict_data(verdict: VerdictMessage, history: "SceneHistory", quorum: int | None) -> Json:
    """One line of the log, with the details that open below it."""
    # Without the names of the movements, numbers would say less than the sentences do.
    state = history.state
    is_named = state.vocabulary is not None and state.vocabulary.hash == verdict.vocabulary.hash
    fused = state.ranked(verdict.p, None, verdict.unlearned) if is_named and state.labels else ()
    leaning = (f"{line}." for line in islice(leaning_lines(verdict, state), REASON_NAMES_LIMIT))
    return {
        "id": verdict.id[:PAGE_TEXT_LIMIT],
        **({"person": verdict.person} if verdict.person else {}),
        "label": _text(verdict.label),
        "stage": verdict.stage,
        "revises": None if verdict.revises is None else _text(verdict.revises),
        "abstain": is_abstention(verdict),
        "began": verdict.began_ns // MS_NS,
        "decided": verdict.decided_ns // MS_NS,
        "count": _count(verdict, verdict),
        "score": rounded(verdict.score, 1),
        "ended": None if verdict.ended_ns is None else verdict.ended_ns // MS_NS,
        "entropy": rounded(verdict.certainty_bits, 3),
        "agreement": [verdict.agreement.k, verdict.agreement.n],
        "rule": _text(verdict.rule),
        "fusion": _text(verdict.fusion),
        "fused": _ranked(fused[:LABELS_SHOWN]),
        **_manner(verdict),
        "votes": [_vote(name, vote, verdict) for name, vote in verdict.votes.items()],
        "why": [_text(sentence, SENTENCE_LIMIT) for sentence in (*reasons(verdict, quorum), *leaning)],
    }


def _person(judgement: JudgementMessage) -> Json:
    """What one of several people does now, and where they are on the floor in metres."""
    return {
        "person": judgement.person,
        "words": _text(person_line(judgement)),
        "place": None if judgement.place is None else [rounded(each, 2) for each in judgement.place],
    }


def _count(judgement: JudgementMessage, movement: OngoingMovement | VerdictMessage | None) -> Json | None:
    if judgement.repetitions is None or movement is None or movement.label is None:
        return None
    counted = {"done": min(judgement.repetitions, COUNT_LIMIT), "partial": judgement.partial_repetitions or 0}
    return {"id": movement.id[:PAGE_TEXT_LIMIT], "label": _text(movement.label), **counted}


def _manner(judgement: JudgementMessage | None) -> Json:
    """Each facet with its poles, its lean from -1 to 1, its likeliest value with its probability; and the facing."""
    direction = None if judgement is None else facing(judgement.facing_deg)
    facets = () if judgement is None else leanings(judgement.facets)
    return {
        "facets": [[each.facet, *each.poles, round(each.lean, 3), each.value, round(each.p, 3)] for each in facets],
        "facing": None if direction is None else [round(direction), facing_words(direction)],
    }


def _observer(observer: ObserverState, history: "SceneHistory", labels: int) -> Json:
    return {
        "name": _text(observer.name),
        "label": None if observer.label is None else _text(observer.label),
        "ranked": _ranked(observer.ranked[:labels]),
        "entropy": rounded(observer.entropy, 3),
        "weight": round(observer.weight, 3),
        "age": rounded(observer.age_s, 3),
        "state": observer.state,
        "heard": observer.is_heard,
        "sees_nobody": observer.sees_nobody,
        "agrees": observer.agrees,
        "gone": observer.name in history.gone,
        "present": observer.name in history.present,
        "health": None if observer.status is None else _health(observer.status),
        "skew": rounded(observer.skew_s, 2),
        "rejected": observer.rejected,
        "same_id": observer.has_same_id,
        "contradicted": rounded(observer.label_reliability, 2),
        "rest_contradicted": rounded(observer.rest_reliability, 2),
    }


def _health(status: StatusMessage) -> Json:
    return {"state": status.state, "reason": _text(status.reason, SENTENCE_LIMIT), "rate": rounded(status.rate_hz, 0)}


def _vote(name: str, vote: Vote, verdict: VerdictMessage) -> Json:
    contribution = (verdict.contributions or {}).get(name)
    return {
        "name": _text(name),
        "label": None if vote.label is None else _text(vote.label),
        "entropy": rounded(vote.entropy, 3),
        "weight": round(vote.weight, 3),
        "age": rounded(vote.age_s, 3),
        "state": vote.state,
        "stance": _text(_stance(verdict, vote)),
        "gave": None if contribution is None else rounded(contribution.nats, 2),
        "stands": None if contribution is None else contribution.stands,
    }


def _stance(verdict: VerdictMessage, vote: Vote) -> str:
    """What a vote meant for the verdict: `agreed`, `held ok`, `undecided`, `late`, `silent`, ..."""
    if not is_heard(vote):
        return vote.state
    if vote.label is None:
        return "undecided"
    return "agreed" if vote.label == verdict.label else f"held {vote.label}"


def _ranked(ranked: Iterable[RankedLabel]) -> list[list[object]]:
    return [[_text(each.label), round(each.p, 3)] for each in ranked]


def _text(text: str, limit: int = PAGE_TEXT_LIMIT) -> str:
    return text if len(text) <= limit else text[: limit - 1] + "…"
