"""What a page begins besides lessons: corrections, movements that were missed, and forgetting. Pure.

Of a movement without a verdict each observer takes what moved nearest to it, which may have been something else: so
the examples are shown before anybody learns from them, and one that is not the movement can be dropped.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from common import MS_NS, SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.messages import VerdictMessage
from hub.teaching.correcting import Correction, MomentExample, correct, learn_corrections
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


def corrections_of(
    wanted: WantedCorrections, verdicts: Sequence[VerdictMessage], now_ns: int, remembered_s: float
) -> list[Correction]:
    """Those of verdicts, then those of missed movements; raises BadInput, one line, for what is too old, or nothing.

    verdicts: those that can be corrected. now_ns: by the clock of the fusion service.
    """
    known = {each.id: each for each in verdicts}
    if not set(wanted.labels) <= set(known) or any(each.ago_s > remembered_s for each in wanted.missed):
        raise BadInput(TOO_OLD)
    if not wanted.labels and not wanted.missed:
        raise BadInput("nothing was corrected; say first what was wrong")
    moments = [(each.label, now_ns - round(each.ago_s * SECOND_NS)) for each in wanted.missed]
    return [
        *(Correction.of_verdict(known[verdict], label) for verdict, label in wanted.labels.items()),
        *(Correction(f"moment-{at_ns // MS_NS}", label, at_ns, at_ns) for label, at_ns in moments),
    ]


def learn_from(
    participants: Participants,
    corrections: Sequence[Correction],
    offsets: Mapping[str, float],
    person: str,
    examples: list[MomentExample],
) -> None:
    """Make examples, show those of missed movements in `examples`, and learn. Raises LabanmeshError if none is left.

    offsets: of the observers' clocks, s.
    """
    made = Counter(correct(participants, corrections, offsets, person, examples))
    made.subtract(_dropped(participants, examples))
    if not any(made.values()):
        raise LabanmeshError(NONE_LEFT)
    learn_corrections(participants, [name for name, count in made.items() if count])


def _dropped(participants: Participants, examples: list[MomentExample]) -> Counter[str]:
    """Wait until somebody continues; how many examples of each observer they dropped, also from its disk."""
    dropped: Counter[str] = Counter()
    try:
        while examples:
            action = participants.interface.ready(Step("examples", number=len(examples)))
            if action.kind != "drop":
                break
            if 1 <= action.take <= len(examples):
                example = examples.pop(action.take - 1)
                _drop(participants, example)
                dropped.update(example.takes.keys())
                participants.interface.say(f"that was not {example.label}: dropped")
    except KeyboardInterrupt:
        # Nobody has said that these are the movement.
        while examples:
            _drop(participants, examples.pop())
        raise
    return dropped


def _drop(participants: Participants, example: MomentExample) -> None:
    for name, number in example.takes.items():
        participants.request_of("drop", [name], label=example.label, take=number)
