"""What a page begins besides lessons: corrections, movements that were missed, and forgetting. Pure.

Of a movement without a verdict each observer takes what moved nearest to it, which may have been something else: so
the examples are shown before anybody learns from them, and one that is not the movement can be dropped.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from common import MS_NS, SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.messages import VerdictMessage
from hub.teaching.correcting import Correction, correct, learn_corrections
from hub.teaching.interface import Step
from hub.teaching.participants import Participants

TOO_OLD = "that was too long ago: the cameras no longer remember what they saw then"
NONE_LEFT = "no example is left, so nothing was learned, and nothing changes"


@dataclass(frozen=True, slots=True)
class Missed:
    """A movement that somebody did `ago_s` seconds ago, and that had no verdict."""

    label: str
    ago_s: float


@dataclass(frozen=True, slots=True)
class WantedCorrections:
    """What was wrong. labels: what the movements of verdicts were, by id; "" for none. person: who; "": unknown."""

    labels: Mapping[str, str] = field(default_factory=dict)
    missed: Sequence[Missed] = ()
    person: str = ""


@dataclass(frozen=True, slots=True)
class MissedExample:
    """The example cut out for a missed movement: the number of its take on each observer that has one."""

    label: str
    takes: Mapping[str, int]


def corrections_of(
    wanted: WantedCorrections, verdicts: Sequence[VerdictMessage], now_ns: int, remembered_s: float
) -> tuple[list[Correction], list[Correction]]:
    """Those of verdicts, and those of missed movements; raises BadInput, one line, for what is too old, or nothing.

    verdicts: those that can be corrected. now_ns: by the clock of the fusion service.
    """
    known = {each.id: each for each in verdicts}
    if not set(wanted.labels) <= set(known) or any(each.ago_s > remembered_s for each in wanted.missed):
        raise BadInput(TOO_OLD)
    if not wanted.labels and not wanted.missed:
        raise BadInput("nothing was corrected; say first what was wrong")
    moments = [(each.label, now_ns - round(each.ago_s * SECOND_NS)) for each in wanted.missed]
    return (
        [Correction.of_verdict(known[verdict], label) for verdict, label in wanted.labels.items()],
        [Correction(f"moment-{at_ns // MS_NS}", label, at_ns, at_ns) for label, at_ns in moments],
    )


def learn_from(
    participants: Participants,
    of_verdicts: Sequence[Correction],
    of_missed: Sequence[Correction],
    offsets: Mapping[str, float],
    person: str,
    examples: list[MissedExample],
) -> None:
    """Make examples, show those of missed movements in `examples`, and learn. Raises LabanmeshError if none is left.

    offsets: of the observers' clocks, s.
    """
    made: dict[str, int] = {}
    for correction in of_verdicts:
        _count(made, _corrected(participants, correction, offsets, person))
    for correction in of_missed:
        before = _numbers(participants, correction.label)
        if _corrected(participants, correction, offsets, person):
            after = _numbers(participants, correction.label)
            new = {name: numbers - before.get(name, set()) for name, numbers in after.items()}
            takes = {name: max(numbers) for name, numbers in new.items() if numbers}
            examples.append(MissedExample(correction.label, takes))
    _let_choose(participants, examples)
    for example in examples:
        _count(made, example.takes)
    if not any(made.values()):
        raise LabanmeshError(NONE_LEFT)
    learn_corrections(participants, [name for name, count in made.items() if count])


def _let_choose(participants: Participants, examples: list[MissedExample]) -> None:
    """Wait until somebody continues. Examples that they drop are deleted, also from the observers' disks."""
    try:
        while examples:
            action = participants.interface.ready(Step("examples", number=len(examples)))
            if action.kind != "drop":
                return
            if 1 <= action.take <= len(examples):
                example = examples.pop(action.take - 1)
                _drop(participants, example)
                participants.interface.say(f"that was not {example.label}: dropped")
    except KeyboardInterrupt:
        # Nobody has said that these are the movement.
        while examples:
            _drop(participants, examples.pop())
        raise


def _drop(participants: Participants, example: MissedExample) -> None:
    for name, number in example.takes.items():
        participants.request_of("drop", [name], label=example.label, take=number)


def _corrected(
    participants: Participants, correction: Correction, offsets: Mapping[str, float], person: str
) -> Mapping[str, int]:
    """The number of examples that each observer made; a moment that no observer remembers gives none."""
    try:
        return correct(participants, [correction], offsets, person)
    except BadInput:
        raise
    except LabanmeshError:
        if not participants.observers:
            raise
        return {}


def _count(made: dict[str, int], examples: Mapping[str, int]) -> None:
    for name, count in examples.items():
        made[name] = made.get(name, 0) + bool(count)


def _numbers(participants: Participants, label: str) -> dict[str, set[int]]:
    replies = participants.request("status")
    return {name: set(reply.takes.get(label, ())) for name, reply in replies.items()}
