"""P(the person lies) from one camera's parts: simulated falls and what comes near to one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.simulated_falls import DIRECTIONS_DEG, EVERYDAY, everyday, fall
from common import SECOND_NS
from observer.geometry.projection import project
from observer.geometry.views import parse_view
from observer.preview.posture_outlet import LyingReader
from observer.tracks import WHOLE_BODY
from studies.performer.perform import PEOPLE


def lying(recording, view="door", parts=WHOLE_BODY):
    tracks = project(parse_view(view).matrix, recording.positions)
    rows, reader = [WHOLE_BODY.index(part) for part in parts], LyingReader(parts)
    times = np.arange(len(tracks)) * SECOND_NS // 30
    return [reader.update(centres[rows], int(at_ns)) for centres, at_ns in zip(tracks, times, strict=True)]


@pytest.mark.parametrize("direction", DIRECTIONS_DEG)
@pytest.mark.parametrize("slow", [False, True])
def test_who_falls_in_any_direction_lies_then(direction, slow):
    fallen = fall(PEOPLE[0], direction, slow)
    for view in ("door", "wheel"):
        values = lying(fallen.recording, view)
        assert max(values[: round(fallen.begins_s * 30)]) < 0.25
        assert min(values[round(fallen.lies_s * 30) + 15 :]) > 0.5


@pytest.mark.parametrize("what", EVERYDAY)
@pytest.mark.parametrize("view", ["door", "wheel", "yaw:45"])
def test_what_comes_near_to_a_fall_is_none(what, view):
    assert max(lying(everyday(PEOPLE[0], what), view)) < 0.5


def test_parts_without_legs_or_torso_cannot_tell():
    assert not LyingReader(("left_hand", "right_hand", "head")).can_tell
    assert LyingReader(("left_hand", "right_hand", "head")).update(np.zeros((3, 2)), 1) is None
    assert LyingReader(("neck", "pelvis", "left_foot")).can_tell


def test_unseen_parts_are_no_evidence():
    reader = LyingReader(WHOLE_BODY)
    assert reader.update(np.full((len(WHOLE_BODY), 2), np.nan), 1) is None
    recording = fall(PEOPLE[0], 90, slow=False).recording
    kept = [part for part in WHOLE_BODY if "left" not in part]
    assert lying(recording, parts=kept)[-1] > 0.5


@given(st.floats(0.1, 1000), st.floats(-500, 500), st.floats(-500, 500))
def test_size_and_place_in_the_picture_do_not_matter(scale, u, v):
    tracks = project(parse_view("door").matrix, fall(PEOPLE[1], 45, slow=False).recording.positions)[::5]
    one, other = LyingReader(WHOLE_BODY), LyingReader(WHOLE_BODY)
    for n, centres in enumerate(tracks):
        at_ns = n * SECOND_NS // 6
        moved = other.update(centres * scale + (u, v), at_ns)
        assert moved == pytest.approx(one.update(centres, at_ns), abs=1e-3)
