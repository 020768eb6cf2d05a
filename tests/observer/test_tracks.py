"""The states of parts in tracks."""

import numpy as np

from observer.tracks import State, Tracks

NOWHERE = [np.nan, np.nan]


def test_states_of_parts():
    tracks = Tracks(np.array([[1.0, 2.0], NOWHERE, NOWHERE]), np.array([NOWHERE, [3.0, 4.0], NOWHERE]))
    assert tracks.states == (State.SEEN, State.UNSURE, State.MISSING)
    assert tracks.visible.tolist() == [True, False, False]
