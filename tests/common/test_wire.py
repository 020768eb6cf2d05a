"""Messages to bytes and back; whatever comes in, BadMessage is all that comes out."""

import contextlib
import math

import msgpack
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from common.messages import (
    Agreement,
    JudgementMessage,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyHash,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.vocabulary import Vocabulary
from common.wire import SIZE_LIMIT, BadMessage, decode, encode, encode_vocabulary

IDS = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=64)
TIMES = st.integers(0, 2**63)
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
SHARES = st.lists(st.floats(0.01, 1), min_size=2, max_size=20).map(lambda mass: [m / sum(mass) for m in mass])
REFERENCES = st.builds(VocabularyReference, name=WORDS, hash=WORDS)
POSTERIORS = st.builds(
    PosteriorMessage,
    scene=IDS,
    observer=IDS,
    seq=TIMES,
    session=WORDS,
    captured_ns=TIMES,
    sent_ns=TIMES,
    vocabulary=st.builds(VocabularyHash, name=WORDS, hash=WORDS),
    p=SHARES,
    rest=st.none() | st.floats(0, 1),
    frames=TIMES,
    visible=st.dictionaries(WORDS, st.booleans(), max_size=4),
)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
VOTES = st.builds(
    Vote,
    label=st.none() | WORDS,
    entropy=st.none() | NUMBERS,
    weight=NUMBERS,
    age_s=st.none() | NUMBERS,
    state=st.sampled_from(["counted", "stale", "late", "silent", "foreign", "invalid"]),
    p=st.none() | st.lists(NUMBERS, max_size=3),
)
JUDGED = {
    "scene": IDS,
    "fusion": IDS,
    "seq": TIMES,
    "at_ns": TIMES,
    "vocabulary": REFERENCES,
    "p": SHARES,
    "label": WORDS,
    "certainty_bits": NUMBERS,
    "rule": WORDS,
    "votes": st.dictionaries(IDS, VOTES, max_size=4),
    "agreement": st.builds(Agreement, k=TIMES, n=TIMES),
}
JUDGEMENTS = st.builds(JudgementMessage, **JUDGED)
VERDICTS = st.builds(VerdictMessage, **JUDGED, id=WORDS, began_ns=TIMES, decided_ns=TIMES, ended_ns=st.none() | TIMES)
STATUSES = st.builds(
    StatusMessage,
    scene=IDS,
    id=IDS,
    state=st.sampled_from(["starting", "running", "degraded", "stopping", "failed"]),
    reason=WORDS,
    rate_hz=st.none() | NUMBERS,
    last_frame_ns=st.none() | TIMES,
    skew_s=st.none() | NUMBERS,
    version=WORDS,
)
VOCABULARIES = st.builds(VocabularyMessage, scene=IDS, name=WORDS, hash=WORDS, labels=st.lists(WORDS, max_size=5))
KINDS = (PosteriorMessage, JudgementMessage, VerdictMessage, StatusMessage, VocabularyMessage)

SAID = {
    "v": 1,
    "scene": "dojo",
    "observer": "cam1",
    "seq": 0,
    "session": "s",
    "captured_ns": 1,
    "sent_ns": 2,
    "vocabulary": {"name": "m", "hash": "h"},
    "p": [0.25, 0.75],
    "frames": 3,
}


def reason_of(kind, payload):
    with pytest.raises(BadMessage) as caught:
        decode(kind, payload)
    assert "\n" not in str(caught.value)
    return caught.value.reason


def changed(**fields):
    return msgpack.packb({**SAID, **fields})


def test_a_map_from_another_language_is_read():
    message = decode(PosteriorMessage, msgpack.packb({**SAID, "p": [0, 1], "colour": "red"}))
    assert (message.p, message.visible, message.prior) == ([0.0, 1.0], {}, None)


def test_what_is_not_said_is_left_out_but_an_open_end_is_null():
    message = decode(PosteriorMessage, changed())
    assert set(msgpack.unpackb(encode(message))) == {*SAID}
    verdict = VerdictMessage(
        scene="d", fusion="f", seq=0, at_ns=1, vocabulary=VocabularyReference(name="m", hash="h"), p=[0.5, 0.5],
        label="a", certainty_bits=1.0, rule="log", votes={}, agreement=Agreement(k=0, n=0), id="x", began_ns=1,
        decided_ns=1,
    )  # fmt: skip
    assert msgpack.unpackb(encode(verdict))["ended_ns"] is None


