"""What is seen, unsure and missing, by what a tracker gives."""

import numpy as np

from observer.tracks import State, Tracks

NOWHERE = [np.nan, np.nan]


def test_a_centre_is_seen_a_guess_alone_unsure_and_neither_missing():
    tracks = Tracks(np.array([[1.0, 2.0], NOWHERE, NOWHERE]), np.array([NOWHERE, [3.0, 4.0], NOWHERE]))
    assert tracks.states == (State.SEEN, State.UNSURE, State.MISSING)
    assert tracks.visible.tolist() == [True, False, False]
