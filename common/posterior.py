"""The posterior of one observer, the most frequent message: its fields and checks (docs/reference/wire.md). Pure.

msgspec decodes it in less than half of pydantic's time. Types, lengths and integers are checked where bytes are
decoded; probabilities wherever a posterior is made. Round-off is no error: see `common.messages`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import force_setattr, replace

from common.facets import FACETS
from common.floor_place import FloorPlace as FloorPlace
from common.message_types import (
    ID_LIMIT,
    LABEL_LIMIT,
    LABELS_LIMIT,
    LAST_INTEGER,
    PARTS_LIMIT,
    ROUND_OFF,
    SURPRISE_LIMIT,
    TEXT_LIMIT,
    printable,
    require_table,
)
from common.score import BEST_SCORE, REMARK_LIMIT, REMARKS_LIMIT, remark_words

SUM_TOLERANCE = 1e-3
"""A distribution may miss a sum of 1 by this much: more than float32 arithmetic of a foreign observer loses."""
FACETS_LIMIT = 32
"""Facets in one posterior; more are rejected, so that an observer cannot grow every judgement."""
VALUES_LIMIT = 72
"""Values of one facet: as many as there may be facings."""
FACET_NAME = re.compile(r"[a-z0-9_-]{1,64}\Z")
_RANGE = Meta(extra_json_schema={"minimum": 0, "maximum": 1})
# In Python $ also matches before a last line feed; JSON Schema has no \Z.
Identifier = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,64}(?![\s\S])")]
Id = Annotated[str, Meta(max_length=ID_LIMIT)]
Integer = Annotated[int, Meta(ge=0, le=LAST_INTEGER)]
Probability = Annotated[float, _RANGE]
Probabilities = list[Probability]
_Name = Annotated[str, Meta(max_length=LABEL_LIMIT)]
Surprise = Annotated[int, Meta(ge=0, le=SURPRISE_LIMIT)]


class NotADistribution(ValueError):  # noqa: N818 - it names what the values are not
    """Probabilities that do not sum to 1, or one outside 0 to 1."""


class NotFinite(ValueError):  # noqa: N818 - it names what a value is not
    """A NaN or an infinity."""


class VocabularyHash(Struct, frozen=True, kw_only=True, gc=False, omit_defaults=True):
    """The vocabulary of a probability vector: the hash identifies it; the name is for people and optional."""

    name: str = ""
    hash: Id

    def __post_init__(self) -> None:
        if not (self.hash + self.name).isprintable() or len(self.name) > TEXT_LIMIT:
            force_setattr(self, "hash", printable(self.hash))
            force_setattr(self, "name", printable(self.name[:TEXT_LIMIT]))


class Facing(Struct, frozen=True, kw_only=True, gc=False):
    """The direction that the person faces in the room's frame, given each movement: P(facing | movement).

    surprise: (M, K) integers from 0 to 255, -8 ln P(facing k | movement m) rounded (`common.probability` converts).
    Facing k is turned to the left by k * 360/K degrees from the direction in which recordings face the Door.
    """

    surprise: Annotated[list[list[Surprise]], Meta(min_length=2, max_length=LABELS_LIMIT)]

    def __post_init__(self) -> None:
        require_table(self.surprise)


class Repeated(Struct, frozen=True, kw_only=True, gc=False):
    """More about `repetitions`. partial: how many of them went less far than usual, in periods. swing: body sizes from
    one turning point to the next as the takes show it in this view; the more, the better the view can count."""

    partial: Annotated[float, Meta(ge=0)] = 0.0
    swing: Annotated[float, Meta(ge=0)] = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.partial) and math.isfinite(self.swing)):
            raise NotFinite("repeated has a value that is not finite")


class ObservedRemark(Struct, frozen=True, kw_only=True, gc=False):
    """What one observer remarks: a joint, the moment, 0 begin to 1 end, and by how many degrees it is too straight,
    or, below 0, too bent. strength: 1 is what is just worth a remark."""

    joint: _Name
    moment: Annotated[float, Meta(ge=0, le=1)]
    degrees: Annotated[float, Meta(ge=-360, le=360)]
    strength: Annotated[float, Meta(ge=0)] = 1.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.moment, self.degrees, self.strength))):
            raise ValueError("a remark has a value that is not finite")
        if not self.joint.isprintable():
            force_setattr(self, "joint", printable(self.joint))

    @property
    def words(self) -> str:
        """The remark as a line of text."""
        return remark_words(self.joint, self.degrees, self.moment)


class ObservedScore(Struct, frozen=True, kw_only=True, gc=False):
    """One observer's score of the movement that ended at `ended_ns`, 0 to 10, if it was `label`.

    certainty: share of the limbs that it saw, 0 to 1.
    """

    label: _Name
    ended_ns: Annotated[int, Meta(ge=0, le=LAST_INTEGER)]
    score: Annotated[float, Meta(ge=0, le=BEST_SCORE)]
    certainty: Annotated[float, Meta(ge=0, le=1)] = 1.0
    remarks: Annotated[list[ObservedRemark], Meta(max_length=REMARKS_LIMIT)] = []

    def __post_init__(self) -> None:
        if not (math.isfinite(self.score) and math.isfinite(self.certainty)):
            raise ValueError("score has a value that is not finite")
        if not self.label.isprintable():
            force_setattr(self, "label", printable(self.label))

    def shifted(self, by_ns: int) -> "ObservedScore":
        """The same by a clock that is so far ahead."""
        return replace(self, ended_ns=self.ended_ns + by_ns)


class Unscored(Struct, frozen=True, kw_only=True, gc=False):
    """Why one observer has no score of the movement that ended at `ended_ns`, if it was `label`."""

    label: _Name
    ended_ns: Annotated[int, Meta(ge=0, le=LAST_INTEGER)]
    reason: str

    def __post_init__(self) -> None:
        if not (self.label + self.reason).isprintable() or len(self.reason) > REMARK_LIMIT:
            force_setattr(self, "label", printable(self.label))
            force_setattr(self, "reason", printable(self.reason[:REMARK_LIMIT]))

    def shifted(self, by_ns: int) -> "Unscored":
        """The same by a clock that is so far ahead."""
        return replace(self, ended_ns=self.ended_ns + by_ns)


class PosteriorMessage(Struct, frozen=True, kw_only=True, gc=False, omit_defaults=True):
    """The posterior of one observer: `p` over the vocabulary's movements, cumulative since the movement began.

    `unlearned` is the probability that the person does none of the movements; an observer that cannot tell omits it.
    `repetitions`: periods of its likeliest label since the person began to move, if that label is periodic;
    `repeated` says more about them. `score`: how well the last movement that is over was done, if its label has
    reference takes; `unscored`: why it has no score. `person`: the track of the person whom it is about, where several
    are judged apart, an id of this session's; `place`: where that person is. In version 2 `scene` and `observer` may be
    omitted: the key carries them.

    Raises ValueError for what is no distribution.
    """

    VERSIONS: ClassVar[tuple[int, ...]] = (1, 2)  # those that can be decoded
    v: Literal[1, 2]
    scene: Identifier | None = None
    observer: Identifier | None = None
    seq: Integer
    session: Id
    captured_ns: Integer
    sent_ns: Integer
    vocabulary: VocabularyHash
    p: Annotated[Probabilities, Meta(min_length=2, max_length=LABELS_LIMIT)]
    prior: Probabilities | None = None
    rest: Probability | None = None
    unlearned: Probability | None = None
    frames: Integer
    visible: Annotated[dict[str, bool], Meta(max_length=PARTS_LIMIT)] = {}
    facing: Facing | None = None
    facets: dict[str, Probabilities] | None = None
    repetitions: Annotated[float, Meta(ge=0)] | None = None
    repeated: Repeated | None = None
    score: ObservedScore | None = None
    unscored: Unscored | None = None
    person: Identifier | None = None
    place: FloorPlace | None = None

    def __post_init__(self) -> None:
        if self.v == 1 and (self.scene is None or self.observer is None):
            raise ValueError("scene and observer may be omitted from version 2 on; this is version 1")
        if not self.session.isprintable():
            force_setattr(self, "session", printable(self.session))
        if (p := _distribution("p", self.p)) is not self.p:
            force_setattr(self, "p", p)
        for name, value in (("rest", self.rest), ("unlearned", self.unlearned)):
            if value is not None and not 0.0 < value <= 1.0:
                force_setattr(self, name, _in_range(name, value, ValueError))
        facets = self.facets
        if facets:
            check_facet_names(facets)
            for name, values in facets.items():
                if (p := _distribution(name, values, ValueError)) is not values:
                    facets = {**facets, name: p}
            if facets is not self.facets:
                force_setattr(self, "facets", facets)
        if self.prior is not None or self.facing is not None or self.repetitions is not None:
            self._check_seldom_sent()

    def _check_seldom_sent(self) -> None:
        prior, facing, size = self.prior, self.facing, len(self.p)
        if prior is not None:
            force_setattr(self, "prior", _distribution("prior", prior))
            if len(prior) != size:
                raise ValueError(f"prior has {len(prior)} entries, p has {size}")
        if facing is not None and len(facing.surprise) != size:
            raise ValueError(f"facing has {len(facing.surprise)} rows, p has {size} entries")
        if self.repetitions is not None and not math.isfinite(self.repetitions):
            raise NotFinite("repetitions is not finite")

    def with_fields(self, **fields: object) -> "PosteriorMessage":
        """The message with other values of some fields."""
        return replace(self, **fields)

    @classmethod
    def model_json_schema(cls) -> dict[str, object]:
        """Its JSON Schema, as the other messages have it."""
        from inspect import cleandoc

        schema = msgspec.json.schema(cls)
        for part in schema["$defs"].values():
            if "description" in part:
                # Some versions of msgspec leave the indentation of the docstring in it.
                part["description"] = cleandoc(part["description"])
        return schema

    def is_of(self, scene: str, observer: str) -> bool:
        """Whether the message's own `scene` and `observer`, where present, agree with those of its key."""
        return (self.scene or scene, self.observer or observer) == (scene, observer)


