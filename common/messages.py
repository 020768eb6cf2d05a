"""The messages of the mesh, checked where they come in (docs/reference/wire.md).

Every message is a map with string keys and carries `v`, its schema version. Unknown extra fields are
ignored, so that a newer peer may say more. Times are Unix epoch in nanoseconds; ages in seconds.
"""

from typing import Annotated, ClassVar, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeInt, model_validator

from common.facets import check_facets

SCHEMA_VERSION: Final = 1
SUM_TOLERANCE = 1e-3
"""A posterior may miss a sum of 1 by this much: what float32 arithmetic of a foreign judge can lose."""

Identifier = Annotated[str, Field(pattern=r"^[a-z0-9_-]{1,64}$")]
Probability = Annotated[FiniteFloat, Field(ge=0, le=1)]
VoteState = Literal["counted", "stale", "late", "silent", "foreign", "invalid"]
ProcessRole = Literal["observer", "fusion", "hub"]
ProcessState = Literal["starting", "running", "degraded", "stopping", "failed"]


class Message(BaseModel):
    """What all messages share: the schema version, and that they are never changed after they were made."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    VERSIONS: ClassVar[tuple[int, ...]] = (SCHEMA_VERSION,)
    """Those that are understood."""
    v: Literal[1] = SCHEMA_VERSION


class VocabularyHash(BaseModel):
    """Which vocabulary a probability vector is in: the hash decides, the name is for people and may be left out."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    name: str = ""
    hash: str


class VocabularyReference(VocabularyHash):
    """Which vocabulary a probability vector is in: a name for people and a hash that decides."""

    name: str


class Facing(BaseModel):
    """Which way the person faces in the room's frame, for each movement that it may be: P(facing | movement).

    surprise: (M, K) whole numbers, -8 ln P(facing k | movement m), rounded and at most 255: a byte or two each, and
    near enough to be multiplied. Facing k is turned to the left by k * 360/K degrees from where recordings face the
    Door.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")
    surprise: list[list[Annotated[int, Field(ge=0, le=255)]]] = Field(min_length=2, max_length=10_000)

    @model_validator(mode="after")
    def _is_table(self) -> "Facing":
        if len({len(row) for row in self.surprise}) != 1 or not 1 <= len(self.surprise[0]) <= 72:
            raise ValueError("surprise has rows of different lengths, or not 1 to 72 facings")
        return self


class PosteriorMessage(Message):
    """What one observer believes: `p` over the vocabulary's movements, cumulative since the movement began.

    `unlearned` is the probability that what the person does is none of them; a judge that cannot tell leaves it out.
    Version 2 is the terse one: scene and observer, which the key says, may be left out.
    """

    VERSIONS: ClassVar[tuple[int, ...]] = (1, 2)
    v: Literal[1, 2] = SCHEMA_VERSION  # type: ignore[assignment]
    scene: Identifier | None = None
    observer: Identifier | None = None
    seq: NonNegativeInt
    session: str
    captured_ns: NonNegativeInt
    sent_ns: NonNegativeInt
    vocabulary: VocabularyHash
    p: list[Probability] = Field(min_length=2, max_length=10_000)
    prior: list[Probability] | None = None
    rest: Probability | None = None
    unlearned: Probability | None = None
    frames: NonNegativeInt
    visible: dict[str, bool] = Field(default_factory=dict)
    facing: Facing | None = None
    facets: dict[str, list[Probability]] | None = None

    @model_validator(mode="after")
    def _is_distribution(self) -> "PosteriorMessage":
        if self.v == 1 and None in (self.scene, self.observer):
            raise ValueError("scene and observer may be left out from version 2 on; this is version 1")
        for name, values in (("p", self.p), ("prior", self.prior)):
            if values is not None and abs(sum(values) - 1) > SUM_TOLERANCE:
                raise ValueError(f"{name} sums to {sum(values):.6g}, not to 1")
        if self.prior is not None and len(self.prior) != len(self.p):
            raise ValueError(f"prior has {len(self.prior)} entries, p has {len(self.p)}")
        if self.facing is not None and len(self.facing.surprise) != len(self.p):
            raise ValueError(f"facing has {len(self.facing.surprise)} rows, p has {len(self.p)} entries")
        check_facets(self.facets or {})
        return self

    def is_of(self, scene: str, observer: str) -> bool:
        """Whether it does not say that it is somebody else's than its key says."""
        return (self.scene or scene, self.observer or observer) == (scene, observer)


