"""The messages of the watch for falls, both optional (docs/reference/wire.md). Pure."""

from typing import Annotated, Literal

from pydantic import Field

from common.message_types import Id, Identifier, Probability, Time
from common.messages import Agreement, Message

FallStage = Literal["unknown", "up", "low", "fallen"]
OBSERVERS_LIMIT = 256
"""Observers in a fall message."""
TRACKS_LIMIT = 8
"""People whom one observer sees."""


class PostureMessage(Message):
    """What one observer sees of the watched person's posture; the key says whose message it is.

    lying: the probability that the person lies, from the frame captured at `captured_ns`; omitted while the observer
    does not see the person well enough to tell. It needs no model. `people`: of an observer that follows several
    people, the same for each of its tracks that it sees well enough; `lying` is then the greatest.
    """

    captured_ns: Time
    lying: Probability | None = None
    people: Annotated[dict[Identifier, Probability], Field(max_length=TRACKS_LIMIT)] | None = None


class FallMessage(Message):
    """The stage of the watch: whether somebody has fallen. Published at each change and once a second.

    `up`: somebody is up, or was seen up last; `low`: they lie; `fallen`: they have lain for `after_s` of the scene
    file; `unknown`: nobody has been seen up yet. `id`: of the newest fall; all messages about it have the same, also
    the `up` that ends it. `since_ns`: when the stage began, of `fallen` when the person began to lie. `lying`: the
    probability that as many observers reach as must agree, omitted while nobody sees the person; `agreement`: k of the
    n that see the person hold that they lie. `observers`: `lying` of each that sees them. `person`: whom it is about,
    in a scene that judges several people; each has stages of their own.
    """

    scene: Identifier
    fusion: Identifier
    session: Id
    at_ns: Time
    stage: FallStage
    since_ns: Time
    id: Id | None = None
    lying: Probability | None = None
    agreement: Agreement = Agreement(k=0, n=0)
    observers: Annotated[dict[Identifier, Probability], Field(default_factory=dict, max_length=OBSERVERS_LIMIT)]
    person: Identifier | None = None
