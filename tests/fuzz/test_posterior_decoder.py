"""The decoder of one observer's posteriors accepts and refuses what the full check does, and reads the same.

LABANMESH_FUZZ and LABANMESH_FUZZ_SEED: as in test_fuzz.py.
"""

import math
import os
import random
import struct

import msgpack
import pytest
from fuzz_mutator import KEY, NOON_NS, Mutator, posterior

import common.posterior_decoder
from common.facets import SHAPE
from common.messages import PosteriorMessage
from common.posterior_decoder import PosteriorDecoder
from common.wire import BadMessage, decode_from, encode

MESSAGES = int(os.environ.get("LABANMESH_FUZZ", "10000")) // 3
SEED = int(os.environ.get("LABANMESH_FUZZ_SEED", "0"))
CAM1 = KEY.format("cam1")
SHAPES = ((1, 1, 6), (0, 3, 5), (8, 0, 0))
STRANGE = (0.0, -0.0, 1e-9, 1.0, 1.0000005, 1.1, -1e-7, -0.5, 1e-42, math.nan, math.inf, -math.inf)


def result(decode, payload):
    """The message as text, which shows the sign of a zero, and its given fields; or the reason."""
    try:
        message = decode(payload)
    except BadMessage as bad:
        return bad.reason, bad.detail
    return repr(message), message.model_fields_set


def whole(payload):
    return decode_from(CAM1, PosteriorMessage, payload)


def steady(rng, seq, **fields):
    """A posterior as most are: with Shape, without facing, with the same parts visible."""
    facets = {name: [p / 8 for p in rng.choice(SHAPES)] for name in SHAPE}
    update = {"facing": None, "facets": facets, "visible": {"head": True}, "unlearned": 0.125, **fields}
    return posterior(rng, "cam1", seq, NOON_NS + seq).model_copy(update=update)


@pytest.fixture
def full_checks(monkeypatch):
    """The payloads that are unpacked and checked in full."""
    seen, unpack = [], common.posterior_decoder.unpack

    def noting(payload):
        seen.append(payload)
        return unpack(payload)

    monkeypatch.setattr(common.posterior_decoder, "unpack", noting)
    return seen


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


def test_streams_of_good_and_bad_messages_are_decoded_as_by_the_full_check(full_checks):
    rng, mutator, decoder, reasons = random.Random(SEED), Mutator(SEED + 2), PosteriorDecoder(CAM1), set()  # noqa: S311
    for n in range(MESSAGES):
        message = posterior(rng, "cam1", n, NOON_NS + n) if n % 50 == 0 else steady(rng, n)
        payload = encode(message)
        if n % 4 == 1:
            payload = mutator.next(payload)
        elif n % 4 == 3:
            payload = tampered(rng, payload)
        ours = result(decoder.decode, payload)
        assert ours == result(whole, payload), payload
        reasons.add(ours[0][:20])
    assert {"not_finite", "not_a_distribution", "malformed", "wrong_version"} <= reasons
    assert len(full_checks) < 0.6 * MESSAGES


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("movements", [2, 15, 16, 256])
def test_a_message_that_differs_in_its_numbers_alone_is_not_checked_in_full(full_checks, single, movements):
    decoder, rng = PosteriorDecoder(CAM1), random.Random(SEED)  # noqa: S311
    for seq in (200, 201, 255):
        p = [rng.random() + 0.1 for _ in range(movements)]
        message = steady(rng, seq, p=[each / sum(p) for each in p], frames=seq)
        payload = msgpack.packb({"v": 1, **message.model_dump(exclude_defaults=True)}, use_single_float=single)
        assert result(decoder.decode, payload) == result(whole, payload)
    assert len(full_checks) == 1


@pytest.mark.parametrize("last", [2**7 - 1, 2**8 - 1, 2**16 - 1, 2**32 - 1, 2**63 - 1])
def test_wider_numbers_need_one_full_check(full_checks, last):
    decoder, rng = PosteriorDecoder(CAM1), random.Random(SEED)  # noqa: S311
    for seq in range(last - 1, last + 3):
        payload = encode(steady(rng, 1).model_copy(update={"seq": seq, "frames": 3}))
        assert result(decoder.decode, payload) == result(whole, payload)
    # Of a number past 2**63 each is refused by the full check.
    assert len(full_checks) == (2 if last < 2**63 - 1 else 3)


@pytest.mark.parametrize("strange", [0, 1, "x", None, [0.5], {}, b"", 2**64 - 1])
def test_a_number_of_another_type_is_left_to_the_full_check(strange):
    decoder, rng = PosteriorDecoder(CAM1), random.Random(SEED)  # noqa: S311
    for name in ("seq", "captured_ns", "frames", "rest", "unlearned", "p", "facets"):
        good = encode(steady(rng, 300))
        fields = msgpack.unpackb(good)
        of_lists = {"p": [*fields["p"][:-1], strange], "facets": {**fields["facets"], min(SHAPE): [0.5, strange, 0.5]}}
        spoilt = {**fields, name: of_lists.get(name, strange)}
        for payload in (good, msgpack.packb(spoilt, use_single_float=True), good):
            assert result(decoder.decode, payload) == result(whole, payload)


@pytest.mark.parametrize(
    "facets",
    [
        {**{name: [0.25, 0.25, 0.5] for name in SHAPE}, "p": [0.5, 0.5], "seq": [1.0]},
        {"own": [0.01] * 100},
        {"own": [1 / 64] * 64},
        {"own": [0.9, 0.05]},
        {},
    ],
)
def test_facets_are_decoded_as_by_the_full_check_whatever_they_are_called(facets):
    decoder, rng = PosteriorDecoder(CAM1), random.Random(SEED)  # noqa: S311
    for n in range(4):
        # Every second time in another order, which is another layout.
        own = dict(sorted(facets.items(), reverse=n >= 2))
        fields = steady(rng, 300 + n).model_dump(exclude_defaults=True)
        payload = msgpack.packb({"v": 1, **fields, "facets": own}, use_single_float=True)
        assert result(decoder.decode, payload) == result(whole, payload)


def test_zeros_have_no_sign_and_many_movements_are_decoded(full_checks):
    decoder, rng = PosteriorDecoder(CAM1), random.Random(SEED)  # noqa: S311
    for n, p in enumerate(([1.0, 0.5, -0.0, -0.5], [1.0, -0.0, 0.0, 0.0], [0.0, -0.0, 0.0, 1.0])):
        payload = encode(steady(rng, 300 + n, p=p, rest=-0.0))
        assert result(decoder.decode, payload) == result(whole, payload)
        assert "-0.0" not in result(decoder.decode, payload)[0]
    many = encode(steady(rng, 300, p=[1 / 5000] * 5000))
    for _ in range(2):
        assert result(decoder.decode, many) == result(whole, many)
