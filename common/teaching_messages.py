"""The messages of teaching: what a teacher asks of an observer, and how the observer answers (docs/reference/wire.md).

Each request is a query under the observer's own exact key (`common.keys.SceneKeys.teach`) with a TeachRequest as
payload; the answer is a TeachReply. Requests may be repeated: a second one of the same kind changes nothing more.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, FiniteFloat, model_validator

from common.errors import BadInput
from common.floor_place import FloorPlace
from common.message_types import LABELS_LIMIT, Count, Id, Identifier, Label, Printable, Probability, Time
from common.messages import Message, MessagePart

TEACHING_TEXT_LIMIT = 300
SHOWN_UNITS, UNSEEN = 1000, -1
SHOWN_LIMIT = 8192
DOUBTS_LIMIT = 60
PERSONS_LIMIT, PERSON_LIMIT = 100, 64
"""Persons in a reply, and characters of a name."""
EARLIER_LIMIT = 10
"""Sets of earlier takes that an observer keeps: ten lessons that were begun by mistake; a set is some hundred kB."""
TAKES_LIMIT = 1000
"""Takes of one movement in a reply: a lesson has 100 of each at most."""
SOMEONE = "someone"
"""Whose takes they are if nobody is named."""
TeachCommand = Literal[
    "status", "show", "start", "begin", "end", "drop", "check", "learn", "adopt", "leave", "correct", "forget",
    "earlier", "restore",
]  # fmt: skip
TeachState = Literal["idle", "recording", "learning", "learned"]
TakeState = Literal["waiting", "moving", "kept", "failed"]
Side = Literal["left", "middle", "right"]
"""Where in the picture somebody is among the people who are seen."""
Text = Annotated[str, Field(max_length=TEACHING_TEXT_LIMIT), Printable]
Person = Annotated[str, Field(max_length=PERSON_LIMIT), Printable]
Seconds = Annotated[FiniteFloat, Field(ge=0)]
Labels = Annotated[list[Label], Field(max_length=LABELS_LIMIT)]
CountOf = Annotated[dict[Label, Count], Field(max_length=LABELS_LIMIT)]


class TaughtPlace(MessagePart):
    """Where on the floor somebody stands, in the axes of the camera files: x, z in m; covariance xx, xz, zz in m²."""

    at: Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
    covariance: Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]

    @model_validator(mode="after")
    def _is_a_place(self) -> "TaughtPlace":
        self.on_floor()
        return self

    def on_floor(self) -> FloorPlace:
        """The same as posteriors carry it; raises ValueError if it is no place."""
        (x, z), (xx, xz, zz) = self.at, self.covariance
        return FloorPlace(at=(x, z), covariance=(xx, xz, zz))


class TeachRequest(Message):
    """A teacher's request to one observer.

    teacher: random per teacher, so that two do not teach at once. labels: for `start` and `learn` all movements of the
    new vocabulary, in its order. add: for `start`, keep the takes of earlier movements. label, take, person: for
    `begin`, `drop` and `show` the movement ("": something else; for `show`: what is seen now), the number of the
    performance, and who performs ("": for `correct` the only person of whom there are takes; else SOMEONE). references:
    for `learn`, the movements of which the takes of `person` show how they should be done; add: those that the model in
    force has still do. in_s: for
    `adopt`, after so many seconds, so that all observers change together. `leave` lets another teacher begin at once.

    correction: for `correct`, the id of the verdict, or any other id for a movement that had none; a second `correct`
    with the same id replaces the first. label: what it was ("": something else). from_ns, to_ns: when, by the clock of
    the observer's machine; to_ns = 0: until the person stands still; to_ns = from_ns: the movement nearest to that
    time. `forget` removes the takes of `person`, or of `label`, or `everything` that teaching left; models: also the
    model in force, so that the observer waits to be taught; clips: also the observer's clips of verdicts, of `label` if
    that is given, else all. `earlier` asks for the takes that were set aside, `restore` makes those with the id
    `earlier` the takes of now. place: for `status` and `begin`, where another camera sees the one who is taught.
    """

    command: TeachCommand
    teacher: Identifier
    labels: Labels = Field(default_factory=list)
    add: bool = False
    label: Label = ""
    take: Count = 0
    person: Person = ""
    in_s: Annotated[FiniteFloat, Field(ge=0, le=60)] = 0.0
    correction: Text = ""
    from_ns: Time = 0
    to_ns: Time = 0
    everything: bool = False
    models: bool = False
    clips: bool = False
    earlier: Id = ""
    references: Labels = Field(default_factory=list)
    place: TaughtPlace | None = None


@dataclass(frozen=True, slots=True)
class Unwanted:
    """The takes to forget: a person's, a movement's, or everything that teaching left."""

    person: str = ""
    label: str = ""
    everything: bool = False

    def covers(self, person: str, label: str) -> bool:
        """Whether a take of this person and this movement is to be forgotten."""
        return self.everything or person == (self.person or None) or label == (self.label or None)


class TakeReport(MessagePart):
    """The take that is recorded now, or the last one. seconds: of it so far. fault: why it was not kept.

    people: the most people who were in the picture for a while during the take; 0 if the tracker does not tell. side:
    of the picture on which the one was, among these, whose take it is.
    """

    label: Label
    take: Count
    state: TakeState
    seconds: Seconds = 0.0
    fault: Text = ""
    people: Count = 0
    side: Side | None = None


class TakeDoubt(MessagePart):
    """A take that looks more like those of another movement."""

    label: Label
    take: Count
    like: Label


class LearnedReport(MessagePart):
    """A model that was learned and is not in force yet.

    results: for each movement, the movements for which models that had not learned from its takes took them, and how
    often. periods: seconds of one repetition, of each movement whose takes are periodic. references: how many takes
    show how a movement should be done, of each that is scored.
    """

    labels: Labels
    periods: dict[Label, Seconds] = Field(default_factory=dict, max_length=LABELS_LIMIT)
    results: dict[Label, CountOf] = Field(default_factory=dict, max_length=LABELS_LIMIT)
    references: CountOf = Field(default_factory=dict)


class CorrectedReport(MessagePart):
    """An example made of a verdict. from_ns, to_ns: what was cut out, by the clock of the observer's machine."""

    id: Text
    label: Label
    from_ns: Time
    to_ns: Time
    seconds: Seconds