def _distribution(name: str, p: list[float], outside: type[ValueError] = NotADistribution) -> list[float]:
    """`p` without round-off; raises `outside` for a value out of range, NotADistribution unless it sums to 1."""
    # A NaN makes the sum one, and then no comparison holds.
    if p and (least := min(p)) >= 0.0 and max(p) <= 1.0 and abs(sum(p) - 1.0) <= SUM_TOLERANCE:
        # No number changes but -0.0, which becomes 0.0.
        return p if least > 0.0 else [value + 0.0 for value in p]
    clamped = [_in_range(name, value, outside) for value in p]
    require_sum(name, clamped)
    return clamped


def _in_range(name: str, value: float, outside: type[ValueError]) -> float:
    """A probability without round-off."""
    if not math.isfinite(value):
        raise NotFinite(f"{name} has a value that is not finite")
    if not -ROUND_OFF <= value <= 1.0 + ROUND_OFF:
        raise outside(f"{name} has the value {value:.6g}; a probability is 0 to 1")
    # max(-0.0, 0.0) may keep the sign; adding 0.0 clears it.
    return min(max(value, 0.0), 1.0) + 0.0


def check_facet_names(facets: Mapping[str, Sequence[float]]) -> None:
    """Check name -> values; raises ValueError that names the facet and the rule.

    There are at most FACETS_LIMIT facets of at most VALUES_LIMIT values, and a known facet has exactly its values.
    """
    if len(facets) > FACETS_LIMIT:
        raise ValueError(f"{len(facets)} facets; at most {FACETS_LIMIT} are allowed")
    for name, p in facets.items():
        known = FACETS.get(name)
        if known is not None:
            if len(p) != len(known):
                raise ValueError(f"facet {name} has {len(p)} values; it has {len(known)}: {', '.join(known)}")
        elif not FACET_NAME.match(name):
            raise ValueError(f"facet {name[:64]!r}: a name is 1 to 64 characters of a-z, 0-9, _ and -")
        elif len(p) > VALUES_LIMIT:
            raise ValueError(f"facet {name} has {len(p)} values; at most {VALUES_LIMIT} are allowed")


def require_sum(name: str, p: Sequence[float]) -> None:
    """Raises NotADistribution that names the distribution `name` unless `p` sums to 1 within SUM_TOLERANCE."""
    if not abs(sum(p) - 1) <= SUM_TOLERANCE:
        raise NotADistribution(f"{name} sums to {sum(p):.6g}, not to 1")
