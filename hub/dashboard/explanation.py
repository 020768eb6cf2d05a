"""Why a verdict is what it is, in plain sentences: who said what, what it weighed, and whose word was needed. Pure.

What would have been likeliest without a judge the referee says (`contributions`); whether there would then have been a
verdict at all is not computed here: `labanmesh replay --without` judges anew.
"""

import math
from collections.abc import Iterator

from common.messages import VerdictMessage, Vote
from hub.anticipation import unlearned_of
from hub.scene_state import is_abstention
from hub.wording import age

HEARD = ("counted", "stale")
NAMED = 6
"""So many judges are named in a sentence, the others are counted: a scene may have hundreds."""


def stance(verdict: VerdictMessage, vote: Vote) -> str:
    """What a judge's vote meant for the verdict: `agreed`, `held ok`, `undecided`, `late`, `silent`, ..."""
    if vote.state not in HEARD:
        return vote.state
    if vote.label is None:
        return "undecided"
    return "agreed" if vote.label == verdict.label else f"held {vote.label}"


def why(verdict: VerdictMessage, quorum: int | None) -> tuple[str, ...]:
    """The sentences; quorum: how many judges must agree in this scene, None where it is not known."""
    return tuple(_sentences(verdict, quorum))


def _sentences(verdict: VerdictMessage, quorum: int | None) -> Iterator[str]:
    heard = {name: vote for name, vote in verdict.votes.items() if vote.state in HEARD}
    agreeing = [name for name, vote in heard.items() if vote.label == verdict.label]
    if is_abstention(verdict):
        yield from _abstention(verdict)
    else:
        yield from _majority(verdict, agreeing, quorum)
    others = [f"{name} held {vote.label}" for name, vote in heard.items() if vote.label not in (None, verdict.label)]
    undecided = [name for name, vote in heard.items() if vote.label is None]
    if others:
        yield f"{_listed(others)}."
    if undecided:
        if verdict.unlearned is None:
            yield f"{_listed(undecided)} believed no more of one movement than of another."
        else:
            yield f"{_listed(undecided)} held no movement: none more than another, or rather something else."
    yield from _weights(verdict, heard)
    yield from _contributions(verdict)
    yield from _faults(verdict)


def _majority(verdict: VerdictMessage, agreeing: list[str], quorum: int | None) -> Iterator[str]:
    many = f"{len(agreeing)} of {len(verdict.votes)} judges held {verdict.label}"
    yield f"{many}: {_listed(agreeing)}." if agreeing else f"{many} by themselves; together they did."
    if quorum is None or not agreeing:
        return
    if len(agreeing) <= quorum:
        words = "Each of them was needed" if len(agreeing) > 1 else f"{agreeing[0]} was needed"
        yield f"{words}: the scene asks for {quorum} to agree, and with one less there would have been no verdict."
    else:
        yield f"The scene asks for {quorum}: no single judge could have prevented it by holding something else."


def _weights(verdict: VerdictMessage, heard: dict[str, Vote]) -> Iterator[str]:
    weights = {name: vote.weight for name, vote in heard.items() if math.isfinite(vote.weight)}
    if len(weights) > 1:
        name = max(weights, key=lambda each: weights[each])
        yield f"{name} weighed most, {weights[name]:.0%}, by the rule {verdict.rule}: the surer, the heavier."


def _abstention(verdict: VerdictMessage) -> Iterator[str]:
    other = unlearned_of(verdict.unlearned)
    if other > 0.5:
        yield f"The judges saw that something was done and held it for none of the movements ({other:.0%})."
    else:
        yield "The judges saw that something was done and could not agree what, so the referee abstained."


def _contributions(verdict: VerdictMessage) -> Iterator[str]:
    said = verdict.contributions or {}
    if len(said) < 2:
        return
    falls = [name for name, each in said.items() if not each.stands]
    if falls:
        yield f"Without {_listed(falls, 'or')} another answer would have been the likeliest."
    else:
        yield "Without any one of them the likeliest answer would have been the same."


def _faults(verdict: VerdictMessage) -> Iterator[str]:
    said = {
        "stale": "was stale ({age} old), its word had faded",
        "late": "was late ({age} behind) and did not count",
        "silent": "was silent and did not count",
        "foreign": "speaks another vocabulary and did not count",
        "invalid": "sent what could not be used and did not count",
    }
    troubled = [(name, vote) for name, vote in verdict.votes.items() if vote.state in said]
    if len(troubled) > NAMED:
        yield f"{len(troubled)} judges did not count in full; the table says which."
        return
    for name, vote in troubled:
        yield f"{name} {said[vote.state].format(age=age(vote.age_s))}."


def _listed(names: list[str], last: str = "and") -> str:
    if len(names) > NAMED:
        return f"{', '.join(names[:NAMED])} and {len(names) - NAMED} more"
    return ", ".join(names[:-1]) + (f" {last} " if len(names) > 1 else "") + names[-1]
