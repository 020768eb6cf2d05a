"""The messages of the mesh, checked where they come in (docs/wire.md).

Every message is a map with string keys and carries `v`, its schema version. Unknown extra fields are
ignored, so that a newer peer may say more. Times are Unix epoch in nanoseconds; ages in seconds.
"""

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeInt, model_validator

SCHEMA_VERSION: Final = 1
SUM_TOLERANCE = 1e-3
"""A posterior may miss a sum of 1 by this much: what float32 arithmetic of a foreign judge can lose."""

Identifier = Annotated[str, Field(pattern=r"^[a-z0-9_-]{1,64}$")]
Share = Annotated[FiniteFloat, Field(ge=0, le=1)]
VoteState = Literal["counted", "stale", "late", "silent", "foreign", "invalid"]
ProcessState = Literal["starting", "running", "degraded", "stopping", "failed"]
ABSTAIN = "abstain"
"""The label of a verdict when something was done and the judges could not agree what."""


class Message(BaseModel):
    """What all messages share: the schema version, and that they are never changed after they were made."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    v: Literal[1] = SCHEMA_VERSION


class VocabularyReference(BaseModel):
    """Which vocabulary a probability vector is in: a name for people and a hash that decides."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    name: str
    hash: str


class PosteriorMessage(Message):
    """What one observer believes: `p` over the vocabulary's movements, cumulative since the movement began."""

    scene: Identifier
    observer: Identifier
    seq: NonNegativeInt
    session: str
    captured_ns: NonNegativeInt
    sent_ns: NonNegativeInt
    vocabulary: VocabularyReference
    p: list[Share] = Field(min_length=2, max_length=10_000)
    prior: list[Share] | None = None
    rest: Share | None = None
    frames: NonNegativeInt
    visible: dict[str, bool] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _is_distribution(self) -> "PosteriorMessage":
        for name, values in (("p", self.p), ("prior", self.prior)):
            if values is not None and abs(sum(values) - 1) > SUM_TOLERANCE:
                raise ValueError(f"{name} sums to {sum(values):.6g}, not to 1")
        if self.prior is not None and len(self.prior) != len(self.p):
            raise ValueError(f"prior has {len(self.prior)} entries, p has {len(self.p)}")
        return self


class Vote(BaseModel):
    """One judge's flag: label, entropy (bits), weight, age; null while the judge has said nothing usable.

    `label` is null too while the judge believes no more of one movement than of another. `rest` is the judge's chance
    that the person rests. `skew_s` is how far his clock is ahead of the fusion machine's; `age_s` is corrected by it.
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


class Agreement(BaseModel):
    """How many of the judges who are heard (counted or stale) hold the fused label: k of n."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    k: NonNegativeInt
    n: NonNegativeInt


class Movement(BaseModel):
    """The movement that is being judged: its verdict's id, when it began, and what was decided of it so far."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    id: str
    began_ns: NonNegativeInt
    label: str | None = None
    decided_ns: NonNegativeInt | None = None


class JudgementMessage(Message):
    """What the judges together believe now. `certainty_bits` is the entropy of `p`: 0 is certain.

    `movement` is left out while the person rests; another fusion service goes on from it when this one dies.
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
    movement: Movement | None = None


class VerdictMessage(JudgementMessage):
    """What was done: one per movement, said again under the same `id` when its end is known.

    `p`, `votes` and `agreement` are what it rests on: those at `decided_ns`, also when it is said again; those of an
    abstention are from when the movement ended.
    """

    id: str
    began_ns: NonNegativeInt
    decided_ns: NonNegativeInt
    ended_ns: NonNegativeInt | None = None


class Account(BaseModel):
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
    observers: dict[str, Account] | None = None


class VocabularyMessage(Message):
    """The names of the movements, in the order of every `p`."""

    scene: Identifier
    name: str
    hash: str
    labels: list[str]
