"""The optional `person` and `place`: a scene with one person sends what it sent before there were several, bytes for
bytes; and what is no place is rejected."""

import hashlib

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st
from message_stage import judgement, posterior, reason_of, verdict, vote

from common.config import read_scene
from common.config_people import PeopleConfig
from common.errors import BadInput
from common.floor_place import FloorPlace
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.teaching_messages import TaughtPlace, TeachReply, TeachRequest
from common.wire import decode, encode

SHORT = {"cam1": vote(root_p=[200, 100], reliability=1.0, rest=0.1)}
BEFORE = {
    "df9421c83c2d0252": posterior(),
    "296ff38143713e40": judgement(),
    "6d11825719361242": judgement(votes=SHORT),
    "fad8dd59fc6b186d": verdict(),
}
"""What the last version without several people sent: the first 16 digits of the SHA-256, of these messages."""
metres = st.floats(-100, 100, width=32)


@pytest.mark.parametrize(("digest", "message"), BEFORE.items())
def test_a_message_without_a_person_has_the_bytes_of_before(digest, message):
    payload = encode(message)
    assert hashlib.sha256(payload).hexdigest()[:16] == digest
    assert not {"person", "place"} & msgpack.unpackb(payload).keys()


@given(metres, metres, st.floats(0.125, 4, width=32), st.floats(0.125, 4, width=32))
def test_a_place_survives_the_wire(x, z, xx, zz):
    place = FloorPlace(at=(x, z), covariance=(xx, 0.0, zz))
    message = decode(PosteriorMessage, encode(posterior(person="3", place=place)))
    assert (message.person, message.place) == ("3", place)
    taught = TaughtPlace(at=[x, z], covariance=[xx, 0.0, zz])
    asked = decode(TeachRequest, encode(TeachRequest(command="begin", teacher="anna", place=taught)))
    answered = decode(TeachReply, encode(TeachReply(state="idle", place=taught)))
    assert asked.place == answered.place == taught and taught.on_floor() == place
    kinds = (JudgementMessage, judgement), (VerdictMessage, verdict)
    for kind, make in kinds:
        made = decode(kind, encode(make(person="left", place=[x, z])))
        assert (made.person, made.place) == ("left", pytest.approx([x, z], rel=1e-6))


@pytest.mark.parametrize(
    "place",
    [
        *({"at": at, "covariance": [1.0, 0.0, 1.0]} for at in ([1.0], [1.0, float("nan")], [1.0, 1e9])),
        *({"at": [1.0, 1.0], "covariance": wrong} for wrong in ([1.0, 2.0, 1.0], [0.0, 0.0, 1.0])),
        {"at": [1.0, 1.0], "covariance": [1.0, 0.0, float("inf")]},
        [1.0, 1.0],
    ],
)
def test_what_is_no_place_is_rejected(place):
    fields = msgpack.unpackb(encode(posterior()))
    assert reason_of(PosteriorMessage, msgpack.packb({**fields, "person": "1", "place": place})) == "malformed"
    assert reason_of(PosteriorMessage, msgpack.packb({**fields, "person": "Ü"})) == "malformed"


def test_people_have_the_names_of_the_scene_file_and_then_numbers():
    assert PeopleConfig().ids == ("1",)
    assert PeopleConfig(most=3, names=("left", "right")).ids == ("left", "right", "3")


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ('names = ["a", "b"]', "name no more, or set people.most = 2"),
        ('most = 2\nnames = ["a", "a"]', "a name of their own"),
        ('most = 2\nnames = ["2"]', "a name of their own"),
        ('most = 2\nnames = ["Left"]', "a-z"),
        (f'most = 2\nnames = ["{"a" * 40}"]', "1 to 32 characters"),
    ],
)
def test_names_that_cannot_be_are_refused_in_a_line(tmp_path, keys, text):
    (tmp_path / "s.toml").write_text(f'scene = "dojo"\n[people]\n{keys}\n[observers.cam1]\nsource = "m.npz"\n')
    with pytest.raises(BadInput, match=rf"s\.toml: people\.names = .*{text}") as caught:
        read_scene(tmp_path / "s.toml", {})
    assert "\n" not in str(caught.value)
