"""What is gathered for people: the last frames, the room that motion needs, the movements worth a bar."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from observer.features.space import VectorSymbol
from observer.preview.drawing import SIZE, PaintingLayout, Placement
from observer.preview.sight import SYMBOLS, TRAIL, PreviewHistory, ShownPosterior
from observer.tracks import BODY_PARTS, Tracks

STANDING = np.array([[200.0, 200.0], [100.0, 200.0], [150.0, 50.0]])
LEFT_GOES_RIGHT = np.array([[30.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
shares = arrays(np.float64, st.integers(2, 40), elements=st.floats(0.0, 1.0))


def seen_after(*centres):
    recent = PreviewHistory(BODY_PARTS, 5.0, "door")
    return [recent.add(Tracks(np.array(c, dtype=np.float64))) for c in centres][-1]


def test_a_hand_that_goes_right_is_an_arrow_right_and_frames_are_counted():
    sight = seen_after(STANDING, STANDING + LEFT_GOES_RIGHT)
    assert sight.symbols[-1].tolist() == [VectorSymbol.R, VectorSymbol.O, VectorSymbol.O]
    assert (sight.frame, sight.title, sight.body_parts) == (1, "door", BODY_PARTS)
    np.testing.assert_array_equal(sight.trail, [STANDING, sight.tracks.centres])


def test_only_the_last_frames_are_remembered():
    sight = seen_after(*[STANDING] * 60)
    assert len(sight.symbols) == SYMBOLS and len(sight.trail) == TRAIL and sight.frame == 59


def test_the_room_only_grows_and_holds_all_that_was_seen():
    recent, before = PreviewHistory(BODY_PARTS, 5.0), None
    for shift in (0.0, 40.0, -300.0, math.nan, 10.0):
        sight = recent.add(Tracks(STANDING + shift))
        low, high = sight.extent
        if math.isfinite(shift):
            assert (low <= STANDING + shift).all() and (STANDING + shift <= high).all()
        if before is not None:
            assert (low <= before[0]).all() and (high >= before[1]).all()
        before = sight.extent


def test_parts_without_a_head_are_refused():
    with pytest.raises(BadInput, match="head"):
        PreviewHistory(("left_hand",), 5.0).add(Tracks(np.zeros((1, 2))))


@given(shares, st.integers(1, 8))
def test_the_most_probable_movements_are_shown_in_the_order_of_the_vocabulary(p, most):
    belief = ShownPosterior(tuple(map(str, range(len(p)))), p, 0.0)
    shown = belief.most_probable(most)
    assert shown == sorted(set(shown)) and len(shown) == min(most, len(p))
    left_out = np.delete(p, shown)
    assert not len(left_out) or left_out.max() <= p[shown].min()
    assert belief.winner is None or belief.winner in shown


def test_who_knows_nothing_has_no_winner_and_all_the_entropy():
    belief = ShownPosterior(("a", "b", "c", "d"), np.full(4, 0.25), 0.0)
    assert belief.winner is None and belief.entropy_bits == pytest.approx(2.0)


@given(st.integers(1, 9000), st.integers(1, 9000))
def test_picture_panel_and_strip_share_the_whole_and_do_not_meet(width, height):
    layout = PaintingLayout.of(width, height)
    canvas = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for box in (layout.picture, layout.panel, layout.strip):
        assert min(box.x, box.y) >= 0 and min(box.width, box.height) >= 1
        cut = box.cut(canvas)
        assert cut.shape == (box.height, box.width, 3)
        cut += 1
    assert canvas.max() == 1


def test_places_go_where_their_pixels_go():
    box = PaintingLayout.of(640, 480).picture
    placement = Placement.of_picture(640, box)
    corners = placement.px(np.array([[-0.5, -0.5], [639.5, 479.5]]))
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [box.width - 0.5, box.height - 0.5]], atol=1.0)


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e4))
def test_motion_of_any_unit_fits_the_canvas(shift, unit):
    box = PaintingLayout.of(640, 480).picture
    sight = seen_after((STANDING + shift) * unit)
    px = Placement.of_motion(sight.extent, box).px(sight.tracks.centres)
    assert (px >= 0).all() and (px <= [box.width, box.height]).all()
    assert np.ptp(px[:, 1]) > box.height / 3
