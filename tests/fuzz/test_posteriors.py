"""Posteriors are accepted and refused as a plain reading of docs/reference/wire.md does, field by field. LABANMESH_FUZZ
and LABANMESH_FUZZ_SEED: as in test_fuzz.py."""

import math
import os
import random
import re
import struct

import msgpack
import pytest
from fuzz_mutator import KEY, NOON_NS, Mutator, posterior

from common.facets import FACETS, SHAPE
from common.message_types import printable
from common.messages import PosteriorMessage
from common.wire import BadMessage, decode_from, encode

MESSAGES = int(os.environ.get("LABANMESH_FUZZ", "10000")) // 3
SEED = int(os.environ.get("LABANMESH_FUZZ_SEED", "0"))
CAM1 = KEY.format("cam1")
STRANGE = (0.0, -0.0, 1e-9, 1.0, 1.0000005, 1.1, -1e-7, -0.5, 1e-42, math.nan, math.inf, -math.inf)
NEEDED = {"v", "seq", "session", "captured_ns", "sent_ns", "vocabulary", "p", "frames"}
ABSENT = dict.fromkeys(("scene", "observer", "prior", "rest", "unlearned", "facing", "facets", "repetitions"))


def is_text(value, most=128):
    return isinstance(value, str) and len(value) <= most and not re.search("[\udc80-\udcff]", value)


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_name(value):
    return value is None or (isinstance(value, str) and bool(re.fullmatch(r"[a-z0-9_-]{1,64}", value)))


def is_integer(value):
    return type(value) is int and 0 <= value < 2**63


def clamped(value):
    return min(max(float(value), 0.0), 1.0) + 0.0


def is_probability(value):
    return value is None or (is_number(value) and -1e-6 <= value <= 1 + 1e-6)


def is_distribution(values, least=1, most=10_000):
    return (
        isinstance(values, list)
        and least <= len(values) <= most
        and all(is_number(value) and is_probability(value) for value in values)
        and abs(sum(map(clamped, values)) - 1) <= 1e-3
    )


def are_facets(facets):
    return facets is None or (
        isinstance(facets, dict)
        and len(facets) <= 32
        and all(is_name(name) and is_distribution(values, most=72) for name, values in facets.items())
        and all(len(values) == len(FACETS.get(name, values)) for name, values in facets.items())
    )


def is_facing(facing, size):
    if facing is None:
        return True
    rows = facing.get("surprise") if isinstance(facing, dict) else None
    return (
        isinstance(rows, list)
        and len(rows) == size
        and all(isinstance(row, list) and 1 <= len(row) <= 72 and len(row) == len(rows[0]) for row in rows)
        and all(type(value) is int and 0 <= value <= 255 for row in rows for value in row)
    )


def expected(payload):
    """The fields of the message in `payload`, or None if it is to be refused."""
    try:
        # A field that is not known may have any name.
        fields = msgpack.unpackb(payload, unicode_errors="surrogateescape")
    except Exception:  # noqa: BLE001 - whatever msgpack does not read
        return None
    if not isinstance(fields, dict) or not all(isinstance(name, str) for name in fields) or not fields.keys() >= NEEDED:
        return None
    fields, vocabulary = {**ABSENT, "visible": {}, **fields}, fields["vocabulary"]
    is_good = (
        type(fields["v"]) is int and fields["v"] in (1, 2)
        and is_name(fields["scene"]) and is_name(fields["observer"])
        and (fields["v"] == 2 or None not in (fields["scene"], fields["observer"]))
        and (fields["scene"] or "dojo", fields["observer"] or "cam1") == ("dojo", "cam1")
        and all(is_integer(fields[name]) for name in ("seq", "captured_ns", "sent_ns", "frames"))
        and is_text(fields["session"])
        and isinstance(vocabulary, dict) and is_text(vocabulary.get("hash"))
        and is_text(vocabulary.get("name", ""), 10**6) and all(isinstance(name, str) for name in vocabulary)
        and is_distribution(fields["p"], 2)
        and (fields["prior"] is None or (is_distribution(fields["prior"])
             and len(fields["prior"]) == len(fields["p"])))
        and is_probability(fields["rest"]) and is_probability(fields["unlearned"])
        and isinstance(fields["visible"], dict) and len(fields["visible"]) <= 256
        and all(is_text(part, 10**6) and isinstance(seen, bool) for part, seen in fields["visible"].items())
        and is_facing(fields["facing"], len(fields["p"])) and are_facets(fields["facets"])
        and (fields["repetitions"] is None or (is_number(fields["repetitions"])
             and 0 <= fields["repetitions"] < math.inf))
    )  # fmt: skip
    return fields if is_good else None


