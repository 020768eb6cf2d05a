"""Messages to bytes and back: the only file that knows MessagePack (docs/reference/wire.md). Pure.

1. A message is one map with string keys. A field that is None is omitted, except a verdict's `ended_ns`, which is null
   while the movement goes on, and the fields of a vote that is not short.
2. Decoding any bytes gives a checked message or raises BadMessage, and nothing else.
3. The size is checked before anything is decoded, and no message is sent that a receiver would reject for its size:
   `encode` leaves out optional detail until it fits.
"""

from typing import TYPE_CHECKING, Any, Literal, TypeVar

import msgpack
import msgspec
from pydantic import ValidationError

from common.errors import BadInput, LabanmeshError
from common.keys import observer_of, scene_of
from common.message_fields import fields_of, is_short, leave_out, part_of
from common.message_types import LAST_INTEGER
from common.messages import (
    Agreement,
    AnyMessage,
    JudgementMessage,
    Message,
    OngoingMovement,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.posterior import NotADistribution, NotFinite
from common.text import plural
from common.vocabulary import ABSTAIN, Vocabulary

if TYPE_CHECKING:
    from common.config import Scene

SIZE_LIMIT = 64 * 1024
"""Bytes that a receiver accepts; `encode` makes none longer."""
OPTIONAL_DETAIL = (
    ("votes", "root_p"),
    ("votes", "p"),
    ("votes", "facing"),
    ("votes", "doubles"),
    ("votes", "rest_reliability"),
    ("votes", "label_reliability"),
    ("votes", "facets"),
    ("contributions",),
    ("facing",),
    ("facets",),
    ("why",),
    ("votes", "repeated"),
    ("votes", "repetitions"),
    ("movements",),
    *(("leans_on",), ("observers",), ("remarks",), ("scores",), ("score",), ("unscored",)),
)
"""What `encode` leaves out of a message that is too long, in this order, until it fits."""
DETAIL_LIMIT = 200
"""Characters of a decoding error that are worth a log line."""
Reason = Literal[
    "too_large", "not_msgpack", "not_a_map", "wrong_version", "not_finite", "not_a_distribution", "malformed",
    "wrong_key", "foreign_vocabulary", "wrong_length",
]  # fmt: skip
M = TypeVar("M", bound=AnyMessage)
_POSTERIOR = msgspec.msgpack.Decoder(PosteriorMessage)


class BadMessage(LabanmeshError):  # noqa: N818 - like BadInput: it names whose fault it is
    """A peer sent something unusable. `reason` is from a small fixed set, for counting; `detail` is for people."""

    def __init__(self, reason: Reason, detail: str) -> None:
        self.reason: Reason = reason
        line = " ".join(detail.split())[:DETAIL_LIMIT]
        # The names of fields are a peer's own, and could hold control sequences for a terminal.
        self.detail = "".join(each if each.isprintable() else "?" for each in line)
        super().__init__(f"{reason}: {self.detail}")


def encode(message: AnyMessage, full: bool = False) -> bytes:
    """The message as one MessagePack map of at most SIZE_LIMIT bytes; posteriors in single precision.

    A judgement whose votes have `root_p` is short, with less in each vote and in single precision, unless it is to have
    `full` votes. A message that is too long loses OPTIONAL_DETAIL until it fits; LabanmeshError if it never does.
    """
    short = not full and is_short(message)
    # Single precision is more precise than any camera.
    single = short or isinstance(message, PosteriorMessage)
    fields = fields_of(message, short)
    packed = _packed(fields, single)
    if len(packed) > SIZE_LIMIT:
        packed = _packed_to_fit(fields, single)
    if len(packed) > SIZE_LIMIT:
        raise LabanmeshError(
            f"{type(message).__name__}: {len(packed)} bytes without optional detail, a message holds {SIZE_LIMIT}; "
            "use fewer observers or movements"
        )
    return packed


def encode_vocabulary(scene: str, vocabulary: Vocabulary, fusion: str | None = None) -> bytes:
    """The labels of the movements, for peers that know only the hash; `fusion`, or an observer, answers with it."""
    return encode(_vocabulary_message(scene, vocabulary, fusion))


def decode(kind: type[M], payload: bytes) -> M:
    """The checked message of type `kind`; raises BadMessage, and nothing else, for any other bytes."""
    if issubclass(kind, PosteriorMessage):
        return _decoded_posterior(payload)  # type: ignore[return-value]
    return _checked(kind, unpack(payload))  # type: ignore[return-value]


def decode_from(key: str, kind: type[M], payload: bytes) -> M:
    """Same as `decode`, for a message that arrived under `key`: the scene and process that it names must be the key's.

    Access rules protect keys and not fields, so a process is identified by its key. Raises BadMessage.
    """
    message = decode(kind, payload)
    if isinstance(message, PosteriorMessage):
        if message.scene is message.observer is None:
            return message
        claimed = message.observer, message.scene
        agrees = message.is_of(scene_of(key), observer_of(key))
    elif isinstance(message, StatusMessage):
        claimed = message.id, message.scene
        agrees = claimed == (observer_of(key), scene_of(key))
    else:
        claimed = "", getattr(message, "scene", "")
        agrees = claimed[1] == key.rsplit("/", 2)[-2]
    if not agrees:
        raise _wrong_key(*claimed, key)
    return message


def check_vocabulary(message: JudgementMessage, vocabulary: Vocabulary) -> None:
    """Raises BadMessage unless a judgement or verdict is entirely in `vocabulary`: its hash, lengths and labels."""
    if message.vocabulary.hash != vocabulary.digest:
        raise BadMessage("foreign_vocabulary", f"hash {message.vocabulary.hash}, this scene's is {vocabulary.digest}")
    for p in (message.p, *(vote.p for vote in message.votes.values())):
        if p is not None and len(p) != vocabulary.size:
            raise BadMessage("wrong_length", f"{len(p)} probabilities for {vocabulary.size} movements")
    labels = {message.label, *(vote.label for vote in message.votes.values())}
    if message.movement is not None:
        labels |= {message.movement.label, message.movement.revises}
    if isinstance(message, VerdictMessage):
        labels.add(message.revises)
    # While no vote counts, a judgement has an empty label.
    unknown = labels - {*vocabulary.labels, ABSTAIN, "", None}
    if unknown:
        raise BadMessage("malformed", f"label {min(map(str, unknown))!r} is not in the vocabulary")


def largest_judgement(scene: str, observers: tuple[str, ...], vocabulary: Vocabulary, rule: str) -> int:
    """Upper bound in bytes of a judgement or verdict without OPTIONAL_DETAIL, for these observers and movements."""
    label = max(vocabulary.labels, key=len)
    vote = Vote(
        label=label, entropy=1.0, weight=1.0, age_s=1.0, state="counted", rest=1.0, skew_s=1.0, unlearned=1.0,
        reliability=1.0,
    )  # fmt: skip
    longest_id, movement_id, last = "x" * 64, "m" * 128, LAST_INTEGER
    movement = OngoingMovement(
        id=movement_id, began_ns=last, label=label, decided_ns=last, revises=label, outage_ns=last
    )  # fmt: skip
    verdict = VerdictMessage(
        scene=scene, fusion=longest_id, seq=last, at_ns=last, p=[1.0] * vocabulary.size, label=label,
        vocabulary=VocabularyReference(name=vocabulary.name, hash=vocabulary.digest), certainty_bits=1.0, rule=rule,
        votes=dict.fromkeys(observers, vote), agreement=Agreement(k=last, n=last), unlearned=1.0, facing_deg=1.0,
        movement=movement, epoch=last, session=longest_id, id=movement_id, began_ns=last, decided_ns=last,
        ended_ns=last, revises=label,
    )  # fmt: skip
    return len(_packed(fields_of(verdict), single=False))


def require_fits(scene: "Scene", vocabulary: Vocabulary | None = None) -> None:
    """Raises BadInput, one line, if messages of `scene` cannot fit into SIZE_LIMIT even without optional detail.

    vocabulary: the scene's own if None; a scene that names none is checked for its observers alone.
    """
    known = vocabulary or scene.named_vocabulary
    checked = known or Vocabulary(("a", "b"))
    size = largest_judgement(scene.scene, scene.roster, checked, scene.fusion.rule)
    if size > SIZE_LIMIT:
        parts = [plural(len(scene.roster), "observer"), *([plural(checked.size, "movement")] if known else [])]
        raise BadInput(
            f"scene {scene.scene!r}: {' and '.join(parts)} make judgements of up to {size} bytes, a message holds "
            f"{SIZE_LIMIT}; use fewer of them or shorter names, or several scenes"
        )
    # Without the durations of movements, which are optional detail.
    names = Vocabulary(checked.labels, checked.name)
    size = len(_packed(fields_of(_vocabulary_message(scene.scene, names)), single=False))
    if size > SIZE_LIMIT:
        raise BadInput(
            f"scene {scene.scene!r}: the labels of {plural(checked.size, 'movement')} take {size} bytes, a message "
            f"holds {SIZE_LIMIT}; use fewer movements or shorter labels"
        )


def _vocabulary_message(scene: str, vocabulary: Vocabulary, fusion: str | None = None) -> VocabularyMessage:
    labels, movements = list(vocabulary.labels), dict(vocabulary.movements)
    return VocabularyMessage(
        scene=scene, name=vocabulary.name, hash=vocabulary.digest, labels=labels, movements=movements, fusion=fusion
    )


def _packed(fields: dict[str, Any], single: bool) -> bytes:
    try:
        packed: bytes = msgpack.packb(fields, use_single_float=single, default=part_of)
    except OverflowError:
        # A forged judgement that a standby service passes on may have any number.
        packed = msgpack.packb(fields, default=part_of)
    return packed


def _packed_to_fit(fields: dict[str, Any], single: bool) -> bytes:
    """The message without as much of OPTIONAL_DETAIL as it takes to fit, or without all of it."""
    if "votes" in fields:
        votes = fields["votes"].items()
        fields["votes"] = {observer: vote if isinstance(vote, dict) else part_of(vote) for observer, vote in votes}
    for detail in OPTIONAL_DETAIL:
        if leave_out(fields, detail) and len(packed := _packed(fields, single)) <= SIZE_LIMIT:
            return packed
    return _packed(fields, single)


def unpack(payload: bytes) -> dict[str, Any]:
    """The fields of a message that are not checked yet; raises BadMessage."""
    _require_size(payload)
    size = len(payload)
    try:
        # No part may claim more than the payload holds; the schema has no extension types.
        fields = msgpack.unpackb(payload, max_str_len=size, max_array_len=size, max_map_len=size, max_ext_len=0)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise BadMessage("not_msgpack", f"{type(error).__name__}: {error}") from None
    if not isinstance(fields, dict):
        raise BadMessage("not_a_map", f"a {type(fields).__name__}; a message is a map with string keys")
    # Keys are strings or bytes; this looks at them four times as fast as a loop.
    if not {*map(type, fields)} <= {str}:
        raise BadMessage("not_a_map", "a key that is not a string; a message is a map with string keys")
    return fields


def _require_size(payload: bytes) -> None:
    if len(payload) > SIZE_LIMIT:
        raise BadMessage("too_large", f"more than {SIZE_LIMIT} bytes")


def _checked(kind: type[Message], fields: dict[str, Any]) -> Message:
    """The message with these fields; raises BadMessage."""
    _require_version(kind, fields)
    try:
        # The same as `kind.model_validate`, without its wrapper.
        message: Message = kind.__pydantic_validator__.validate_python(fields, strict=True)
    except ValidationError as error:
        raise _bad_field(error) from None
    return message


def _require_version(kind: type[AnyMessage], fields: dict[str, Any]) -> None:
    version = fields.get("v")
    if type(version) is not int or version not in kind.VERSIONS:
        raise BadMessage(
            "wrong_version", f"v = {version!r}; this version reads v = {' and '.join(map(str, kind.VERSIONS))}"
        )


def _decoded_posterior(payload: bytes) -> PosteriorMessage:
    _require_size(payload)
    try:
        return _POSTERIOR.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _bad_posterior(payload, error) from None


def _bad_posterior(payload: bytes, error: Exception) -> BadMessage:
    # What is no message, or of another version, is reported as for all kinds.
    _require_version(PosteriorMessage, unpack(payload))
    reasons: dict[type, Reason] = {NotFinite: "not_finite", NotADistribution: "not_a_distribution"}
    return BadMessage(reasons.get(type(error.__cause__), "malformed"), str(error).replace("$.", ""))


def _wrong_key(process: str | None, scene: str | None, key: str) -> BadMessage:
    """For a message that names another process or scene than its key."""
    return BadMessage("wrong_key", f"{' in '.join(filter(None, (process, scene)))} under {key}")


def _bad_field(error: ValidationError) -> BadMessage:
    first = error.errors(include_url=False, include_context=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    return BadMessage(_reason(first["type"], first["loc"], first["msg"]), f"{where}: {first['msg']}".removeprefix(": "))


def _reason(kind: str, where: tuple[int | str, ...], text: str) -> Reason:
    if kind == "finite_number":
        return "not_finite"
    outside = where[:1] in (("p",), ("prior",)) and kind in ("greater_than_equal", "less_than_equal")
    if outside or "sums to" in text:
        return "not_a_distribution"
    return "malformed"
