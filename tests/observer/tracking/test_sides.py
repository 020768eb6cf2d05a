"""Left and right at acquisition, and their repair after a doubtful meeting."""

import numpy as np

from observer.tracking.sides import LEFT, RIGHT, Doubt, name_first, name_second, name_two

HEAD = np.array([100.0, 50.0])


def at(u):
    return np.array([float(u), 80.0])


def test_the_hand_on_the_pictures_left_is_the_right_hand():
    assert name_two([at(50), at(150)]) == {RIGHT: 0, LEFT: 1}
    assert name_two([at(150), at(50)]) == {RIGHT: 1, LEFT: 0}
    assert name_first(at(50), HEAD, 10) == RIGHT
    assert name_first(at(150), HEAD, 10) == LEFT
    assert name_first(at(105), HEAD, 10) is None


def test_a_second_hand_is_believed_on_its_own_side_only():
    assert name_second(at(150), at(50), RIGHT, HEAD, 10) == (True, False)
    assert name_second(at(30), at(50), RIGHT, HEAD, 10) == (False, False)
    assert name_second(at(40), at(160), RIGHT, HEAD, 10) == (True, True)
    assert name_second(at(160), at(40), LEFT, HEAD, 10) == (True, True)


def test_names_are_exchanged_after_a_doubtful_meeting_only():
    sure, unsure = Doubt(), Doubt()
    sure.heard(np.array([[1.0, 90.0], [90.0, 1.0]]), [0, 1])
    unsure.heard(np.array([[1.0, 3.0], [3.0, 1.0]]), [0, 1])
    assert not any(sure.exchange(at(50), at(150), HEAD, 20) for _ in range(9))
    assert [unsure.exchange(at(50), at(150), HEAD, 20) for _ in range(4)] == [False, False, True, False]


def test_hands_on_their_own_sides_settle_the_doubt():
    doubt = Doubt()
    doubt.heard(np.array([[1.0], [2.0]]), [0, None])
    assert doubt.doubtful
    doubt.exchange(at(150), at(50), HEAD, 20)
    assert not doubt.doubtful