def read(payload):
    """The message, or the reason why there is none."""
    try:
        return decode_from(CAM1, PosteriorMessage, payload)
    except BadMessage as bad:
        assert bad.detail.isprintable()
        return bad.reason


def has_field_twice(payload):
    """Whether a map has a field twice: MessagePack keeps the last one, our reader may refuse the message for either."""
    maps = []
    msgpack.unpackb(payload, unicode_errors="surrogateescape", object_pairs_hook=lambda pairs: maps.append(pairs) or 0)
    return any(len({name for name, _ in pairs}) < len(pairs) for pairs in maps)


def check(payload):
    """Compare both; returns the reason for which the message was refused, if it was."""
    message, fields = read(payload), expected(payload)
    if fields is None or (isinstance(message, str) and has_field_twice(payload)):
        assert isinstance(message, str), payload
        return message
    assert isinstance(message, PosteriorMessage), (message, payload)
    assert repr(message.p) == repr([*map(clamped, fields["p"])])
    for name in ("rest", "unlearned"):
        assert repr(getattr(message, name)) == repr(None if fields[name] is None else clamped(fields[name]))
    for name in ("v", "scene", "observer", "seq", "captured_ns", "sent_ns", "frames", "visible"):
        assert getattr(message, name) == fields[name]
    assert message.session == printable(fields["session"])
    assert message.vocabulary.hash == printable(fields["vocabulary"]["hash"])
    facets = fields["facets"] and {name: [*map(clamped, values)] for name, values in fields["facets"].items()}
    assert repr(message.facets) == repr(facets)
    assert (message.facing and message.facing.surprise) == (fields["facing"] and fields["facing"]["surprise"])
    return ""


def tampered(rng, payload):
    """One number of the message replaced by a strange one, its size and that of the message unchanged."""
    at = rng.choice([place for place, byte in enumerate(payload[:-8]) if byte in (0xCA, 0xCF, 0xCD, 0xCC)])
    value = {
        0xCA: lambda: struct.pack(">f", rng.choice(STRANGE)),
        0xCF: lambda: rng.choice((0, 1, 2**63 - 1, 2**63, 2**64 - 1)).to_bytes(8),
        0xCD: lambda: rng.randrange(2**16).to_bytes(2),
        0xCC: lambda: rng.randrange(2**8).to_bytes(1),
    }[payload[at]]()
    return payload[: at + 1] + value + payload[at + 1 + len(value) :]


def test_streams_of_good_and_bad_messages_are_read_as_the_contract_says():
    rng, mutator, reasons = random.Random(SEED), Mutator(SEED + 2), set()  # noqa: S311
    for n in range(MESSAGES):
        payload = encode(posterior(rng, "cam1", n, NOON_NS + n))
        if n % 4 == 1:
            payload = mutator.next(payload)
        elif n % 4 == 3:
            payload = tampered(rng, payload)
        reasons.add(check(payload))
    assert {"", "not_finite", "not_a_distribution", "malformed", "wrong_version"} <= reasons


@pytest.mark.parametrize("strange", [0, 1, "x", None, [0.5], {}, b"", 2**64 - 1, 0.5, True])
@pytest.mark.parametrize("name", sorted({*NEEDED, *ABSENT, "visible"}))
def test_a_value_of_another_type_is_refused_as_the_contract_says(name, strange):
    fields = msgpack.unpackb(encode(posterior(random.Random(SEED))))  # noqa: S311
    check(msgpack.packb({**fields, name: strange}))
    if isinstance(fields.get(name), list):
        check(msgpack.packb({**fields, name: [*fields[name][:-1], strange]}))


@pytest.mark.parametrize(
    "facets",
    [
        {**{name: [0.25, 0.25, 0.5] for name in SHAPE}, "p": [0.5, 0.5], "seq": [1.0]},
        {"own": [0.01] * 100}, {"own": [1 / 64] * 64}, {"own": [0.9, 0.05]}, {}, {"own": []}, {"a\n": [1.0]},
        {"shape_vertical": [0.5, 0.5]}, {"own": [1.0000005, -0.0000005]}, {"own": [math.nan, 1.0]},
    ],
)  # fmt: skip
def test_facets_are_read_as_the_contract_says_whatever_they_are_called(facets):
    fields = msgpack.unpackb(encode(posterior(random.Random(SEED))))  # noqa: S311
    check(msgpack.packb({**fields, "facets": facets}))


def test_zeros_have_no_sign_and_many_movements_are_read():
    fields = msgpack.unpackb(encode(posterior(random.Random(SEED))))  # noqa: S311
    for p in ([1.0, 0.5, -0.0, -0.5], [1.0, -0.0, 0.0, 0.0], [0.0, -0.0, 0.0, 1.0], [1 / 5000] * 5000):
        check(msgpack.packb({**fields, "facing": None, "p": p, "rest": -0.0}))
