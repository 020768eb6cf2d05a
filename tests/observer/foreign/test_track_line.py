"""One line of a foreign tracker: as documented, and malformed in every way."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import rejected

from observer.foreign import EXAMPLE, MAX_BYTES, ForeignTracker, frame_of_line
from observer.tracks import BODY_PARTS, State

NUMBERS = st.floats(-1e6, 1e6)


def test_the_documented_line_is_read():
    frame = frame_of_line(EXAMPLE.encode(), BODY_PARTS, 5)
    assert frame.captured_ns == 1_700_000_000_000_000_000
    assert frame.content[0].tolist() == [412, 300, 0.9]
    assert np.isnan(frame.content[1:]).all()


@given(st.dictionaries(st.sampled_from(BODY_PARTS), st.lists(NUMBERS, min_size=2, max_size=2), min_size=1))
def test_every_part_in_the_line_gets_its_position(parts):
    line = json.dumps({"parts": parts, "nose": 3}).encode()
    frame = frame_of_line(line, BODY_PARTS, 77)
    tracks = ForeignTracker(BODY_PARTS).update(frame)
    assert frame.captured_ns == 77
    for row, part in enumerate(BODY_PARTS):
        assert np.array_equal(tracks.centres[row], parts.get(part, [np.nan] * 2), equal_nan=True)


def test_a_low_confidence_is_a_guess():
    line = b'{"parts": {"left_hand": [1, 2, 0.3], "head": [5, 6, 0.5], "right_hand": null}}'
    tracks = ForeignTracker(BODY_PARTS).update(frame_of_line(line, BODY_PARTS, 0))
    assert tracks.states == (State.UNSURE, State.MISSING, State.SEEN)
    assert tracks.guesses[0].tolist() == [1, 2]


@pytest.mark.parametrize(
    "line",
    [
        b"", b"no", b"[]", b"{}", b'{"parts": {}}', b'{"parts": {"tail": [1, 2]}}', b'{"parts": {"head": [1]}}',
        b'{"parts": {"head": [1, 2, 7]}}', b'{"parts": {"head": [1, NaN]}}', b'{"parts": {"head": "left"}}',
        b'{"parts": {"head": [1e160, 2]}}', b'{"parts": {"head": [1, -1e30]}}',
        b'{"captured_ns": %d, "parts": {"head": [1, 2]}}' % 2**63,
        b'{"captured_ns": %d, "parts": {"head": [1, 2]}}' % 10**400,
        b'{"captured_ns": -3, "parts": {"head": [1, 2]}}', b"\xff\xfe",
        b'{"parts": {"head": [1, 2]}}' + b" " * MAX_BYTES,
    ],
)  # fmt: skip
def test_a_malformed_line_is_rejected_with_one_line(line):
    with rejected():
        frame_of_line(line, BODY_PARTS, 0)
