"""Messages to bytes and back: the only file that knows MessagePack (docs/reference/wire.md). Pure.

1. A message is one map with string keys. A field that is None is omitted, except a verdict's `ended_ns`, which is null
   while the movement goes on, and the fields of a vote that is not short.
2. Decoding any bytes gives a checked message or raises BadMessage, and nothing else.
3. The size is checked before anything is decoded, and no message is sent that a receiver would reject for its size:
   `encode` leaves out optional detail until it fits.
"""

from typing import Any, Literal, TypeVar

import msgpack
import msgspec
from pydantic import ValidationError

from common.errors import LabanmeshError
from common.keys import observer_of, scene_of
from common.message_types import MessagePart, printable
from common.messages import (
    AnyMessage,
    JudgementMessage,
    Message,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
)
from common.posterior import NotADistribution, NotFinite
from common.vocabulary import Vocabulary

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
SENT_AS_NULL = frozenset({"ended_ns"})
"""Fields whose None is information (the movement has not ended) and is sent as null."""
SHORT_VOTE_OPTIONAL = (
    "rest", "skew_s", "unlearned", "reliability", "rest_reliability", "label_reliability", "root_p", "repetitions",
)  # fmt: skip
"""The fields that a short vote has unless they are null; five others it always has."""
SELDOM_SENT = (
    "rest_reliability", "label_reliability", "freshness", "repetitions", "repeated", "shortest_s", "rest_s", "period_s",
)  # fmt: skip
"""Fields of a full vote, and of a movement's durations, that are left out where they are null."""
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
        # The names of fields are a peer's own, and could hold control sequences for a terminal.
        self.detail = printable(" ".join(detail.split())[:DETAIL_LIMIT])
        super().__init__(f"{reason}: {self.detail}")


def encode(message: AnyMessage, full: bool = False) -> bytes:
    """The message as one MessagePack map of at most SIZE_LIMIT bytes; posteriors in single precision.

    A judgement whose votes have `root_p` is short, with less in each vote and in single precision, unless it is to have
    `full` votes. A message that is too long loses OPTIONAL_DETAIL until it fits; LabanmeshError if it never does.
    """
    short = not full and is_short(message)
    # Single precision is more precise than any camera.
    single = short or isinstance(message, PosteriorMessage)
    fields = _fields_of(message, short)
    packed = _packed(fields, single)
    if len(packed) > SIZE_LIMIT:
        packed = _packed_to_fit(fields, single)
    if len(packed) > SIZE_LIMIT:
        raise LabanmeshError(
            f"{type(message).__name__}: {len(packed)} bytes without optional detail, a message holds {SIZE_LIMIT}; "
            "use fewer observers or movements"
        )
    return packed


def size_of(message: AnyMessage) -> int:
    """Bytes of the message with all detail, however many those are; in double precision."""
    return len(_packed(_fields_of(message), single=False))


def encode_vocabulary(scene: str, vocabulary: Vocabulary, fusion: str | None = None) -> bytes:
    """The labels of the movements, for peers that know only the hash; `fusion`, or an observer, answers with it."""
    return encode(VocabularyMessage.of(scene, vocabulary, fusion))


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
        raise BadMessage("wrong_key", f"{' in '.join(filter(None, claimed))} under {key}")
    return message


def _fields_of(message: AnyMessage, short: bool = False) -> dict[str, Any]:
    """What is sent of `message`; its parts are still objects. short: a judgement with short votes."""
    if isinstance(message, PosteriorMessage):
        # The most frequent message: fields with their default value are omitted too.
        fields: dict[str, Any] = msgspec.to_builtins(message, enc_hook=_part_of)
        return fields
    values = vars(message)
    fields = {name: value for name, value in values.items() if value is not None or name in SENT_AS_NULL}
    if not fields.get("movements", True):
        del fields["movements"]
    if short:
        fields["votes"] = {observer: _short_vote(vars(vote)) for observer, vote in values["votes"].items()}
        if values["movement"] is not None:
            movement = vars(values["movement"]).items()
            fields["movement"] = {name: value for name, value in movement if value is not None}
        # As maps they are packed without a call of `_part_of`.
        fields["vocabulary"], fields["agreement"] = vars(values["vocabulary"]), vars(values["agreement"])
    return fields


def _short_vote(values: dict[str, Any]) -> dict[str, Any]:
    # By name and not in a loop: with four observers this is a quarter of what a judgement costs to encode.
    fields = {
        "label": values["label"],
        "entropy": values["entropy"],
        "weight": values["weight"],
        "age_s": values["age_s"],
        "state": values["state"],
    }
    for name in SHORT_VOTE_OPTIONAL:
        value = values[name]
        if value is not None:
            fields[name] = value
    # Beside `root_p` no reliability is full reliability.
    if values["root_p"] is not None and values["reliability"] == 1.0:
        del fields["reliability"]
    return fields


def is_short(message: AnyMessage) -> bool:
    """Whether it is a judgement whose votes have `root_p`."""
    # A verdict, one per movement, has full votes.
    if not isinstance(message, JudgementMessage) or isinstance(message, VerdictMessage):
        return False
    return any(vote.root_p is not None for vote in message.votes.values())


def _part_of(part: MessagePart) -> dict[str, Any]:
    """All fields of a part of a message, null or not, but for `root_p` and those that are seldom sent."""
    values = vars(part).items()
    return {name: value for name, value in values if name != "root_p" and not (value is None and name in SELDOM_SENT)}


def _leave_out(fields: dict[str, Any], detail: tuple[str, ...]) -> bool:
    """Remove a detail from `fields`; whether it was there. A vote keeps it as null, unless it is seldom sent."""
    name, *inner = detail
    if not inner:
        return fields.pop(name, None) is not None
    parts = [part for part in fields.get(name, {}).values() if part.get(inner[0]) is not None]
    for part in parts:
        part[inner[0]] = None
        if inner[0] in SELDOM_SENT:
            del part[inner[0]]
    return bool(parts)


def _packed(fields: dict[str, Any], single: bool) -> bytes:
    try:
        packed: bytes = msgpack.packb(fields, use_single_float=single, default=_part_of)
    except OverflowError:
        # A forged judgement that a standby service passes on may have any number.
        packed = msgpack.packb(fields, default=_part_of)
    return packed


def _packed_to_fit(fields: dict[str, Any], single: bool) -> bytes:
    """The message without as much of OPTIONAL_DETAIL as it takes to fit, or without all of it."""
    if "votes" in fields:
        votes = fields["votes"].items()
        fields["votes"] = {observer: vote if isinstance(vote, dict) else _part_of(vote) for observer, vote in votes}
    for detail in OPTIONAL_DETAIL:
        if _leave_out(fields, detail) and len(packed := _packed(fields, single)) <= SIZE_LIMIT:
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
