"""The picture of what a tracker sees: marks, frames, text, motion without a picture; a film of such pictures."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.preview.small_picture import (
    DOT_PX,
    FOLLOWED,
    OTHER,
    STATE_COLOUR,
    MotionExtent,
    Placement,
    Sighting,
    fitting,
    plain,
    small_picture,
    width_of,
    write_line,
)
from observer.tracks import BODY_PARTS, Outline, SeenPeople, State, Tracks

STANDING = np.array([[420.0, 300.0], [180.0, 300.0], [320.0, 190.0]])
NOWHERE = np.full((3, 2), np.nan)
GREY = np.full((480, 640, 3), 90, np.uint8)


def drawn(picture=GREY, centres=STANDING, guesses=None, people=None, extent=None):
    return small_picture(Sighting(picture, Tracks(centres, guesses, people), BODY_PARTS, 0, extent), 640)


def pixels(picture, colour):
    return int((picture == np.array(colour, np.uint8)).all(axis=-1).sum())


@pytest.mark.parametrize("size", [(480, 640), (420, 420), (720, 1280), (1080, 1920)])
def test_a_seen_part_has_its_mark_at_its_centre(size):
    centres = STANDING / [640, 480] * [size[1], size[0]]
    canvas = drawn(np.full((*size, 3), 90, np.uint8), centres)
    for u, v in Placement.of_picture(size[1], canvas.shape[1]).px(centres):
        assert tuple(canvas[round(v), round(u)]) == STATE_COLOUR[State.SEEN]


def test_an_unsure_part_has_an_empty_ring_at_its_guess():
    canvas = drawn(centres=NOWHERE, guesses=np.vstack([[500.0, 200.0], NOWHERE[1:]]))
    near = canvas[200 - DOT_PX - 4 : 200 + DOT_PX + 4, 500 - DOT_PX - 4 : 500 + DOT_PX + 4]
    assert pixels(near, STATE_COLOUR[State.UNSURE]) > 10 and not pixels(near, STATE_COLOUR[State.SEEN])
    assert tuple(canvas[200, 500]) == (90, 90, 90)


def test_a_missing_part_is_only_in_the_text():
    missing, seen = drawn(centres=NOWHERE), drawn()
    assert (missing[50:] == 90).all()
    red, blue = (picture[:45, :60].reshape(-1, 3).astype(int).sum(axis=0) for picture in (missing, seen))
    assert red[2] > 2 * red[0] and blue[0] > 2 * blue[2], "the colours of the states"


def test_a_frame_shows_who_of_several_people_is_followed():
    one, other = Outline(100, 50, 200, 400), Outline(400, 60, 460, 300)
    canvas = drawn(centres=NOWHERE, people=SeenPeople(one, (other,)))
    for outline, colour in ((one, FOLLOWED), (other, OTHER)):
        u, v = round((outline.left + outline.right) / 2), outline.bottom
        assert pixels(canvas[v - 3 : v + 4, u - 10 : u + 10], colour) >= 10


@pytest.mark.parametrize("shape", [(1, 1), (16, 16), (3000, 4), (2, 4000)])
@pytest.mark.parametrize("centres", [NOWHERE, STANDING, STANDING * 1e12, -STANDING])
def test_any_picture_and_any_tracks_can_be_drawn_and_are_not_changed(shape, centres):
    picture = np.zeros((*shape, 3), np.uint8)
    assert max(drawn(picture, centres).shape) <= 640 and not picture.any()


def test_recorded_motion_keeps_its_proportions():
    metres, extent = np.array([[0.3, -0.9], [-0.3, -0.9], [0.0, -1.6]]), MotionExtent()
    extent.widen(metres)
    canvas, px = drawn(None, metres, extent=extent.corners), Placement.of_motion(extent.corners, (640, 480)).px(metres)
    for u, v in px:
        assert tuple(canvas[round(v), round(u)]) == STATE_COLOUR[State.SEEN]
    assert (px[0, 0] - px[1, 0]) / (px[0, 1] - px[2, 1]) == pytest.approx(0.6 / 0.7)


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e4))
def test_motion_in_any_unit_fits_the_picture(shift, unit):
    extent, centres = MotionExtent(), (STANDING + shift) * unit
    extent.widen(centres)
    px = Placement.of_motion(extent.corners, (640, 480)).px(centres)
    assert (px >= 0).all() and (px <= [640, 480]).all() and np.ptp(px[:, 1]) > 480 / 4


def test_the_extent_grows_and_contains_all_motion():
    extent, before = MotionExtent(), None
    for shift in (0.0, 40.0, -300.0, math.nan, 10.0):
        extent.widen(STANDING + shift)
        low, high = extent.corners
        if math.isfinite(shift):
            assert (low <= STANDING + shift).all() and (STANDING + shift <= high).all()
        if before is not None:
            assert (low <= before[0]).all() and (high >= before[1]).all()
        before = extent.corners


@given(st.text(max_size=60), st.integers(1, 300))
def test_text_is_truncated_to_the_width(text, width):
    cut = fitting(text, width)
    assert width_of(cut) <= width and cut.isascii() and (cut.isprintable() or not cut)
    assert cut == plain(text) or cut == "" or (cut.endswith("..") and plain(text).startswith(cut[:-2]))
    write_line(np.zeros((40, width, 3), np.uint8), 1, text, (255, 255, 255))


def test_colours_of_states_differ_in_grey():
    colours = np.array([[STATE_COLOUR[state] for state in State]], np.uint8)
    grey = np.sort(cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY).ravel().astype(int))
    assert np.diff(grey).min() > 25