class ForgottenReport(MessagePart):
    """The numbers removed: takes of movements, seconds of something else, files of models, clips of verdicts.

    in_model: whether the model in force was learned from it, so that it must be learned anew.
    """

    takes: Count = 0
    other_s: Seconds = 0.0
    models: Count = 0
    clips: Count = 0
    in_model: bool = False


class EarlierTakes(MessagePart):
    """Takes that were set aside `at_ns`, by the clock of the observer's machine.

    takes: how many of each movement. labels: the movements of its lesson if that has not ended. other_s: seconds of
    something else.
    """

    id: Id
    takes: CountOf = Field(default_factory=dict)
    labels: Labels = Field(default_factory=list)
    other_s: Seconds = 0.0
    at_ns: Time = 0


class ShownTracks(MessagePart):
    """A few frames of tracks, for people to look at.

    points: for each frame and each body part u and v (down), in thousandths of `size` from `left`, `top`, which are in
    the unit of the tracks; -1 where a part is not seen. seconds: length of what they show.
    """

    body_parts: list[Id] = Field(max_length=64)
    points: list[Annotated[int, Field(ge=UNSEEN, le=SHOWN_UNITS)]] = Field(max_length=SHOWN_LIMIT)
    seconds: Seconds = 0.0
    left: FiniteFloat = 0.0
    top: FiniteFloat = 0.0
    size: FiniteFloat = 1.0


class TeachReply(Message):
    """The state of an observer after a request. fault: why it did not do what was asked; "" if it did.

    pictures: whether its camera delivers. visible: whether it sees a body part now; still: how probably the person
    stands still. complaint: of its tracker.
    takes: the numbers of the takes of each movement on its disk; other_s: seconds of something else there. labels: the
    movements of the model in force. learned: the model that waits for `adopt`. tracks: what `show` asked for. people:
    how many are in the picture now; None if the tracker does not tell. side: of the picture on which the one is, among
    these, who is taught; None if nobody else is there. claps: how often somebody has clapped their
    hands since the observer began to watch for it. doubts: what `check` found. corrected, forgotten: in the answer
    to `correct` and to `forget`, what was done. persons: whose recordings are on its disk,
    SOMEONE among them, and how many of each movement ("": something else). earlier: in the answer to `earlier` and
    `restore`, the takes that were set aside. place: of the one who is taught, if several people may be seen.
    """

    state: TeachState
    fault: Text = ""
    pictures: bool = False
    visible: bool = False
    still: Probability | None = None
    complaint: Text = ""
    take: TakeReport | None = None
    takes: dict[Label, Annotated[list[Count], Field(max_length=TAKES_LIMIT)]] = Field(
        default_factory=dict, max_length=LABELS_LIMIT
    )
    other_s: Seconds = 0.0
    labels: Labels = Field(default_factory=list)
    learned: LearnedReport | None = None
    tracks: ShownTracks | None = None
    corrected: CorrectedReport | None = None
    forgotten: ForgottenReport | None = None
    people: Count | None = None
    side: Side | None = None
    claps: Count = 0
    doubts: list[TakeDoubt] = Field(default_factory=list, max_length=DOUBTS_LIMIT)
    earlier: list[EarlierTakes] = Field(default_factory=list, max_length=EARLIER_LIMIT)
    persons: dict[Person, CountOf] = Field(default_factory=dict, max_length=PERSONS_LIMIT)
    place: TaughtPlace | None = None


def require_person(name: str) -> None:
    """Raise BadInput, one line, for what cannot be the name of a performer."""
    if not name.isprintable() or len(name) > PERSON_LIMIT:
        raise BadInput(f"who performs: at most {PERSON_LIMIT} printable characters are expected")


def only_person(persons: Collection[str]) -> str:
    """Whose corrections those are for which nobody is named: the only one of `persons`, else SOMEONE."""
    (person, *others) = persons or (SOMEONE,)
    return SOMEONE if others else person
