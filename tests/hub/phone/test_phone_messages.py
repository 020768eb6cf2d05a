"""What a phone may send, and that everything else is one clear line."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hub.phone.phone_messages import (
    MESSAGE_LIMIT,
    BadPhoneMessage,
    CameraState,
    ClockAnswer,
    Join,
    LessonRequest,
    PhoneTracks,
    Resume,
    read_message,
)

TRACKS = {"at_ms": 1.7e12, "parts": {"left_hand": [412.25, 300, 0.9], "head": None}}


@pytest.mark.parametrize(("message", "kind"), [
    ({"join": {"code": "abc", "name": "Android Chrome"}}, Join),
    ({"resume": {"secret": "abc"}}, Resume),
    ({"clock": {"number": 3, "now_ms": 1.7e12}}, ClockAnswer),
    ({"tracks": TRACKS}, PhoneTracks),
    ({"camera": {"state": "running", "hz": 14.5, "reason": ""}}, CameraState),
    ({"lesson": {"ask": "start", "plan": {"labels": ["wave", "point"], "add": False}}}, LessonRequest),
])  # fmt: skip
def test_each_message_is_read(message, kind):
    assert isinstance(read_message(json.dumps(message)), kind)


def tracks(**more):
    return json.dumps({"tracks": {**TRACKS, **more}})


@pytest.mark.parametrize("text", [
    "", "null", "[]", "{}", "{", "NaN", b"bytes", "[" * 3000,
    '{"join": null}', '{"join": {"code": ""}}', '{"join": {"code": "x"}, "resume": {"secret": "y"}}',
    '{"picture": "data:image/png;base64,AAAA"}', '{"tracks": 3}',
    tracks(at_ms="soon"), tracks(at_ms=-1), tracks(at_ms=1e300), tracks(parts={}), tracks(picture="AAAA"),
    tracks(parts={"head": [float("nan"), 1, 1]}), tracks(parts={"head": [float("inf"), 1, 1]}),
    tracks(parts={"head": [1e6, 1, 1]}), tracks(parts={"head": [1, 1, 1.5]}), tracks(parts={"head": [1, 1]}),
    tracks(parts={"head": ["1", 1, 1]}), tracks(parts={"Head!": [1, 1, 1]}), tracks(parts={"x" * 40: None}),
    tracks(parts={f"part_{'x' * n}": None for n in range(70)}), '{"clock": {"number": -1, "now_ms": 1}}',
    '{"\\n\\u001b[2J": 1}', '{"camera": {"state": "exploded"}}', " " * (MESSAGE_LIMIT + 1),
])  # fmt: skip
def test_everything_else_is_one_line(text):
    with pytest.raises(BadPhoneMessage) as fault:
        read_message(text)
    assert str(fault.value).isprintable() and 0 < len(str(fault.value)) < 300


@given(st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
))  # fmt: skip
def test_any_json_is_read_or_refused(value):
    for text in (json.dumps(value), json.dumps({"tracks": value}), json.dumps({"tracks": {**TRACKS, "parts": value}})):
        try:
            read_message(text)
        except BadPhoneMessage as fault:
            assert str(fault).isprintable()