class Vote(BaseModel):
    """One judge's flag: label, entropy (bits), weight, age; null while the judge has said nothing usable.

    `label` is null too while the judge believes no more of one movement than of another, or rather that it is none of
    them (`unlearned`). `rest` is the judge's chance that the person rests. `skew_s` is how far his clock is ahead of
    the fusion machine's; `age_s` is corrected by it. `reliability` is what was learned of him from earlier verdicts, 1
    for nothing against him; `doubles` are those with whom he shares a voice, and how much of it: 1 is all.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")
    label: str | None
    entropy: float | None
    weight: float
    age_s: float | None
    state: VoteState
    p: list[float] | None = None
    rest: float | None = None
    skew_s: float | None = None
    unlearned: float | None = None
    facing: Facing | None = None
    facets: dict[str, list[float]] | None = None
    reliability: float | None = None
    doubles: dict[str, float] | None = None


class Agreement(BaseModel):
    """How many of the judges who are heard (counted or stale) hold the fused label: k of n."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    k: NonNegativeInt
    n: NonNegativeInt


class OngoingMovement(BaseModel):
    """The movement that is being judged: its verdict's id, when it began, and what was decided of it so far."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    id: str
    began_ns: NonNegativeInt
    label: str | None = None
    decided_ns: NonNegativeInt | None = None


class JudgementMessage(Message):
    """What the judges together believe now. `certainty_bits` is the entropy of `p`: 0 is certain.

    `unlearned` is the probability that what is done is no movement of the vocabulary, left out when no judge says it;
    `p` is then given that it is one. `facets` are those that some judge says, pooled; `facing` among them is which way
    the person faces, by K directions, and `facing_deg` that in degrees to the left of where recordings face the Door.
    `movement` is left out while the person rests; another fusion service goes on from it when this one dies. `epoch` is
    one higher than that of the fusion service before: of two services that publish, the one with the lower epoch
    stops. `session` is random per process; two processes of one id differ in it.

    While no vote is counted or stale, `label` is empty, `agreement` is 0 of 0, and `p` is the prior.
    """

    scene: Identifier
    fusion: Identifier
    seq: NonNegativeInt
    at_ns: NonNegativeInt
    vocabulary: VocabularyReference
    p: list[float]
    label: str
    certainty_bits: float
    rule: str
    votes: dict[str, Vote]
    agreement: Agreement
    unlearned: float | None = None
    facets: dict[str, list[float]] | None = None
    facing_deg: float | None = None
    movement: OngoingMovement | None = None
    epoch: NonNegativeInt | None = None
    session: str | None = None


class Contribution(BaseModel):
    """What one judge did to a verdict: the log odds of its label against the best other answer, less those without him.

    `nats` below 0: he held against it. `stands`: without him the label would still be the likeliest.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")
    nats: float
    stands: bool


class VerdictMessage(JudgementMessage):
    """What was done: one per movement, said again under the same `id` when its end is known.

    `p`, `votes` and `agreement` are what it rests on: those at `decided_ns`, also when it is said again; those of an
    abstention are from when the movement ended. `contributions` are of the judges that were heard; for an abstention to
    what was likeliest then. `facets` are those of the end, once it is known.
    """

    id: str
    began_ns: NonNegativeInt
    decided_ns: NonNegativeInt
    ended_ns: NonNegativeInt | None = None
    contributions: dict[str, Contribution] | None = None


class ObserverStatistics(BaseModel):
    """What a fusion service has noticed of one observer: clock skew, and per reason how many messages were not used."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    skew_s: float | None = None
    rejected: dict[str, NonNegativeInt] = Field(default_factory=dict)


class StatusMessage(Message):
    """How a process is, beyond being reachable. `at_ns` is its clock when it says so: who asks learns its skew.

    `observers` is what a fusion service has noticed of its observers, those included that are not of the scene.
    """

    scene: Identifier
    id: Identifier
    state: ProcessState
    reason: str = ""
    rate_hz: float | None = None
    last_frame_ns: int | None = None
    skew_s: float | None = None
    version: str = ""
    at_ns: NonNegativeInt | None = None
    observers: dict[str, ObserverStatistics] | None = None


class VocabularyMessage(Message):
    """The names of the movements, in the order of every `p`."""

    scene: Identifier
    name: str
    hash: str
    labels: list[str]
