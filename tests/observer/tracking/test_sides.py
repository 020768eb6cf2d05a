"""Left and right at acquisition, and their exchange after an ambiguous meeting."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.tracking.acquisition import LEFT, RIGHT, HandednessEvidence, name_first, name_second, name_two

HEAD = np.array([100.0, 50.0])


def at(u):
    return np.array([float(u), 80.0])


def test_the_hand_on_the_pictures_left_is_the_right_hand():
    assert name_two([at(50), at(150)]) == {RIGHT: 0, LEFT: 1}
    assert name_two([at(150), at(50)]) == {RIGHT: 1, LEFT: 0}
    assert name_first(at(50), HEAD, 10) == RIGHT
    assert name_first(at(150), HEAD, 10) == LEFT
    assert name_first(at(105), HEAD, 10) is None


def test_a_second_hand_is_accepted_on_its_own_side_only():
    assert name_second(at(150), at(50), RIGHT, HEAD, 10) == (True, False)
    assert name_second(at(30), at(50), RIGHT, HEAD, 10) == (False, False)
    assert name_second(at(40), at(160), RIGHT, HEAD, 10) == (True, True)
    assert name_second(at(160), at(40), LEFT, HEAD, 10) == (True, True)


FACE, FRAME_S = 40.0, 1 / 30
LEFT_OF_IT, RIGHT_OF_IT = at(50), at(150)


def frames_until_exchanged(evidence, most=90):
    """Frames until a left hand on the right side is exchanged; `most`: never."""
    return next((n for n in range(most) if evidence.exchange(LEFT_OF_IT, RIGHT_OF_IT, FACE, FRAME_S)), most)


def ambiguous(evidence):
    evidence.add_assignment(np.array([[1.0, 3.0], [3.0, 1.0]]), [0, 1])


def merged(evidence):
    evidence.add_merge()


def settled():
    """Hands that have long been on their own sides."""
    evidence = HandednessEvidence()
    for _ in range(90):
        assert not evidence.exchange(RIGHT_OF_IT, LEFT_OF_IT, FACE, FRAME_S)
    return evidence


def test_hands_with_settled_names_may_cross_for_a_second():
    evidence = settled()
    evidence.add_assignment(np.array([[1.0, 90.0], [90.0, 1.0]]), [0, 1])
    assert not evidence.doubtful
    assert frames_until_exchanged(evidence) >= 30


@pytest.mark.parametrize("meeting", [ambiguous, merged])
def test_after_a_meeting_hands_on_each_others_side_are_exchanged_once_within_few_frames(meeting):
    evidence = settled()
    meeting(evidence)
    assert evidence.doubtful
    assert 0 < frames_until_exchanged(evidence) <= 3
    assert not evidence.exchange(RIGHT_OF_IT, LEFT_OF_IT, FACE, FRAME_S)


@pytest.mark.parametrize("meeting", [ambiguous, merged])
def test_hands_on_their_own_sides_settle_the_doubt(meeting):
    evidence = HandednessEvidence()
    meeting(evidence)
    for _ in range(3):
        assert not evidence.exchange(RIGHT_OF_IT, LEFT_OF_IT, FACE, FRAME_S)
    assert not evidence.doubtful


@given(st.lists(st.floats(-0.59, 0.59), max_size=60))
def test_hands_above_each_other_are_no_evidence(offsets):
    evidence = HandednessEvidence()
    evidence.add_merge()
    for share in offsets:
        assert not evidence.exchange(at(100 + share * FACE), at(100), FACE, 0.1)
    assert evidence.doubtful
