"""What is seen, unsure and missing, and when a guess is evidence."""

import numpy as np

from observer.tracks import State, Tracks

NOWHERE = [np.nan, np.nan]


def test_a_centre_is_seen_a_guess_alone_unsure_and_neither_missing():
    tracks = Tracks(np.array([[1.0, 2.0], NOWHERE, NOWHERE]), np.array([NOWHERE, [3.0, 4.0], NOWHERE]))
    assert tracks.states == (State.SEEN, State.UNSURE, State.MISSING)
    assert tracks.visible.tolist() == [True, False, False]


def test_guesses_are_taken_while_something_is_seen():
    tracks = Tracks(np.array([[1.0, 2.0], NOWHERE, NOWHERE]), np.array([[9.0, 9.0], [3.0, 4.0], NOWHERE]))
    assert np.array_equal(tracks.coasted().centres, [[1, 2], [3, 4], NOWHERE], equal_nan=True)


def test_with_all_parts_hidden_nothing_is_guessed():
    hidden = Tracks(np.array([NOWHERE] * 3), np.ones((3, 2)))
    assert not hidden.coasted().visible.any()
    plain = Tracks(np.ones((3, 2)))
    assert plain.coasted() is plain