def test_the_vocabulary_says_its_names_in_order():
    vocabulary = Vocabulary(("b", "a"), "two")
    said = decode(VocabularyMessage, encode_vocabulary("dojo", vocabulary))
    assert (said.labels, said.name, said.hash) == (["b", "a"], "two", vocabulary.digest)


@given(JUDGEMENTS | VERDICTS | STATUSES | VOCABULARIES)
def test_a_message_survives_the_way(message):
    assert decode(type(message), encode(message)) == message


@given(POSTERIORS)
def test_a_posterior_survives_the_way_but_for_digits_that_single_precision_has_not(message):
    said = decode(PosteriorMessage, encode(message))
    assert said.model_copy(update={"p": message.p, "rest": message.rest}) == message
    near = {"rel": 1e-7, "abs": 1e-45}
    assert said.p == pytest.approx(message.p, **near)
    assert said.rest == message.rest or said.rest == pytest.approx(message.rest, **near)


@given(POSTERIORS, IDS)
def test_the_terse_version_leaves_to_the_key_who_speaks(message, other):
    terse = message.model_copy(update={"v": 2, "scene": None, "observer": None})
    said = decode(PosteriorMessage, encode(terse))
    assert (said.v, said.scene, said.observer) == (2, None, None)
    assert said.is_of("dojo", other) and message.is_of(message.scene, message.observer)
    assert message.is_of("dojo", message.observer) == (message.scene == "dojo")
    assert reason_of(PosteriorMessage, encode(terse.model_copy(update={"v": 1}))) == "malformed"


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "not_msgpack"),
        (b"\xc1", "not_msgpack"),
        (msgpack.packb(SAID)[:-1], "not_msgpack"),
        (msgpack.packb(SAID) + b"\x00", "not_msgpack"),
        (b"\xdd\xff\xff\xff\xff", "not_msgpack"),
        (b"\x91" * 5000, "not_msgpack"),
        (b"\xa1\xff", "not_msgpack"),
        (b"\x81\x90\x01", "not_msgpack"),
        (msgpack.packb(msgpack.Timestamp(1)), "not_msgpack"),
        (msgpack.packb([1]), "not_a_map"),
        (msgpack.packb({b"v": 1}), "not_a_map"),
        (bytes(SIZE_LIMIT + 1), "too_large"),
        (msgpack.packb({}), "wrong_version"),
        (changed(v=3), "wrong_version"),
        (changed(v=True), "wrong_version"),
        (changed(v="1"), "wrong_version"),
        (changed(p=[math.nan, 1.0]), "not_finite"),
        (changed(p=[0.5, math.inf]), "not_finite"),
        (changed(rest=-math.inf), "not_finite"),
        (changed(p=[0.5, 0.6]), "not_a_distribution"),
        (changed(p=[1.5, -0.5]), "not_a_distribution"),
        (changed(prior=[0.1, 0.1]), "not_a_distribution"),
        (changed(p=[1.0]), "malformed"),
        (changed(p=["0.5", "0.5"]), "malformed"),
        (changed(rest=1.5), "malformed"),
        (changed(seq=-1), "malformed"),
        (changed(observer="../judgement"), "malformed"),
        (changed(p=None), "malformed"),
        (msgpack.packb({"v": 1}), "malformed"),
    ],
)
def test_each_fault_has_its_reason(payload, reason):
    assert reason_of(PosteriorMessage, payload) == reason


@pytest.mark.parametrize("kind", KINDS)
@given(payload=st.binary(max_size=200))
@example(payload=b"\xd6\xff\x00\x00\x00\x00")
@example(payload=b"\x81\xa1v\x01")
def test_random_bytes_are_bad_messages(kind, payload):
    reason_of(kind, payload)


JSONLIKE = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.binary(max_size=9) | WORDS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=4),
    max_leaves=8,
)


@given(st.sampled_from(sorted(SAID)), JSONLIKE)
def test_any_value_in_any_field_is_read_or_a_bad_message(field, value):
    try:
        decode(PosteriorMessage, msgpack.packb({**SAID, field: value}))
    except BadMessage as error:
        assert len(error.detail) <= 200


@given(POSTERIORS.map(encode), st.data())
def test_mutated_bytes_are_read_or_a_bad_message(payload, data):
    mutated = bytearray(payload)
    for _ in range(data.draw(st.integers(1, 4))):
        mutated[data.draw(st.integers(0, len(mutated) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(BadMessage):
        decode(PosteriorMessage, bytes(mutated))
