"""Messages to bytes and back: the only file that knows MessagePack (docs/reference/wire.md).

1. Every message is one map with string keys; a field that says nothing (None) is left out, but a verdict's open
   end is said as null, as the contract has it.
2. Whatever bytes come in, the answer is a checked message or BadMessage, never anything else.
3. The size is looked at before anything is unpacked, so that a peer cannot make us build what it never sent.
"""

from typing import Any, Literal, TypeVar

import msgpack
from pydantic import ValidationError

from common.errors import LabanmeshError
from common.messages import Message, PosteriorMessage, VocabularyMessage
from common.vocabulary import Vocabulary

SIZE_LIMIT = 64 * 1024
"""Bytes; a posterior over 1000 movements takes 9 kB, a judgement of seven such judges 73 kB less their `p`."""
DETAIL_LIMIT = 200
"""Characters of a peer's fault that are worth a log line."""
SAID_AS_NULL = frozenset({"ended_ns"})
"""Fields whose None is a statement (the movement has not ended) and travels as null."""

Reason = Literal[
    "too_large", "not_msgpack", "not_a_map", "wrong_version", "not_finite", "not_a_distribution", "malformed"
]
M = TypeVar("M", bound=Message)


class BadMessage(LabanmeshError):  # noqa: N818 - like BadInput: it names whose fault it is
    """What a peer sent cannot be used. `reason` is from a small fixed set, for counting; `detail` is for people."""

    def __init__(self, reason: Reason, detail: str) -> None:
        self.reason: Reason = reason
        self.detail = " ".join(detail.split())[:DETAIL_LIMIT]
        super().__init__(f"{reason}: {self.detail}")


def encode(message: Message) -> bytes:
    """The message as one MessagePack map, in the order of its fields; the most frequent one as small as it can be."""
    if isinstance(message, PosteriorMessage):
        # Single precision loses what no camera has seen; what is as it is when left out is left out.
        small: bytes = msgpack.packb(
            {"v": message.v, **message.model_dump(exclude_defaults=True)}, use_single_float=True
        )
        return small
    fields = {key: value for key, value in message.model_dump().items() if value is not None or key in SAID_AS_NULL}
    packed: bytes = msgpack.packb(fields)
    return packed


def encode_vocabulary(scene: str, vocabulary: Vocabulary) -> bytes:
    """The names of the movements, for those who know only the hash; said by observers and fusion alike."""
    labels = list(vocabulary.labels)
    return encode(VocabularyMessage(scene=scene, name=vocabulary.name, hash=vocabulary.digest, labels=labels))


def decode(kind: type[M], payload: bytes, size_limit: int = SIZE_LIMIT) -> M:
    """The checked message of type `kind`; raises BadMessage, and nothing else, for any bytes that are none."""
    if len(payload) > size_limit:
        raise BadMessage("too_large", f"more than {size_limit} bytes")
    fields = _unpack(payload)
    version = fields.get("v")
    if type(version) is not int or version not in kind.VERSIONS:
        raise BadMessage(
            "wrong_version", f"v = {version!r}; this side speaks v = {' and '.join(map(str, kind.VERSIONS))}"
        )
    try:
        return kind.model_validate(fields, strict=True)
    except ValidationError as error:
        raise _fault(error) from None


def _unpack(payload: bytes) -> dict[str, Any]:
    size = len(payload)
    try:
        # No part may claim more than the payload holds; extension types have no place in the schema.
        fields = msgpack.unpackb(payload, max_str_len=size, max_array_len=size, max_map_len=size, max_ext_len=0)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise BadMessage("not_msgpack", f"{type(error).__name__}: {error}") from None
    if not isinstance(fields, dict):
        raise BadMessage("not_a_map", f"a {type(fields).__name__}; a message is a map with string keys")
    if not all(isinstance(key, str) for key in fields):
        raise BadMessage("not_a_map", "a key that is no string; a message is a map with string keys")
    return fields


def _fault(error: ValidationError) -> BadMessage:
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
