"""Builds verdicts: what each observer contributed, and why a movement has no verdict yet, in a line for people. Pure.

The design: fusion.md, "Trust". A verdict, one per movement, is validated.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from common.config_sections import FusionConfig
from common.message_types import ROUND_OFF
from common.messages import WHY_LIMIT, Contribution, JudgementMessage, OngoingMovement, VerdictMessage
from common.posterior import Unscored
from common.probability import SMALLEST, Floats
from common.score import REMARK_LIMIT
from fusion.engine.aged_posterior import answers_of
from fusion.engine.pooling import PoolingCase, pool_posteriors
from fusion.engine.roster import POOLED_STATES, AgedPosterior
from fusion.engine.segments import (
    NOTICED_NS,
    MovementDecision,
    MovementProgress,
    PooledState,
    RepetitionCount,
    repetition_fields,
)
from fusion.score_pool import JudgedScore, pooled_remarks, pooled_score

NO_OBSERVERS = "waiting for observers"
CONTESTED_REST = "two observers contradict each other on whether the person rests"
DECIDED = ("label", "began_ns", "decided_ns", "ended_ns", "stage", "revises")
"""What a verdict has from its decision."""


@dataclass(slots=True)
class VerdictBasis:
    """A judgement that a verdict may be based on, its posteriors, and what a label lacked then.

    Without posteriors if it is a verdict, or came from another service.
    """

    judgement: JudgementMessage
    posteriors: Sequence[AgedPosterior] = ()
    why: str | None = None


NO_BASES: Mapping[int, VerdictBasis] = {}
"""By the time of the step, Unix epoch in ns."""


@dataclass(slots=True)
class NearestMiss:
    """The step at which the movement begun at `began_ns` came nearest to a verdict: its label's `p`, what it lacked."""

    began_ns: int = 0
    p: float = -1.0
    why: str | None = None


def build_verdict(basis: JudgementMessage, decision: MovementDecision, fields: Mapping[str, Any]) -> VerdictMessage:
    """The verdict for `decision`, with `fields`; what else it has, as posterior and votes, is that of `basis`."""
    decided = {name: getattr(decision, name) for name in DECIDED} | repetition_fields(decision.repetitions)
    kept = {name: getattr(basis, name) for name in JudgementMessage.model_fields}
    return VerdictMessage.model_validate({**kept, "movement": None, **decided, **fields})


def progress_of(movement: OngoingMovement | VerdictMessage, message: JudgementMessage) -> MovementProgress:
    """The movement in progress that a message carries, or a verdict is."""
    if movement.label is None or movement.decided_ns is None:
        return MovementProgress(movement.began_ns)
    done = message.repetitions
    count = None if done is None else RepetitionCount(done, message.partial_repetitions or 0)
    decision = MovementDecision(
        movement.label, movement.began_ns, movement.decided_ns, revises=movement.revises, repetitions=count
    )
    return MovementProgress(movement.began_ns, decision)


def contributions(case: PoolingCase, label: int | None) -> dict[str, Contribution]:
    """What each observer whose posterior is pooled contributes to the answer `label`.

    label: index in the vocabulary; None for the likeliest answer, which may be "something else".
    """
    pooled = pool_posteriors(case).answers
    answer = int(pooled.argmax()) if label is None else label
    log_odds, result = _log_odds(pooled, answer), {}
    for own in case.posteriors:
        if own.state not in POOLED_STATES:
            continue
        others = [each for each in case.posteriors if each is not own]
        answers = pool_posteriors(replace(case, posteriors=others)).answers if others else case.prior
        if len(answers) < len(pooled):
            # Only this observer publishes `unlearned`: without it, something else is as likely as any movement.
            answers = answers_of(answers, None)
        without = _log_odds(answers, answer)
        result[own.observer] = Contribution(nats=log_odds - without, stands=without > 0)
    return result


def _log_odds(answers: Floats, answer: int) -> float:
    """Nats, of an answer against the likeliest other one."""
    others = answers.tolist()
    own = others.pop(answer)
    return math.log(max(own, SMALLEST)) - math.log(max(*others, SMALLEST))


