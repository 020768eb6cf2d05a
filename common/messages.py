"""The messages on the mesh, checked when they are made and when they arrive (docs/reference/wire.md).

1. Every message is a map with string keys and carries `v`, its schema version. Unknown fields are ignored, so that a
   newer peer can send more.
2. Times are Unix epoch in nanoseconds and fit into 63 bits; ages are in seconds, entropies in bits.
3. Round-off is no error: a probability or entropy outside its range by at most 1e-6 is clamped; -0.0 becomes 0.0.
"""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field, FiniteFloat, model_validator

from common.errors import BadInput
from common.message_types import (
    LABELS_LIMIT,
    Bits,
    BodyRegionShares,
    Count,
    Id,
    Identifier,
    Label,
    MovementTimes,
    Place,
    Printable,
    Probabilities,
    Probability,
    Repetitions,
    Roots,
    Score,
    ShortText,
    Time,
    VotedFacing,
    VotedRepeated,
    p_of_roots,
)  # fmt: skip
from common.message_types import MessagePart as MessagePart
from common.posterior import Facing as Facing
from common.posterior import PosteriorMessage as PosteriorMessage
from common.posterior import VocabularyHash as VocabularyHash
from common.score import REMARK_LIMIT, REMARKS_LIMIT
from common.vocabulary import Vocabulary

SCHEMA_VERSION: Final = 1
WHY_LIMIT = 200  # characters
VoteState = Literal["counted", "stale", "late", "silent", "foreign", "invalid"]
ProcessRole = Literal["observer", "fusion", "hub"]
ProcessState = Literal["starting", "running", "degraded", "stopping", "failed"]
VerdictStage = Literal["decided", "revised", "ended"]


class Message(MessagePart):
    """The base of all messages but the posterior, with the schema version."""

    VERSIONS: ClassVar[tuple[int, ...]] = (SCHEMA_VERSION,)  # those that can be decoded
    v: Literal[1] = SCHEMA_VERSION


AnyMessage = Message | PosteriorMessage
ObserverPosterior = tuple[str, PosteriorMessage]
"""An observer's id, from the key of its message, and its posterior."""


class VocabularyReference(MessagePart):
    """The vocabulary of a probability vector: the hash identifies it, the name is for people."""

    name: ShortText
    hash: Id


class Vote(MessagePart):
    """One observer's entry in a judgement; its fields are null while the observer has sent nothing usable.

    `label` is also null while no movement stands out from the prior, and while `unlearned` is more probable. `weight`:
    its share in the pooled posterior; `rest`: the probability that the person rests, null also if it sees nobody;
    `skew_s`: how far its clock is ahead of ours, by which `age_s` is corrected; `reliability`: learned;
    `rest_reliability`, `label_reliability`: lately, if doubted; `doubles`: correlated observers; `freshness`: what is
    left of a stale posterior; `repetitions`, `repeated`: as in its posterior. A short vote has `root_p` for `p`, and no
    `facing`, `facets`, `doubles`, `freshness`, `repeated`.
    """

    label: Label | None
    entropy: Bits | None
    weight: Probability
    age_s: FiniteFloat | None
    state: VoteState
    p: Probabilities | None = None
    rest: Probability | None = None
    skew_s: FiniteFloat | None = None
    unlearned: Probability | None = None
    facing: VotedFacing | None = None
    facets: dict[str, Probabilities] | None = None
    reliability: Probability | None = None
    rest_reliability: Probability | None = None
    label_reliability: Probability | None = None
    doubles: dict[Id, Probability] | None = None
    root_p: Roots | None = Field(default=None, max_length=LABELS_LIMIT)
    freshness: Probability | None = None
    repetitions: Repetitions | None = None
    repeated: VotedRepeated | None = None

    @property
    def sees_nobody(self) -> bool:
        """Whether it enters the judgement although its observer sees no body part."""
        return self.state == "stale" and self.rest is None

    @model_validator(mode="after")
    def _with_p(self) -> "Vote":
        if self.root_p is not None and self.p is None:
            reliability = 1.0 if self.reliability is None else self.reliability
            self.__dict__.update(p=p_of_roots(self.root_p), reliability=reliability)
        return self


class Agreement(MessagePart):
    """How many of the observers that are counted or stale vote for the fused label: k of n."""

    k: Count
    n: Count


class OngoingMovement(MessagePart):
    """The movement in progress: the id of its verdict, its beginning, and the decision so far.

    `revises` is the label that `label` replaced, if it was. `outage_ns` is when a decided movement was seen last before
    an outage that may have hidden its end.
    """

    id: Id
    began_ns: Time
    label: Label | None = None
    decided_ns: Time | None = None
    revises: Label | None = None
    outage_ns: Time | None = None


class JudgementMessage(Message):
    """The pooled posterior of one fusion step, and every observer's vote. `certainty_bits` is the entropy of `p`.

    On the mesh its votes are short; with full votes it is published under a key of its own (`common.keys`).
    `unlearned` is the probability that the person does no movement of the vocabulary, omitted if no observer reports
    it; `p` is conditional on a movement of the vocabulary. `facets` are pooled from the observers that report them;
    `facing` among them is the distribution over K directions, and `facing_deg` the most probable one in degrees to the
    left of where recordings face the Door. `movement` is omitted while the person rests; a standby fusion service
    continues from it. `why` explains in a line for people why the movement in progress has no verdict yet; it is
    omitted once the movement is decided, and at rest. `epoch` is one higher than that of the fusion service before: of
    two services that publish, the one with the lower epoch stops. `session` is random per process. `repetitions`: of a
    periodic movement so far; `partial_repetitions`: how many of them went less far than usual. While no vote is
    counted or stale, `label` is empty, `agreement` 0 of 0, `p` the prior. `person`: whom it is about, in a scene that
    judges several people; `place`: where they are, x and z in metres, if that is known.
    """

    scene: Identifier
    fusion: Identifier
    seq: Count
    at_ns: Time
    vocabulary: VocabularyReference
    p: Probabilities
    label: Label
    certainty_bits: Bits
    rule: ShortText
    votes: dict[Id, Vote]
    agreement: Agreement
    unlearned: Probability | None = None
    facets: dict[str, Probabilities] | None = None
    facing_deg: FiniteFloat | None = None
    movement: OngoingMovement | None = None
    why: Annotated[str, Field(max_length=WHY_LIMIT), Printable] | None = None
    epoch: Count | None = None
    session: Id | None = None
    repetitions: Count | None = None
    partial_repetitions: Count | None = None
    person: Identifier | None = None
    place: Place | None = None


