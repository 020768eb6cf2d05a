"""Messages to bytes and back: round-off, size, identity; any other bytes raise BadMessage and nothing else."""

import math
from typing import get_args

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from message_stage import FIELDS, NAMES, judgement, posterior, status, verdict, vote
from pydantic import ValidationError

from common import wire
from common.config import ObserverConfig, Scene
from common.errors import BadInput, LabanmeshError
from common.message_types import p_of_roots
from common.messages import (
    WHY_LIMIT,
    Agreement,
    Contribution,
    Facing,
    JudgementMessage,
    ObserverStatistics,
    OngoingMovement,
    PosteriorMessage,
    ProcessState,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    VoteState,
)
from common.picture_message import PICTURE_BYTES, PICTURE_SIDE_PX, PictureMessage
from common.probability import roots_of
from common.vocabulary import ABSTAIN
from common.wire import (
    OPTIONAL_DETAIL,
    SIZE_LIMIT,
    BadMessage,
    check_vocabulary,
    decode,
    decode_from,
    encode,
    encode_vocabulary,
)

IDS = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=64)
COUNTS = st.integers(0, 2**63 - 1)
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
DISTRIBUTIONS = st.lists(st.floats(0.01, 1), min_size=2, max_size=20).map(lambda mass: [m / sum(mass) for m in mass])
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
STATUSES = st.builds(
    status, scene=IDS, id=IDS, state=st.sampled_from(get_args(ProcessState)), reason=WORDS, rate_hz=st.none() | NUMBERS,
    last_frame_ns=st.none() | COUNTS, skew_s=st.none() | NUMBERS, version=WORDS,
)  # fmt: skip
PICTURES = st.builds(
    PictureMessage, captured_ns=COUNTS, width=st.integers(1, PICTURE_SIDE_PX), height=st.integers(1, PICTURE_SIDE_PX),
    jpeg=st.binary(min_size=2, max_size=300) | st.just(bytes(PICTURE_BYTES)),
)  # fmt: skip
KINDS = (PosteriorMessage, JudgementMessage, VerdictMessage, StatusMessage, VocabularyMessage, PictureMessage)


def reason_of(kind, payload):
    with pytest.raises(BadMessage) as caught:
        decode(kind, payload)
    assert str(caught.value).isprintable() and len(caught.value.detail) <= 200
    return caught.value.reason


def changed(**fields):
    return msgpack.packb({**FIELDS, **fields})


def test_a_map_from_another_language_is_decoded():
    message = decode(PosteriorMessage, msgpack.packb({**FIELDS, "p": [0, 1], "colour": "red"}))
    assert (message.p, message.visible, message.prior, message.rest) == ([0.0, 1.0], {}, None, None)


def test_none_is_omitted_but_an_open_end_is_null():
    assert set(msgpack.unpackb(encode(decode(PosteriorMessage, changed())))) == {*FIELDS}
    assert msgpack.unpackb(encode(verdict(label=ABSTAIN)))["ended_ns"] is None


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
    assert decoded.model_copy(update={"p": message.p, "rest": message.rest}) == message
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
    with pytest.raises(ValidationError):
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
    terse = message.model_copy(update={"v": 2, "scene": None, "observer": None})
    decoded = decode_from(f"laban/dojo/observer/{other}/posterior", PosteriorMessage, encode(terse))
    assert (decoded.v, decoded.scene, decoded.observer) == (2, None, None)
    assert message.is_of("dojo", message.observer) == (message.scene == "dojo")
    assert reason_of(PosteriorMessage, encode(terse.model_copy(update={"v": 1}))) == "malformed"


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


def detail_left_out(fields):
    """Which optional detail is missing in a judgement of which each vote has all of it."""
    first = next(iter(fields["votes"].values()))
    return [d for d in OPTIONAL_DETAIL if (first.get(d[1]) is None if len(d) == 2 else d[0] not in fields)]


def test_a_judgement_that_is_too_long_loses_optional_detail_in_order_until_it_fits():
    others, facets = {f"cam{n}": 0.5 for n in range(20)}, {"own": [0.5, 0.5]}
    entry = vote(
        p=[0.01] * 100, facing=Facing(surprise=[[9] * 12] * 100), facets=facets, doubles=others, rest_reliability=0.5
    )
    contributions = dict.fromkeys(others, Contribution(nats=1.0, stands=True))
    elsewhere = ("votes", "root_p"), ("facing",), ("why",), ("observers",)
    detail = [d for d in OPTIONAL_DETAIL if d not in elsewhere]
    steps = set()
    for size in range(1000, 6900, 25):
        message = verdict(
            p=[1 / size] * size, facets=facets, contributions=contributions, votes=dict.fromkeys(others, entry)
        )
        payload = encode(message)
        missing = [d for d in detail_left_out(msgpack.unpackb(payload)) if d in detail]
        assert len(payload) <= SIZE_LIMIT and missing == detail[: len(missing)]
        assert decode(VerdictMessage, payload).p == message.p
        steps.add(len(missing))
    assert 0 in steps and {1, 2, 3} & steps and max(steps) >= 4