def explain_undecided(
    state: PooledState, observers: int, held_s: float | None, moved_s: float, config: FusionConfig
) -> str | None:
    """What the likeliest label lacks for a verdict; None if it lacks nothing. At most WHY_LIMIT characters.

    observers: how many have a vote that counts. held_s: seconds for which the label has met threshold and quorum
    without a break; None while it does not. moved_s: seconds since the movement began.

    Examples: "wave 59 % of the 60 % needed; 13 % something else", "2 of 3 observers needed vote for wave",
    "wave for 0.1 of 0.2 s".
    """
    if observers == 0:
        return NO_OBSERVERS
    lacks, is_likely = [], state.p >= config.threshold
    if not is_likely:
        lacks.append(f"{state.label} {_percent(state.p)} of the {100 * config.threshold:g} % needed")
    if state.agreeing < config.quorum:
        lacks.append(_votes(state.label if is_likely else "it", state.agreeing, observers, config.quorum))
    if not lacks:
        lacks.append(_duration(state.label, held_s or 0.0, moved_s, config.hold_s + state.longer_s))
    elif not is_likely and state.unlearned >= 0.01:
        lacks.insert(0 if state.unlearned > state.p else len(lacks), f"{_percent(state.unlearned)} something else")
    return "; ".join(lacks)[:WHY_LIMIT] or None


def _votes(label: str, agreeing: int, observers: int, quorum: int) -> str:
    if observers < quorum:
        return f"{observers} of {quorum} observers needed {'is' if observers == 1 else 'are'} counted"
    if agreeing == 0:
        return f"no observer votes for {label}, {quorum} needed"
    vote = "votes" if agreeing == 1 else "vote"
    return f"{agreeing} of {quorum} observers needed {vote} for {label}"


def _duration(label: str, held_s: float, moved_s: float, hold_s: float) -> str:
    """Whether label or movement has not lasted for long enough; "" if both have."""
    if held_s < hold_s:
        return f"{label} for {_seconds(held_s)} of {hold_s:g} s"
    return f"moving for {_seconds(moved_s)} of {hold_s:g} s" if moved_s < hold_s else ""


def _percent(p: float) -> str:
    """Rounded down: what is below a threshold must not look as if it had reached it."""
    return f"{math.floor(100 * p + ROUND_OFF)} %"


def _seconds(seconds: float) -> str:
    return f"{math.floor(10 * seconds + ROUND_OFF) / 10:.1f}"


def with_score(verdict: VerdictMessage, posteriors: Iterable[AgedPosterior]) -> VerdictMessage:
    """The verdict with the pooled score of its movement, if it has ended and an observer has scored it as its label, or
    with the most common reason why it is not scored.

    A score of what ended before this movement began, or well before it ended, is of another one (docs/design/score.md).
    """
    if verdict.ended_ns is None:
        return verdict
    earliest_ns, judged, reasons = max(verdict.began_ns, verdict.ended_ns - round(2 * NOTICED_NS)), {}, Counter[str]()
    for each in posteriors:
        if each.score is None or each.score.label != verdict.label or each.score.ended_ns <= earliest_ns:
            continue
        if isinstance(each.score, Unscored):
            reasons[each.score.reason] += 1
        else:
            judged[each.observer] = each.score, each.reliability
    if not judged:
        return verdict.model_copy(update={"unscored": reasons.most_common(1)[0][0]}) if reasons else verdict
    score = pooled_score({n: JudgedScore(own.score, own.certainty, trust) for n, (own, trust) in judged.items()})
    remarks = pooled_remarks([own.remarks for own, _ in judged.values()])
    fields = {
        # In hundredths, so that a mean of scores of 10 stays 10.
        "score": None if score is None else round(score, 2),
        "scores": {name: round(own.score, 2) for name, (own, _) in judged.items()},
        "remarks": [remark.words[:REMARK_LIMIT] for remark in remarks] or None,
    }
    return verdict.model_copy(update=fields)
