"""The extent of recorded motion, the posterior shown, and where both are drawn."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.preview.drawing import SIZE, PaintingLayout, Placement
from observer.preview.sight import MotionExtent, ShownPosterior

STANDING = np.array([[200.0, 200.0], [100.0, 200.0], [150.0, 50.0]])
shares = arrays(np.float64, st.integers(2, 40), elements=st.floats(0.0, 1.0))


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


@given(shares, st.integers(1, 8))
def test_the_most_probable_movements_are_shown_in_the_order_of_the_vocabulary(p, most):
    posterior = ShownPosterior(tuple(map(str, range(len(p)))), p, 0.0)
    shown = posterior.most_probable(most)
    assert shown == sorted(set(shown)) and len(shown) == min(most, len(p))
    others = np.delete(p, shown)
    assert not len(others) or others.max() <= p[shown].min()
    assert posterior.winner is None or posterior.winner in shown


def test_a_uniform_posterior_has_no_winner_and_full_entropy():
    posterior = ShownPosterior(("a", "b", "c", "d"), np.full(4, 0.25), 0.0)
    assert posterior.winner is None and posterior.entropy_bits == pytest.approx(2.0)


@given(st.integers(1, 9000), st.integers(1, 9000))
def test_picture_and_panel_do_not_overlap(width, height):
    layout = PaintingLayout.of(width, height)
    canvas = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for box in (layout.picture, layout.panel):
        assert min(box.x, box.y) >= 0 and min(box.width, box.height) >= 1
        cut = box.cut(canvas)
        assert cut.shape == (box.height, box.width, 3)
        cut += 1
    assert canvas.max() == 1


def test_positions_map_to_their_pixels():
    box = PaintingLayout.of(640, 480).picture
    placement = Placement.of_picture(640, box)
    corners = placement.px(np.array([[-0.5, -0.5], [639.5, 479.5]]))
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [box.width - 0.5, box.height - 0.5]], atol=1.0)


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e4))
def test_motion_in_any_unit_fits_the_canvas(shift, unit):
    box, extent, centres = PaintingLayout.of(640, 480).picture, MotionExtent(), (STANDING + shift) * unit
    extent.widen(centres)
    px = Placement.of_motion(extent.corners, box).px(centres)
    assert (px >= 0).all() and (px <= [box.width, box.height]).all()
    assert np.ptp(px[:, 1]) > box.height / 3
