"""The messages of teaching: what a teacher asks of an observer, and how the observer answers (docs/reference/wire.md).

Each request is a query under the observer's own exact key (`common.keys.SceneKeys.teach`) with a TeachRequest as
payload; the answer is a TeachReply. Requests may be repeated: a second one of the same kind changes nothing more.
"""

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from common.message_types import Count, Identifier, Probability
from common.messages import LABELS_LIMIT, Message, MessagePart

TEXT_LIMIT = 300
SHOWN_UNITS, UNSEEN = 1000, -1
SHOWN_LIMIT = 8192
TeachCommand = Literal["status", "show", "start", "begin", "end", "drop", "learn", "adopt", "leave"]
TeachState = Literal["idle", "recording", "learning", "learned"]
TakeState = Literal["waiting", "moving", "kept", "failed"]
Text = Annotated[str, Field(max_length=TEXT_LIMIT)]


class TeachRequest(Message):
    """What a teacher asks of one observer.

    teacher: random per teacher, so that two do not teach at once. labels: for `start` and `learn` all movements of the
    new vocabulary, in its order. add: for `start`, keep the takes of earlier movements. label, take, person: for
    `begin`, `drop` and `show` the movement ("": something else; for `show`: what is seen now), the number of the
    performance, and who performs. in_s: for
    `adopt`, after so many seconds, so that all observers change together. `leave` lets another teacher begin at once.
    """

    command: TeachCommand
    teacher: Identifier
    labels: list[str] = Field(default_factory=list, max_length=LABELS_LIMIT)
    add: bool = False
    label: str = ""
    take: Count = 0
    person: str = ""
    in_s: Annotated[FiniteFloat, Field(ge=0, le=60)] = 0.0


class TakeReport(MessagePart):
    """The take that is recorded now, or the last one. seconds: of it so far. fault: why it was not kept."""

    label: str
    take: Count
    state: TakeState
    seconds: FiniteFloat = 0.0
    fault: Text = ""


class LearnedReport(MessagePart):
    """A model that was learned and is not in force yet.

    results: for each movement, as what its takes were recognised by models that had not learned from them.
    """

    labels: list[str]
    results: dict[str, dict[str, Count]] = Field(default_factory=dict)


class ShownTracks(MessagePart):
    """A few frames of tracks, for people to look at.

    points: for each frame and each body part u and v (down), in thousandths of `size` from `left`, `top`, which are in
    the unit of the tracks; -1 where a part is not seen. seconds: length of what they show.
    """

    body_parts: list[str] = Field(max_length=64)
    points: list[Annotated[int, Field(ge=UNSEEN, le=SHOWN_UNITS)]] = Field(max_length=SHOWN_LIMIT)
    seconds: FiniteFloat = 0.0
    left: FiniteFloat = 0.0
    top: FiniteFloat = 0.0
    size: FiniteFloat = 1.0


class TeachReply(Message):
    """How an observer stands. fault: why it did not do what was asked; "" if it did.

    pictures: whether its camera delivers. visible: whether it sees a body part now; still: how probably the person
    stands still. complaint: of its tracker.
    takes: the numbers of the takes of each movement on its disk; other_s: seconds of something else there. labels: the
    movements of the model in force. learned: the model that waits for `adopt`. tracks: what `show` asked for.
    """

    state: TeachState
    fault: Text = ""
    pictures: bool = False
    visible: bool = False
    still: Probability | None = None
    complaint: Text = ""
    take: TakeReport | None = None
    takes: dict[str, list[Count]] = Field(default_factory=dict)
    other_s: FiniteFloat = 0.0
    labels: list[str] = Field(default_factory=list)
    learned: LearnedReport | None = None
    tracks: ShownTracks | None = None
