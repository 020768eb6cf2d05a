"""Why a verdict is what it is: sentences for people, who know observers as judges and fusion as the referee. Pure."""

from collections.abc import Iterator, Mapping

from common.messages import VerdictMessage, Vote
from common.text import plural
from hub.scene_state import is_abstention, is_heard
from hub.wording import age

REASON_NAMES_LIMIT = 6
"""How many observers a sentence names; it counts the others, since a scene may have hundreds."""


def reasons(verdict: VerdictMessage, quorum: int | None) -> Iterator[str]:
    """Why the verdict is what it is, as sentences. quorum: how many judges must agree; None where it is unknown.

    Fusion says what would have been likeliest without a judge (`contributions`). Whether there would have been a
    verdict at all is not computed here: `labanmesh replay --without` judges again.
    """
    votes = {name: vote for name, vote in verdict.votes.items() if is_heard(vote)}
    yield from _abstention(verdict) if is_abstention(verdict) else _majority(verdict, votes, quorum)
    if verdict.revises is not None:
        yield f"It is a correction: before, the referee said {verdict.revises}."
    others = [f"{name} held {vote.label}" for name, vote in votes.items() if vote.label not in (None, verdict.label)]
    undecided = [name for name, vote in votes.items() if vote.label is None and not vote.sees_nobody]
    if others:
        yield f"{_listed(others)}."
    if undecided and verdict.unlearned is None:
        yield f"{_listed(undecided)} believed no more of one movement than of another."
    elif undecided:
        yield f"{_listed(undecided)} held no movement: none more than another, or something else."
    yield from _score(verdict)
    yield from _weights(verdict, votes)
    yield from _contributions(verdict)
    yield from _faults(verdict)


def _majority(verdict: VerdictMessage, votes: Mapping[str, Vote], quorum: int | None) -> Iterator[str]:
    k, n = verdict.agreement.k, verdict.agreement.n
    agreeing = [name for name, vote in votes.items() if vote.label == verdict.label]
    count = f"{k} of {plural(n, 'judge')} held {verdict.label}"
    if not k:
        yield f"{count} alone; together they did."
        return
    yield f"{count}: {_listed(agreeing)}." if len(agreeing) == k else f"{count}."
    if quorum is None:
        return
    if k <= quorum:
        needed = "Each of them was needed" if k > 1 else "That judge was needed"
        yield f"{needed}: the scene asks for {quorum} to agree; with one less there would have been no verdict."
    else:
        yield f"The scene asks for {quorum}: no single judge could have prevented it by holding something else."


def _score(verdict: VerdictMessage) -> Iterator[str]:
    if verdict.unscored is not None:
        yield f"Not scored: {verdict.unscored}."
    if verdict.score is None:
        return
    judges = verdict.scores or {}
    points = [f"{name} {score:.1f}" for name, score in judges.items()]
    more = len(points) - REASON_NAMES_LIMIT
    rest = f" and {more} more" if more > 0 else ""
    by = f": {', '.join(points[:REASON_NAMES_LIMIT])}{rest}" if points else ""
    yield f"Scored {verdict.score:.1f} of 10 against the reference takes{by}."
    yield from (f"{remark[:1].upper()}{remark[1:]}." for remark in verdict.remarks or ())


def _weights(verdict: VerdictMessage, votes: Mapping[str, Vote]) -> Iterator[str]:
    names = sorted(votes, key=lambda name: -votes[name].weight)
    if len(names) > 1 and votes[names[0]].weight > votes[names[1]].weight:
        weight = f"{votes[names[0]].weight:.0%}"
        yield f"{names[0]} weighed most, {weight}, by the rule {verdict.rule}."


def _abstention(verdict: VerdictMessage) -> Iterator[str]:
    if (verdict.unlearned or 0.0) > 0.5:
        yield f"The judges saw a movement that is none of those they know ({verdict.unlearned:.0%})."
    else:
        yield "The judges saw a movement and did not agree which, so the referee abstained."
    if verdict.why:
        yield f"What a verdict lacked: {verdict.why}."


def _contributions(verdict: VerdictMessage) -> Iterator[str]:
    contributions = verdict.contributions or {}
    if len(contributions) < 2:
        return
    needed = [name for name, each in contributions.items() if not each.stands]
    if needed:
        yield f"Without {_listed(needed, 'or')} another answer would have been the likeliest."
    else:
        yield "Without any one of them the likeliest answer would have been the same."


def _faults(verdict: VerdictMessage) -> Iterator[str]:
    sentences = {
        "nobody": "saw nobody: its vote had faded",
        "stale": "was stale ({age} old): its vote had faded",
        "late": "was late ({age} behind) and did not count",
        "silent": "was silent and did not count",
        "foreign": "uses another vocabulary and did not count",
        "invalid": "sent an unusable message and did not count",
    }
    faulty = [(name, vote) for name, vote in verdict.votes.items() if vote.state in sentences]
    if len(faulty) > REASON_NAMES_LIMIT:
        yield f"{len(faulty)} judges did not count in full; the table shows which."
        return
    for name, vote in faulty:
        yield f"{name} {sentences['nobody' if vote.sees_nobody else vote.state].format(age=age(vote.age_s))}."


def _listed(names: list[str], last: str = "and") -> str:
    if len(names) > REASON_NAMES_LIMIT:
        return f"{', '.join(names[:REASON_NAMES_LIMIT])} and {len(names) - REASON_NAMES_LIMIT} more"
    return ", ".join(names[:-1]) + (f" {last} " if len(names) > 1 else "") + names[-1]
