"""What the page is told, as plain JSON: a whole snapshot, the scene's state, a verdict with its reasons. Pure.

Everything is text, numbers that are numbers, or null: a stranger's NaN or page-long label ends here. What is drawn how
is the page's business (static/page.js).
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from common.messages import JudgementMessage, StatusMessage, VerdictMessage, Vote
from hub.dashboard.chronicle import Chronicle, Point
from hub.dashboard.explanation import stance, why
from hub.dashboard.placement import Standing
from hub.leanings import facing, facing_words, leanings
from hub.scene_state import Belief, Judge, is_abstention

FUSED_SHOWN = 5
BELIEFS_SHOWN = 3
CROWD = 12
"""More judges than this are listed, one line each, with what they hold most probable alone."""
TEXT_LIMIT = 80
SENTENCE_LIMIT = 400

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Hall:
    """What does not change while the page is open. span_s: the length of the capture it shows; None: it is live."""

    scene: str
    standings: Mapping[str, Standing]
    quorum: int | None = None
    span_s: float | None = None
    began_ns: int = 0


def snapshot(hall: Hall, chronicle: Chronicle) -> Json:
    """All a browser needs that knows nothing yet, or that fell behind."""
    return {
        "scene": hall.scene,
        "quorum": hall.quorum,
        "span": hall.span_s,
        "began": hall.began_ns // 1_000_000,
        "standings": {
            name: {"azimuth": each.azimuth_deg, "known": each.known, "view": _text(each.view)}
            for name, each in hall.standings.items()
        },
        "state": state(chronicle),
        "verdicts": [verdict(each, chronicle, hall.quorum) for each in chronicle.verdicts],
        "minute": [_point(each) for each in chronicle.minute],
    }


def state(chronicle: Chronicle) -> Json:
    """How the scene is now."""
    known = chronicle.state
    judgement, judges = known.judgement, known.judges
    shown = BELIEFS_SHOWN if len(judges) <= CROWD else 1
    return {
        "now": chronicle.now_ns // 1_000_000,
        "silent": known.silent,
        "silence": _number(known.silence_s, 1),
        "fusion": None if judgement is None else _text(judgement.fusion),
        "rule": None if judgement is None else _text(judgement.rule),
        "label": None if judgement is None else _text(judgement.label),
        "entropy": None if judgement is None else _number(judgement.certainty_bits),
        "labels": len(known.labels) or (len(judgement.p) if judgement else 0),
        "agreement": None if judgement is None else [judgement.agreement.k, judgement.agreement.n],
        "moving": judgement is not None and judgement.movement is not None,
        "fused": _beliefs(known.fused[:FUSED_SHOWN]),
        **_manner(judgement),
        "judges": [_judge(each, each.name in chronicle.gone, shown) for each in judges],
        "standby": [_text(name) for name in known.standing_by],
        "rejected": known.rejected,
    }


def verdict(said: VerdictMessage, chronicle: Chronicle, quorum: int | None) -> Json:
    """One line of the log, and what opens under it."""
    # Without the names nothing is told: numbered movements would say less than the sentences.
    fused = chronicle.state.beliefs(said.p, None, said.unlearned) if chronicle.state.labels else ()
    return {
        "id": said.id[:TEXT_LIMIT],
        "label": _text(said.label),
        "abstain": is_abstention(said),
        "began": said.began_ns // 1_000_000,
        "decided": said.decided_ns // 1_000_000,
        "ended": None if said.ended_ns is None else said.ended_ns // 1_000_000,
        "entropy": _number(said.certainty_bits),
        "agreement": [said.agreement.k, said.agreement.n],
        "rule": _text(said.rule),
        "fusion": _text(said.fusion),
        "fused": _beliefs(fused[:BELIEFS_SHOWN]),
        **_manner(said),
        "votes": [_vote(name, vote, said) for name, vote in said.votes.items()],
        "why": [_text(sentence, SENTENCE_LIMIT) for sentence in why(said, quorum)],
    }


def _manner(said: JudgementMessage | None) -> Json:
    """How it is done: each facet with its poles, its lean from -1 to 1, its likeliest value, and the facing."""
    turned = None if said is None else facing(said.facing_deg)
    facets = () if said is None else leanings(said.facets)
    return {
        "facets": [[each.facet, *each.poles, round(each.lean, 3), each.value, _share(each.p)] for each in facets],
        "facing": None if turned is None else [round(turned), facing_words(turned)],
    }


def _judge(judge: Judge, gone: bool, beliefs: int) -> Json:
    return {
        "name": _text(judge.name),
        "label": None if judge.label is None else _text(judge.label),
        "beliefs": _beliefs(judge.beliefs[:beliefs]),
        "entropy": _number(judge.entropy),
        "weight": _share(judge.weight),
        "age": _number(judge.age_s),
        "state": judge.state,
        "agrees": judge.agrees,
        "gone": gone,
        "health": None if judge.status is None else _health(judge.status),
        "skew": _number(judge.skew_s, 2),
        "rejected": judge.rejected,
    }


def _health(status: StatusMessage) -> Json:
    return {"state": status.state, "reason": _text(status.reason), "rate": _number(status.rate_hz, 0)}


def _vote(name: str, vote: Vote, said: VerdictMessage) -> Json:
    gave = (said.contributions or {}).get(name)
    return {
        "name": _text(name),
        "label": None if vote.label is None else _text(vote.label),
        "entropy": _number(vote.entropy),
        "weight": _share(vote.weight),
        "age": _number(vote.age_s),
        "state": vote.state,
        "stance": _text(stance(said, vote)),
        "gave": None if gave is None else _number(gave.nats, 2),
        "stands": None if gave is None else gave.stands,
    }


def _point(each: Point) -> list[object]:
    return [each.at_ns // 1_000_000, _text(each.label), round(each.p, 3), round(each.entropy, 3)]


def _beliefs(beliefs: Iterable[Belief]) -> list[list[object]]:
    return [[_text(each.label), _share(each.p)] for each in beliefs]


def _text(words: str, limit: int = TEXT_LIMIT) -> str:
    return words if len(words) <= limit else words[: limit - 1] + "…"


def _number(value: float | None, digits: int = 3) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)


def _share(value: float) -> float:
    return round(min(1.0, max(0.0, value)), 3) if math.isfinite(value) else 0.0
