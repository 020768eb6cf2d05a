"""Messages to bytes and back: round-off, size, identity; any other bytes raise BadMessage and nothing else."""

import math
from typing import get_args

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from message_stage import DISTRIBUTIONS, FIELDS, NAMES, judgement, posterior, reason_of, status, verdict, vote
from pydantic import ValidationError

from common.message_checks import check_vocabulary
from common.message_types import MovementTimes, printable
from common.messages import (
    WHY_LIMIT,
    Agreement,
    JudgementMessage,
    OngoingMovement,
    PosteriorMessage,
    ProcessState,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    VoteState,
)
from common.picture_message import MOST_PICTURE_BYTES, PICTURE_SIDE_PX, PictureMessage
from common.teaching_messages import TeachReply
from common.vocabulary import ABSTAIN, Vocabulary
from common.wire import (
    SIZE_LIMIT,
    BadMessage,
    decode,
    decode_from,
    encode,
    encode_vocabulary,
)

IDS = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=64)
COUNTS = st.integers(0, 2**63 - 1)
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30).map(printable)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
PROBABILITIES, BITS = st.floats(0, 1), st.floats(0, 20)
POSTERIORS = st.builds(
    posterior, scene=IDS, observer=IDS, seq=COUNTS, session=WORDS, captured_ns=COUNTS, sent_ns=COUNTS,
    vocabulary=st.fixed_dictionaries({"name": WORDS, "hash": WORDS}), p=DISTRIBUTIONS, rest=st.none() | PROBABILITIES,
    frames=COUNTS, visible=st.dictionaries(WORDS, st.booleans(), max_size=4),
)  # fmt: skip
VOTES = st.builds(
    vote, label=st.none() | WORDS, entropy=st.none() | BITS, weight=PROBABILITIES, age_s=st.none() | NUMBERS,
    state=st.sampled_from(get_args(VoteState)), p=st.none() | st.lists(PROBABILITIES, max_size=3),
)  # fmt: skip
JUDGED = {
    "scene": IDS, "fusion": IDS, "seq": COUNTS, "at_ns": COUNTS, "p": DISTRIBUTIONS, "label": WORDS, "rule": WORDS,
    "vocabulary": st.builds(VocabularyReference, name=WORDS, hash=WORDS), "certainty_bits": BITS,
    "votes": st.dictionaries(IDS, VOTES, max_size=4), "agreement": st.builds(Agreement, k=COUNTS, n=COUNTS),
}  # fmt: skip
JUDGEMENTS = st.builds(judgement, **JUDGED)
WHY = st.none() | st.text("abc %;", min_size=1, max_size=WHY_LIMIT)
VERDICTS = st.builds(
    verdict, **JUDGED, id=WORDS, began_ns=COUNTS, decided_ns=COUNTS, ended_ns=st.none() | COUNTS, why=WHY,
    revises=st.none() | WORDS,
)  # fmt: skip
LEANS_ON = {"hash": "h", "regions": ["right arm", "trunk"], "shares": [[81, 12], [0, 100]]}
STATUSES = st.builds(
    status, scene=IDS, id=IDS, state=st.sampled_from(get_args(ProcessState)), reason=WORDS, rate_hz=st.none() | NUMBERS,
    last_frame_ns=st.none() | COUNTS, skew_s=st.none() | NUMBERS, version=WORDS, leans_on=st.none() | st.just(LEANS_ON),
)  # fmt: skip
PICTURES = st.builds(
    PictureMessage, captured_ns=COUNTS, width=st.integers(1, PICTURE_SIDE_PX), height=st.integers(1, PICTURE_SIDE_PX),
    jpeg=st.binary(min_size=2, max_size=300) | st.just(bytes(MOST_PICTURE_BYTES)),
)  # fmt: skip
KINDS = (PosteriorMessage, JudgementMessage, VerdictMessage, StatusMessage, VocabularyMessage, PictureMessage)


def changed(**fields):
    return msgpack.packb({**FIELDS, **fields})


def test_a_map_from_another_language_is_decoded():
    message = decode(PosteriorMessage, msgpack.packb({**FIELDS, "p": [0, 1], "colour": "red"}))
    assert (message.p, message.visible, message.prior, message.rest) == ([0.0, 1.0], {}, None, None)


def test_none_is_omitted_but_an_open_end_is_null():
    assert set(msgpack.unpackb(encode(decode(PosteriorMessage, changed())))) == {*FIELDS}
    assert msgpack.unpackb(encode(verdict(label=ABSTAIN)))["ended_ns"] is None


