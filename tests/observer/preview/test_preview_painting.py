"""The painted picture: marks, bars and the inset."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observer_stage import rejected

from observer.preview.drawing import (
    FOLLOWED,
    OTHER,
    PLAIN,
    RING_PX,
    SIZE,
    STATE_COLOUR,
    PaintingLayout,
    Placement,
    fitting,
    plain,
    width_of,
    wrapped,
)
from observer.preview.painting import (
    BAR,
    REST_COLOUR,
    WINNER,
    bar_ends,
    draw_posterior,
    paint,
)
from observer.preview.sight import MotionExtent, ShownPosterior, Sighting
from observer.tracks import BODY_PARTS, Outline, SeenPeople, State, Tracks

STANDING = np.array([[420.0, 300.0], [180.0, 300.0], [320.0, 90.0]])
NOWHERE = np.full((3, 2), np.nan)
GREY = np.full((480, 640, 3), 90, np.uint8)


def painted(picture, centres=STANDING, guesses=None, people=None, title="door", **more):
    return paint(Sighting(picture, Tracks(centres, guesses, people), BODY_PARTS, 0, **more), title)


def pixels(picture, colour):
    return int((picture == np.array(colour, np.uint8)).all(axis=-1).sum())


def around(canvas, position, box, half=RING_PX + 4):
    x, y = (round(float(n)) for n in position)
    return box.cut(canvas)[max(y - half, 0) : y + half, max(x - half, 0) : x + half]


@pytest.mark.parametrize("size", [(480, 640), (420, 420), (720, 1280), (120, 160), (1080, 1920)])
def test_a_seen_part_has_its_mark_at_its_centre(size):
    centres = STANDING / [640, 480] * [size[1], size[0]]
    canvas = painted(np.full((*size, 3), 90, np.uint8), centres)
    box = PaintingLayout.of(size[1], size[0]).picture
    for position in Placement.of_picture(size[1], box).px(centres):
        assert tuple(box.cut(canvas)[round(position[1]), round(position[0])]) == STATE_COLOUR[State.SEEN]


def test_an_unsure_part_has_an_empty_ring_at_its_guess():
    centres, guesses = STANDING.copy(), NOWHERE.copy()
    centres[0], guesses[0] = np.nan, (500.0, 200.0)
    box = PaintingLayout.of(640, 480).picture
    canvas = painted(GREY, centres, guesses)
    position = Placement.of_picture(640, box).px(guesses)[0]
    near = around(canvas, position, box)
    assert pixels(near, STATE_COLOUR[State.UNSURE]) > 20 and not pixels(near, STATE_COLOUR[State.SEEN])
    assert tuple(box.cut(canvas)[round(position[1]), round(position[0])]) == (90, 90, 90)


def test_a_frame_shows_who_of_several_people_is_followed():
    one, other = Outline(100, 50, 200, 400), Outline(400, 60, 460, 300)
    box = PaintingLayout.of(640, 480).picture
    area = box.cut(painted(GREY, NOWHERE, people=SeenPeople(one, (other,))))
    for outline, colour in ((one, FOLLOWED), (other, OTHER)):
        middle = np.array([[(outline.left + outline.right) / 2, outline.bottom]])
        u, v = (round(float(n)) for n in Placement.of_picture(640, box).px(middle)[0])
        assert pixels(area[v - 3 : v + 4, u - 10 : u + 10], colour) >= 10


def test_a_missing_part_is_only_in_the_legend():
    layout = PaintingLayout.of(640, 480)
    missing, seen = painted(GREY, NOWHERE), painted(GREY)
    assert (layout.picture.cut(missing) == 90).all()
    for state, there, not_there in ((State.MISSING, missing, seen), (State.SEEN, seen, missing)):
        legend = layout.panel.cut(there)[60:150], layout.panel.cut(not_there)[60:150]
        assert [pixels(each, STATE_COLOUR[state]) > 20 for each in legend] == [True, False]


def test_the_inset_shows_the_back_projection():
    class Skin:
        def back_project(self, picture):
            back = np.zeros(picture.shape[:2], np.uint8)
            back[: len(back) // 2] = 255
            return back

    panel = PaintingLayout.of(640, 480).panel
    without, shown = (panel.cut(painted(GREY, skin=skin)) for skin in (None, Skin()))
    rows = np.flatnonzero((shown == 255).all(axis=2).sum(axis=1) > 200)
    assert len(rows) > 100 and not ((without == 255).all(axis=2).sum(axis=1) > 200).any()
    below = shown[rows.max() + 9 : rows.max() + len(rows) - 9, 40:200]
    assert (below == 0).all()


def posterior_of(p, rest=0.0, labels=None):
    return ShownPosterior(labels or tuple(f"movement_{n}" for n in range(len(p))), np.asarray(p, np.float64), rest)


def bar_lengths(posterior, width=480):
    canvas = np.zeros((400, width, 3), np.uint8)
    draw_posterior(canvas, posterior, 0)
    left, right = bar_ends(width)
    rows = [
        row for row in canvas[:, left:right] if any((row[0] == colour).all() for colour in (BAR, WINNER, REST_COLOUR))
    ]
    starts = [n for n, row in enumerate(rows) if n == 0 or not (row == rows[n - 1]).all()]
    return [int((rows[n] == rows[n][0]).all(axis=1).sum()) for n in starts], right - left


@given(st.floats(0.01, 0.98))
@settings(max_examples=30, deadline=None)
def test_bars_are_proportional_to_the_probabilities(p):
    lengths, whole = bar_lengths(posterior_of([p, (1 - p) * 0.9, (1 - p) * 0.1], 0.5))
    expected = [n for n in (round(s * whole) for s in (p, (1 - p) * 0.9, (1 - p) * 0.1, 0.5)) if n]
    # Two bars of equal length and colour count as one.
    assert [n for n in lengths if n] == expected or len(set(expected)) < len(expected)


def test_only_a_unique_winner_is_highlighted():
    won, tied = np.zeros((2, 400, 480, 3), np.uint8)
    draw_posterior(won, posterior_of([0.2, 0.7, 0.1]), 0)
    draw_posterior(tied, posterior_of([0.4, 0.4, 0.2]), 0)
    assert pixels(won, WINNER) > 1000 and not pixels(tied, WINNER)


def test_recorded_motion_keeps_its_proportions():
    metres = np.array([[0.3, -0.9], [-0.3, -0.9], [0.0, -1.6]])
    box, extent = PaintingLayout.of(640, 480).picture, MotionExtent()
    extent.widen(metres)
    canvas = painted(None, metres, extent=extent.corners)
    px = Placement.of_motion(extent.corners, box).px(metres)
    for position in px:
        assert tuple(box.cut(canvas)[round(position[1]), round(position[0])]) == STATE_COLOUR[State.SEEN]
    assert (px[0, 0] - px[1, 0]) / (px[0, 1] - px[2, 1]) == pytest.approx(0.6 / 0.7)


@pytest.mark.parametrize("shape", [(1, 1), (16, 16), (3000, 4), (2, 4000), (2160, 3840)])
@pytest.mark.parametrize("centres", [NOWHERE, STANDING, STANDING * 1e12, -STANDING])
def test_the_painted_size_is_constant_and_the_input_unchanged(shape, centres):
    picture = np.zeros((*shape, 3), np.uint8)
    canvas = painted(picture, centres)
    assert canvas.shape == (SIZE[1], SIZE[0], 3) and canvas.dtype == np.uint8
    assert not picture.any()


@pytest.mark.parametrize("picture", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)])
def test_a_wrong_shape_or_type_is_rejected(picture):
    with rejected("(H, W, 3) of uint8"):
        painted(picture)


@pytest.mark.parametrize("count", [1, 2, 8, 200])
@pytest.mark.parametrize("label", ["ok", "a_movement_with_a_name_of_64_letters_which_is_all_that_is_allowed_"])
def test_long_texts_and_vocabularies_fit(count, label):
    posterior = posterior_of(np.full(count, 1 / count), 1.0, (label,) * count)
    words = "nothing is seen: " * 40
    for picture in (None, GREY, np.zeros((90, 160, 3), np.uint8)):
        canvas = painted(picture, title="Gürtel \u4e2d\n" * 30, posterior=posterior, complaint=words)
        assert canvas.shape == (SIZE[1], SIZE[0], 3)


@given(st.text(max_size=60), st.integers(1, 300))
def test_text_is_truncated_to_the_width(text, width):
    cut = fitting(text, PLAIN, width)
    assert width_of(cut) <= width and cut.isascii() and (cut.isprintable() or not cut)
    assert cut == plain(text) or cut == "" or (cut.endswith("..") and plain(text).startswith(cut[:-2]))


@given(st.text(max_size=200), st.integers(1, 4))
def test_wrapping_loses_no_word(text, lines):
    result = wrapped(text, PLAIN, 200, lines)
    assert len(result) <= lines and " ".join(result).split() == plain(text).split()


def test_colours_of_states_differ_in_grey():
    colours = np.array([[STATE_COLOUR[state] for state in State]], np.uint8)
    grey = np.sort(cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY).ravel().astype(int))
    assert np.diff(grey).min() > 25
