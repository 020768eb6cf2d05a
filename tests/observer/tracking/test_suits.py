"""When the tracker complains, of what, and which hand it names from behind and from the side."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from observer.tracking import camshift
from observer.tracking.camshift import CamshiftTracker, TrackingAdvice, explain_loss
from observer.tracks import Frame, State

DISCS = Path(__file__).with_name("test_camshift.py")


@pytest.fixture
def discs(monkeypatch):
    """The drawn scenes of the tracker's own test."""
    monkeypatch.setattr(camshift, "have_cascade", lambda: False)
    spec = importlib.util.spec_from_file_location("drawn_discs", DISCS)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "drawn_discs", module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ((0.0, 100.0, 0.0, 40.0), ""),
        ((0.0, 100.0, 0.0, None), ""),
        ((4.9, 10.0, 0.5, None), ""),
        ((5.0, 23.0, 0.5, None), "no face found for 5 s: the picture is dark (mean 23 of 255)"),
        ((5.0, 100.0, 0.4, 40.0), "no face found for 5 s: skin colour covers 40% of the picture"),
        ((5.0, 100.0, 0.0, None), "no face found for 5 s: face the camera"),
        ((0.0, 100.0, 0.0, 14.0), "the face is 14 px wide"),
    ],
)
def test_one_line_says_what_is_wrong(told, says):
    said = explain_loss(*told)
    assert said.startswith(says)
    assert bool(said) is bool(says)
    assert not says or 'tracker = "mediapipe"' in said


def test_the_line_stands_while_nobody_is_found_and_goes_when_somebody_is():
    hint, dark = TrackingAdvice(), np.zeros((48, 64, 3), np.uint8)
    said = []
    for _ in range(90):
        hint.update(False, None, 0.0, dark, 0.1)
        said.append(hint.complaint)
    assert said[48] == ""
    assert set(said[51:]) == {said[-1]}
    assert "dark" in said[-1]
    hint.update(True, 40.0, 0.0, dark, 0.1)
    assert hint.complaint == ""


def states_and_centres(discs, facing):
    tracker = CamshiftTracker(face_region=discs.REGION, facing=facing)
    return discs.track(discs.scene(discs.wave(1), discs.wave(-1), frames=50), tracker)


def test_from_behind_the_hand_on_the_pictures_left_is_the_left_one(discs):
    before, _ = states_and_centres(discs, 1.0)
    behind, _ = states_and_centres(discs, -1.0)
    assert np.array_equal(before[20:, [1, 0]], behind[20:, :2], equal_nan=True)
    assert np.nanmax(behind[20:, 0, 0]) < discs.HEAD[0]


def test_from_the_side_no_hand_is_claimed_and_the_head_is(discs):
    centres, states = states_and_centres(discs, 0.2)
    assert np.isnan(centres[:, :2]).all()
    assert all(state[0] is state[1] is State.UNSURE for state in states[30:40])
    assert np.isfinite(centres[-1, 2]).all()


def test_an_empty_room_is_complained_of():
    tracker = CamshiftTracker(face_region=None) if camshift.have_cascade() else None
    if tracker is None:
        pytest.skip("this OpenCV has no face cascade")
    for n in range(8):
        tracker.update(Frame(n * 1_000_000_000, np.full((120, 160, 3), 12, np.uint8)))
    assert "dark" in tracker.complaint