def texts_in(value):
    """All texts in a message, at any depth."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for name, part in value.items():
            yield from (name, *texts_in(part))
    elif isinstance(value, list):
        for part in value:
            yield from texts_in(part)


ESCAPE = "\x1b[2J\x07\n"


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (verdict(), ("label", "rule", "id", "session", "why")),
        (status(), ("reason", "version", "session")),
        (TeachReply(state="idle"), ("fault", "complaint")),
    ],
)
def test_no_text_of_a_message_controls_a_terminal(message, fields):
    payload = msgpack.packb(msgpack.unpackb(encode(message)) | dict.fromkeys(fields, ESCAPE))
    read = decode(type(message), payload)
    assert all(getattr(read, name) == "?[2J??" for name in fields)
    assert all(text.isprintable() for text in texts_in(read.model_dump()))


@pytest.mark.parametrize(("ended_ns", "stage"), [(None, "decided"), (9, "ended")])
def test_a_verdict_of_an_earlier_version_has_the_stage_that_its_end_tells(ended_ns, stage):
    fields = msgpack.unpackb(encode(verdict(ended_ns=ended_ns)))
    assert fields.pop("stage") == stage
    for older in (fields, {**fields, "stage": None}):
        decoded = decode(VerdictMessage, msgpack.packb(older))
        assert (decoded.stage, decoded.revises, decoded.why) == (stage, None, None)


def test_a_revision_and_its_end_survive_the_round_trip():
    revised = verdict(stage="revised", revises="lunge")
    ended = verdict(stage="ended", revises="lunge", ended_ns=9, why="lunge 79 % of the 80 % needed")
    for message in (revised, ended):
        assert decode(VerdictMessage, encode(message)) == message


@given(JUDGEMENTS | VERDICTS | STATUSES | PICTURES)
def test_a_message_survives_the_round_trip(message):
    assert decode(type(message), encode(message)) == message


@given(POSTERIORS)
def test_a_posterior_survives_the_round_trip_in_single_precision(message):
    decoded = decode(PosteriorMessage, encode(message))
    assert decoded.with_fields(p=message.p, rest=message.rest) == message
    near = {"rel": 1e-7, "abs": 1e-45}
    assert decoded.p == pytest.approx(message.p, **near)
    assert decoded.rest == message.rest or decoded.rest == pytest.approx(message.rest, **near)


@given(
    st.lists(st.floats(-500, 500, width=32), min_size=2, max_size=40),
    st.sampled_from([np.float32, np.float64]),
    st.sampled_from([-1e-6, -1e-17, -0.0, 0.0, 1e-17, 1e-6]),
)
def test_round_off_of_any_softmax_survives_the_way_to_fusion_and_to_listeners(logits, precision, off):
    log_p = np.array(logits, precision)
    mass = np.exp(log_p - log_p.max())
    p = [float(value) for value in mass / mass.sum()]
    p[0] += off
    entropy, nearly_one = float(-sum(q * math.log2(q) for q in p if q > 0)) * 1e-9 + off, 1.0 + abs(off)
    message = posterior(p=p, rest=nearly_one, unlearned=off, facets={"own": p})
    decoded = decode(PosteriorMessage, encode(message))
    entry = vote(p=p, entropy=entropy, weight=nearly_one, rest=off, reliability=nearly_one, doubles={"b": nearly_one})
    judged = verdict(p=p, certainty_bits=entropy, unlearned=off, votes={"cam1": entry})
    judged = decode(VerdictMessage, encode(judged))
    entry = judged.votes["cam1"]
    values = [*decoded.p, decoded.rest, decoded.unlearned, *decoded.facets["own"], *judged.p, *entry.p, entry.weight]
    values += [judged.unlearned, entry.rest, entry.reliability, entry.doubles["b"]]
    assert all(0 <= value <= 1 and math.copysign(1, value) == 1 for value in values)
    assert all(bits >= 0 and math.copysign(1, bits) == 1 for bits in (judged.certainty_bits, entry.entropy))


@pytest.mark.parametrize("fields", [{"rest": 1.00001}, {"unlearned": -1e-5}, {"p": [1.00001, -0.00001]}])
def test_what_is_more_than_round_off_is_rejected_by_sender_and_receiver(fields):
    with pytest.raises(ValueError):
        posterior(**fields)
    reason_of(PosteriorMessage, changed(**fields))
    with pytest.raises(ValidationError):
        vote(**fields)
    with pytest.raises(ValidationError):
        vote(entropy=-1e-5)


@given(st.floats(-0.002, 0.002))
def test_the_sum_may_miss_one_by_a_thousandth(error):
    if abs(error) < 0.000999:
        assert decode(PosteriorMessage, changed(p=[0.25, 0.75 + error]))
    elif abs(error) > 0.001001:
        assert reason_of(PosteriorMessage, changed(p=[0.25, 0.75 + error])) == "not_a_distribution"


@given(POSTERIORS, IDS)
def test_version_2_leaves_scene_and_observer_to_the_key(message, other):
    terse = message.with_fields(v=2, scene=None, observer=None)
    decoded = decode_from(f"laban/dojo/observer/{other}/posterior", PosteriorMessage, encode(terse))
    assert (decoded.v, decoded.scene, decoded.observer) == (2, None, None)
    assert message.is_of("dojo", message.observer) == (message.scene == "dojo")
    assert reason_of(PosteriorMessage, msgpack.packb({**msgpack.unpackb(encode(terse)), "v": 1})) == "malformed"


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "not_msgpack"),
        (b"\xc1", "not_msgpack"),
        (msgpack.packb(FIELDS)[:-1], "not_msgpack"),
        (msgpack.packb(FIELDS) + b"\x00", "not_msgpack"),
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
        (changed(facets={"own": [0.1, 0.1]}), "not_a_distribution"),
        *((changed(**fields), "malformed") for fields in (
            {"p": [1.0]}, {"p": []}, {"p": ["0.5", "0.5"]}, {"p": None}, {"prior": [1.0]}, {"prior": [0.2, 0.3, 0.5]},
            {"rest": 1.5}, {"seq": -1}, {"seq": 2**63}, {"captured_ns": 2**63}, {"sent_ns": -1}, {"frames": 2**64 - 1},
            {"scene": "Dojo"}, {"scene": "dojo\n"}, {"observer": ""}, {"observer": "../judgement"},
            {"vocabulary": "karate"}, {"visible": {"head": "perhaps"}}, {"session": None},
            {"facing": {"surprise": [[0]]}}, {"facing": {"surprise": [[0], [0, 1]]}},
            {"facets": {"own": [1.0] + [0.0] * 7000}}, {"facets": {"effort_time": [1.0]}}, {"facets": {"a b": [1.0]}},
            {"facets": {f"own{n}": [1.0] for n in range(33)}}, {"facets": {"\x1b[2J\n": [2.0]}},
        )),
        (msgpack.packb({"v": 1}), "malformed"),
    ],
)  # fmt: skip
def test_each_fault_has_its_reason(payload, reason):
    assert reason_of(PosteriorMessage, payload) == reason


@pytest.mark.parametrize("name", sorted(set(FIELDS) - {"v"}))
def test_no_field_of_the_contract_may_be_missing(name):
    assert reason_of(PosteriorMessage, msgpack.packb({k: x for k, x in FIELDS.items() if k != name})) == "malformed"


@pytest.mark.parametrize(
    "fields",
    [
        {"seq": 2**63}, {"at_ns": 2**63}, {"decided_ns": 2**64 - 1}, {"agreement": {"k": -1, "n": 0}},
        {"votes": {"cam1": {"state": "asleep"}}}, {"certainty_bits": math.nan},
        {"movement": {"id": "x", "began_ns": 2**63}}, {"why": "x" * 201}, {"stage": "asleep"}, {"stage": "ended"},
        {"stage": "decided", "ended_ns": 9}, {"stage": "revised", "revises": None},
        {"stage": "revised", "revises": "bow"}, {"stage": "revised", "revises": "lunge", "ended_ns": 9},
    ],
)  # fmt: skip
def test_a_listener_rejects_a_verdict_with_fields_out_of_range(fields):
    whole = {**verdict().model_dump(), **fields}
    assert reason_of(VerdictMessage, msgpack.packb(whole)) in ("malformed", "not_finite")


@pytest.mark.parametrize(
    "fields",
    [
        {"shares": [[81, 12], [0]]}, {"shares": [[81, 12]]}, {"shares": [[81, 101], [0, 0]]},
        {"shares": [[0.5, 0.5]] * 2}, {"shares": [[0, 0]] * 10_001}, {"hash": "h" * 129},
        {"regions": [], "shares": [[], []]}, {"regions": ["arm"] * 257, "shares": [[0] * 257] * 2},
    ],
)  # fmt: skip
def test_a_listener_rejects_a_status_with_shares_out_of_range(fields):
    assert decode(StatusMessage, encode(status(leans_on=LEANS_ON))).leans_on.regions == ["right arm", "trunk"]
    whole = {**status().model_dump(), "leans_on": {**LEANS_ON, **fields}}
    assert reason_of(StatusMessage, msgpack.packb(whole)) == "malformed"


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"label": "kick"}, "malformed"),
        ({"votes": {"cam1": vote(label="kick")}}, "malformed"),
        ({"revises": "kick"}, "malformed"),
        ({"movement": OngoingMovement(id="x", began_ns=1, revises="kick")}, "malformed"),
        ({"movement": OngoingMovement(id="x", began_ns=1, label="kick")}, "malformed"),
        ({"p": [0.2, 0.3, 0.5]}, "wrong_length"),
        ({"votes": {"cam1": vote(p=[1.0])}}, "wrong_length"),
        ({"vocabulary": VocabularyReference(name="karate", hash="0")}, "foreign_vocabulary"),
    ],
)
def test_a_judgement_outside_the_vocabulary_is_rejected(fields, reason):
    check_vocabulary(verdict(label=ABSTAIN), NAMES)
    with pytest.raises(BadMessage) as caught:
        check_vocabulary(verdict(**fields), NAMES)
    assert caught.value.reason == reason


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("laban/dojo/observer/cam1/posterior", posterior()),
        ("home/laban/dojo/observer/cam1/status", status()),
        ("laban/dojo/fusion/main/status", status(id="main")),
        ("laban/dojo/verdict", verdict()),
        ("laban/dojo/vocabulary", decode(VocabularyMessage, encode_vocabulary("dojo", NAMES))),
    ],
)
def test_a_message_that_names_another_sender_than_its_key_is_rejected(key, message):
    assert decode_from(key, type(message), encode(message)) == message
    others = {key.replace("dojo", "gym"), key.replace("cam1", "cam2").replace("main", "spare")} - {key}
    for other in others:
        with pytest.raises(BadMessage) as caught:
            decode_from(other, type(message), encode(message))
        assert caught.value.reason == "wrong_key"


def test_the_hash_of_a_vocabulary_must_fit_its_labels():
    decoded = decode(VocabularyMessage, encode_vocabulary("dojo", NAMES))
    assert (decoded.labels, decoded.name, decoded.hash) == (["bow", "lunge"], "karate", NAMES.digest)
    assert decoded.vocabulary == NAMES
    whole = decoded.model_dump()
    for fields in ({"hash": "0" * 16}, {"labels": ["lunge", "bow"]}, {"labels": ["bow"]}, {"labels": ["bow", "Bow"]}):
        assert reason_of(VocabularyMessage, msgpack.packb({**whole, **fields})) == "malformed"


def test_a_vocabulary_carries_the_durations_of_its_movements_as_far_as_they_are_known():
    known = {"bow": MovementTimes(shortest_s=0.5, rest_s=0.25, period_s=0.75), "lunge": MovementTimes(shortest_s=1.5)}
    payload = encode_vocabulary("dojo", Vocabulary(NAMES.labels, NAMES.name, known))
    assert msgpack.unpackb(payload)["movements"] == {
        "bow": {"shortest_s": 0.5, "rest_s": 0.25, "period_s": 0.75}, "lunge": {"shortest_s": 1.5},
    }  # fmt: skip
    vocabulary = decode(VocabularyMessage, payload).vocabulary
    assert vocabulary.movements == known and vocabulary == NAMES and hash(vocabulary) == hash(NAMES)
    assert "movements" not in msgpack.unpackb(encode_vocabulary("dojo", NAMES))
    whole = msgpack.unpackb(payload)
    for times in ({"period_s": 0.0}, {"rest_s": -1.0}, {"shortest_s": 1e9}):
        assert reason_of(VocabularyMessage, msgpack.packb({**whole, "movements": {"bow": times}})) == "malformed"


def test_how_often_a_movement_is_done_is_published_where_it_is_counted():
    counted = decode(PosteriorMessage, encode(posterior(repetitions=2.5)))
    assert counted.repetitions == 2.5 and decode(PosteriorMessage, encode(posterior())).repetitions is None
    assert reason_of(PosteriorMessage, msgpack.packb({**FIELDS, "repetitions": -0.5})) == "malformed"
    short = judgement(votes={"cam1": vote(repetitions=2.5, root_p=[180, 180]), "cam2": vote()}, repetitions=2)
    fields = msgpack.unpackb(encode(short))
    assert fields["repetitions"] == 2 and fields["votes"]["cam1"]["repetitions"] == 2.5
    assert all("repetitions" not in each for each in (fields["votes"]["cam2"], msgpack.unpackb(encode(judgement()))))


@pytest.mark.parametrize("kind", KINDS)
@given(payload=st.binary(max_size=200))
@example(payload=b"\xd6\xff\x00\x00\x00\x00")
@example(payload=b"\x81\xa1v\x01")
def test_random_bytes_are_bad_messages(kind, payload):
    reason_of(kind, payload)
