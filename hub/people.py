"""Several people in the state of a hub: one judgement is shown large, those of the others beside it. Pure.

A fusion service always judges the first person of a scene, and that one is shown large. Listeners that know nothing of
persons may show whatever judgement is the newest.
"""

from collections.abc import Mapping, Sequence

from common import SECOND_NS
from common.fall_messages import FallMessage
from common.messages import JudgementMessage

Others = Mapping[str, JudgementMessage]
Falls = Mapping[str, FallMessage]
AWAY_NS = 2 * SECOND_NS
"""A person who has not been judged for so long, by the fusion machine's clock, is not there."""

STAGES = ("unknown", "up", "low", "fallen")
"""Of the watch for falls, those that matter most last."""


def worst(falls: Falls) -> FallMessage:
    """The one that matters most; of equal stages the newest."""
    return max(falls.values(), key=lambda fall: (STAGES.index(fall.stage), fall.since_ns))


def is_beside(message: JudgementMessage, shown: JudgementMessage | None) -> bool:
    """Whether it is of another person than the one who is shown large, and who is still judged."""
    if shown is None or message.person is None or shown.person in (None, message.person):
        return False
    return abs(message.at_ns - shown.at_ns) < AWAY_NS


def with_other(others: Others, message: JudgementMessage) -> Others:
    """The newest judgement of each person, with one more; the same object if it is a late copy."""
    person = message.person or ""
    known = others.get(person)
    if known is not None and known.fusion == message.fusion and 0 <= known.at_ns - message.at_ns < SECOND_NS:
        return others
    return {**others, person: message}


def all_judged(shown: JudgementMessage | None, others: Others) -> Sequence[JudgementMessage]:
    """The judgements of everybody who is there, by name; empty in a scene that judges one person."""
    if shown is None or shown.person is None:
        return ()
    there = [each for each in others.values() if abs(each.at_ns - shown.at_ns) < AWAY_NS]
    known = {each.person or "": each for each in (*there, shown)}
    return [known[person] for person in sorted(known)]