def test_a_posterior_and_a_status_that_are_too_long_lose_optional_detail():
    size = 3000
    facing = Facing(surprise=[[200] * 12] * size)
    long = posterior(p=[1 / size] * size, facing=facing, facets={"own": [0.5, 0.5]})
    decoded = decode(PosteriorMessage, encode(long))
    assert decoded.facing is None and decoded.facets == long.facets and decoded.p == pytest.approx(long.p, rel=1e-7)
    observers = {f"cam{n}": ObserverStatistics(rejected={"malformed": n}) for n in range(3000)}
    assert decode(StatusMessage, encode(status(observers=observers))) == status()


def test_a_message_that_cannot_fit_is_an_error_and_not_sent():
    with pytest.raises(LabanmeshError, match=r"VerdictMessage: .* bytes without optional detail"):
        encode(verdict(p=[0.0001] * 9000))


def scene_of(observers, labels):
    sections = {f"observer{n}": ObserverConfig(source="0") for n in range(observers)}
    return Scene(scene="dojo", vocabulary=tuple(f"movement_{n:05}" for n in range(labels)), observers=sections)


@pytest.mark.parametrize(
    ("observers", "labels", "fault"),
    [(4, 20, None), (200, 1000, None), (600, 20, "600 observers and 20 movements"), (1, 4400, "4400 movements take")],
)
def test_a_scene_whose_messages_cannot_fit_is_refused(observers, labels, fault):
    scene = scene_of(observers, labels)
    if fault is None:
        wire.require_fits(scene)
        votes = dict.fromkeys(scene.roster, vote(label=scene.vocabulary[0], p=[1 / labels] * labels, doubles={}))
        assert len(encode(verdict(p=[1 / labels] * labels, votes=votes))) <= SIZE_LIMIT
        return
    with pytest.raises(BadInput, match=fault) as caught:
        wire.require_fits(scene)
    assert "\n" not in str(caught.value) and "use fewer" in str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
@given(payload=st.binary(max_size=200))
@example(payload=b"\xd6\xff\x00\x00\x00\x00")
@example(payload=b"\x81\xa1v\x01")
def test_random_bytes_are_bad_messages(kind, payload):
    reason_of(kind, payload)


FULL_VOTE = vote(
    p=[0.25, 0.75], rest=0.25, skew_s=-0.5, unlearned=0.125, facing=Facing(surprise=[[0], [9]]), root_p=[128, 221],
    facets={"own": [0.5, 0.5]}, reliability=0.75, doubles={"cam2": 0.5},
)  # fmt: skip


def test_a_judgement_whose_votes_have_roots_is_short_unless_it_is_to_be_full():
    silent = vote(label=None, entropy=None, weight=0.0, age_s=None, state="silent", reliability=1.0)
    message = judgement(
        votes={"cam1": FULL_VOTE, "cam2": silent}, movement=OngoingMovement(id="dojo-1", began_ns=3), unlearned=0.25
    )
    short = msgpack.unpackb(encode(message))
    needed = {"label", "entropy", "weight", "age_s", "state"}
    assert set(short["votes"]["cam1"]) == needed | {"rest", "skew_s", "unlearned", "reliability", "root_p"}
    assert set(short["votes"]["cam2"]) == needed | {"reliability"} and set(short["movement"]) == {"id", "began_ns"}
    full = decode(JudgementMessage, encode(message, full=True))
    first = message.votes["cam1"].model_copy(update={"root_p": None})
    assert full == message.model_copy(update={"votes": {"cam1": first, "cam2": silent}})
    # A verdict is evidence, and there is one of each movement.
    assert decode(VerdictMessage, encode(verdict(votes=message.votes))).votes == full.votes


def test_who_receives_a_short_judgement_has_all_that_is_shown():
    message = judgement(votes={"cam1": FULL_VOTE.model_copy(update={"reliability": 1.0})}, unlearned=0.25)
    decoded = decode(JudgementMessage, encode(message))
    assert decoded.model_copy(update={"votes": message.votes}) == message
    received = decoded.votes["cam1"]
    assert received.p == pytest.approx([0.25, 0.75], abs=0.004) and sum(received.p) == pytest.approx(1)
    assert (received.rest, received.skew_s, received.unlearned, received.reliability) == (0.25, -0.5, 0.125, 1.0)
    assert encode(decoded) == encode(message)
    # A forged number that single precision does not have.
    forged = message.model_copy(update={"certainty_bits": 1e300})
    assert decode(JudgementMessage, encode(forged)).certainty_bits == 1e300


@given(DISTRIBUTIONS)
def test_the_roots_of_a_distribution_are_precise(p):
    assert p_of_roots(roots_of(np.array(p)).tolist()) == pytest.approx(p, abs=0.004, rel=0)


@pytest.mark.parametrize("roots", [[], [0, 0], [-1, 255], [256, 0], [1.5, 2], "ab", [1] * 10_001])
def test_roots_that_are_no_distribution_are_rejected(roots):
    fields = {**judgement().model_dump(), "votes": {"cam1": {**vote().model_dump(), "root_p": roots}}}
    assert reason_of(JudgementMessage, msgpack.packb(fields)) == "malformed"