class Contribution(MessagePart):
    """One observer's contribution to a verdict.

    `nats`: the log odds of the label against the best alternative, minus those without this observer; negative if it
    spoke against the label. `stands`: the label is the most probable one without this observer, too.
    """

    nats: float
    stands: bool


class VerdictMessage(JudgementMessage):
    """The verdict on one movement. All messages about a movement have the same `id` and `began_ns`.

    `stage`: "decided" is the first word; "revised" replaces a label by another, with `revises`, the label that it
    replaces; "ended" repeats the last label and adds `ended_ns`. A movement without a label before its end, and an
    abstention without one, have a single message, "ended", which keeps the `revises` of a revised movement. `p`,
    `votes` and `agreement` are those at `decided_ns`, at the end too; those of an abstention are from the end of the
    movement, and its `why` says what a label lacked. `contributions` are of the observers that were counted or stale;
    those of an abstention are to the label that was most probable. `facets` and `repetitions` are those at the end of
    the movement, once it is known. `same_as`: the movement's other id, after a split network (docs/reference/wire.md).
    `score`, 0 to 10, `scores` by observer, `remarks` in words: of an ended movement that observers can score;
    `unscored` says why none of them could.
    """

    id: Id
    began_ns: Time
    decided_ns: Time
    ended_ns: Time | None = None
    stage: VerdictStage = "decided"
    revises: Label | None = None
    same_as: Id | None = None
    contributions: dict[Id, Contribution] | None = None
    score: Score | None = None
    scores: dict[Id, Score] | None = None
    remarks: list[Annotated[str, Field(max_length=REMARK_LIMIT), Printable]] | None = Field(
        default=None, max_length=REMARKS_LIMIT
    )
    unscored: Annotated[str, Field(max_length=REMARK_LIMIT), Printable] | None = None

    @model_validator(mode="before")
    @classmethod
    def _with_stage(cls, fields: object) -> object:
        """The fields with a stage; those of an earlier version have none."""
        if not isinstance(fields, Mapping) or fields.get("stage") is not None:
            return fields
        return {**fields, "stage": "decided" if fields.get("ended_ns") is None else "ended"}

    @model_validator(mode="after")
    def _stage_fits(self) -> "VerdictMessage":
        if (self.stage == "ended") != (self.ended_ns is not None):
            raise ValueError(f"stage {self.stage!r} does not fit ended_ns {self.ended_ns}")
        if self.stage == "revised" and self.revises in (None, self.label):
            raise ValueError(f"stage 'revised' with the label {self.label!r} that revises {self.revises!r}")
        return self


class ObserverStatistics(MessagePart):
    """A fusion service's statistics of one observer: its clock skew, and rejected messages counted by reason."""

    skew_s: FiniteFloat | None = None
    rejected: dict[Id, Count] = Field(default_factory=dict)


class StatusMessage(Message):
    """The state of a process. `at_ns` is its clock when it sends this: a process that queries it learns the skew.

    `session` is random per process. `observers` are a fusion service's statistics. `leans_on`: of an observer's model.
    """

    scene: Identifier
    id: Identifier
    state: ProcessState
    reason: ShortText = ""
    rate_hz: FiniteFloat | None = None
    last_frame_ns: Time | None = None
    skew_s: FiniteFloat | None = None
    version: ShortText = ""
    at_ns: Time | None = None
    session: Id | None = None
    observers: dict[Id, ObserverStatistics] | None = None
    leans_on: BodyRegionShares | None = None


class VocabularyMessage(Message):
    """The labels of the movements, in the order of every `p`, their hash, and what their takes say about durations.

    `fusion`: the service that sends it, whose durations are those that the observers agree on; observers omit it.
    """

    scene: Identifier
    name: ShortText
    hash: Id
    labels: list[Label] = Field(min_length=2, max_length=LABELS_LIMIT)
    movements: dict[Label, MovementTimes] = Field(default_factory=dict, max_length=LABELS_LIMIT)
    fusion: Identifier | None = None

    @model_validator(mode="after")
    def _hash_fits(self) -> "VocabularyMessage":
        try:
            digest = self.vocabulary.digest
        except BadInput as error:
            raise ValueError(str(error)) from None
        if self.hash != digest:
            raise ValueError(f"hash {self.hash!r} does not fit the labels, whose hash is {digest!r}")
        return self

    @classmethod
    def of(cls, scene: str, vocabulary: Vocabulary, fusion: str | None = None) -> "VocabularyMessage":
        """The message that carries `vocabulary`."""
        labels, movements = list(vocabulary.labels), dict(vocabulary.movements)
        return cls(
            scene=scene, name=vocabulary.name, hash=vocabulary.digest, labels=labels, movements=movements, fusion=fusion
        )

    @property
    def vocabulary(self) -> Vocabulary:
        """The vocabulary itself."""
        return Vocabulary(tuple(self.labels), self.name, self.movements)
