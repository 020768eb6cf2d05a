"""The body's place, size and stillness: properties that every stream of tracks has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from observer.body import TORSO_LENGTHS, BodyFrame, BodyReach
from observer.tracks import BODY_PARTS, WHOLE_BODY, Tracks

RATE = 15.0
CENTRES = arrays(np.float64, (20, 3, 2), elements=st.integers(-300, 300).map(float))
STANDING = np.array([[-30.0, 90.0], [30.0, 90.0], [0.0, 0.0]])


def frames_of(centres, body_parts=BODY_PARTS, rate_hz=RATE):
    """(F, 2) origins and (F,) sizes."""
    frame = BodyFrame(body_parts, rate_hz)
    results = [frame.update(Tracks(np.array(c, dtype=float))) for c in centres]
    return np.array([origin for origin, _ in results]), np.array([size for _, size in results])


def stand(seconds, scale=1.0, at=(0.0, 0.0), noise=0.5, seed=0):
    rng = np.random.default_rng(seed)
    frames = np.repeat(STANDING[None] * scale + at, round(seconds * RATE), axis=0)
    return frames + rng.normal(0, noise * scale, frames.shape)


@given(CENTRES, arrays(np.bool_, (20, 3)), st.integers(-1000, 1000), st.sampled_from([0.25, 8.0]))
def test_the_frame_moves_and_grows_with_the_body(centres, missing, shift, scale):
    centres[missing] = np.nan
    origins, sizes = frames_of(centres)
    moved, scaled = frames_of((centres + shift) * scale)
    np.testing.assert_allclose(moved, (origins + shift) * scale, atol=1e-6)
    np.testing.assert_allclose(scaled, sizes * scale, atol=1e-6)


@given(CENTRES, st.permutations(range(3)))
def test_the_order_of_the_parts_does_not_matter(centres, order):
    mixed = frames_of(centres[:, order], [BODY_PARTS[k] for k in order])
    for one, other in zip(mixed, frames_of(centres), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@given(CENTRES, st.integers(1, 19))
def test_later_frames_do_not_change_earlier_results(centres, count):
    for early, whole in zip(frames_of(centres[:count]), frames_of(centres), strict=True):
        np.testing.assert_array_equal(early, whole[:count])


@pytest.mark.parametrize("at", [0, 7, 20])
def test_one_false_frame_of_twice_the_size_does_not_matter(at):
    centres = stand(2)
    size = frames_of(centres)[1][-1]
    centres[at] = 2 * centres[at] + 40
    origins, sizes = frames_of(centres)
    assert sizes[-1] == pytest.approx(size, rel=0.05)
    np.testing.assert_allclose(origins[-1], 0, atol=0.05 * size)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_person_who_walks_in_and_comes_nearer_is_measured_anew_within_a_second(scale):
    share = np.linspace(0, 1, 30)[:, None, None]
    walking = STANDING * (1 - share + share * scale) + share * [300, 20]
    centres = np.concatenate([stand(2), walking, stand(1, scale, (300, 20))])
    origins, sizes = frames_of(centres)
    fresh = frames_of(stand(1, scale))[1][-1]
    np.testing.assert_allclose(origins[-1], (300, 20), atol=0.1 * fresh)
    assert sizes[-1] == pytest.approx(fresh, rel=0.35)


def test_the_next_person_is_another_one():
    gone = np.full((20, 3, 2), np.nan)
    origins, sizes = frames_of(np.concatenate([stand(2, 2.0, (500, 0)), gone, stand(0.4)]))
    alone = frames_of(stand(0.4))
    np.testing.assert_allclose(sizes[-6:], alone[1], rtol=1e-3)
    np.testing.assert_allclose(origins[-6:], alone[0], atol=0.01)


def test_the_size_is_a_length_that_a_quarter_of_the_pairs_reach_third_largest_of_five_frames():
    """Oracle: the lengths of all known pairs; a single false part does not decide."""
    rng = np.random.default_rng(2)
    reach = BodyReach(WHOLE_BODY)
    sizes = []
    for _ in range(5):
        at = dict(zip(WHOLE_BODY, rng.normal(0, 50, (len(WHOLE_BODY), 2)), strict=True))
        lengths = sorted(share * np.linalg.norm(at[a] - at[b]) for (a, b), share in TORSO_LENGTHS.items())
        sizes.append(lengths[-1 - len(lengths) // 4])
        size = reach.update(np.array(list(at.values())))
    assert len(lengths) >= 12 and size == pytest.approx(sorted(sizes)[2])


def test_two_hands_are_a_body_and_one_is_not():
    hands = ("left_hand", "right_hand")
    origins, sizes = frames_of(stand(1)[:, :2], hands)
    assert np.isfinite(origins).all() and (sizes > 0).all()
    np.testing.assert_allclose(origins[-1], (0, 90), atol=2)
    with pytest.raises(BadInput, match="at least two parts"):
        BodyFrame(("left_hand",), RATE)


def test_size_and_origin_follow_the_body_as_it_is_still():
    """With time constants at rest and in movement: .4 and 30 s for a smaller size, .15 and 10 s for the place."""
    near, far = stand(1), stand(2, scale=0.6, at=(40, -20), seed=1)
    far[15:, 0] += 60 * np.sin(np.arange(15))[:, None]
    frame, reach = BodyFrame(BODY_PARTS, RATE), BodyReach(BODY_PARTS)
    origin = size = None
    for n, centres in enumerate([*near, *far]):
        own_reach = reach.update(centres)
        new_origin, new_size = frame.update(Tracks(centres))
        if n > len(near):
            still = frame.still
            share = 1 - np.exp(-(still / 0.15 + (1 - still) / 10) / RATE)
            assert new_origin == pytest.approx(origin + (frame.anchor - origin) * share)
            if own_reach <= size:
                share = 1 - np.exp(-(still / 0.4 + (1 - still) / 30) / RATE)
                assert new_size == pytest.approx(size + (own_reach - size) * share)
            else:
                assert new_size == own_reach
        origin, size = new_origin, new_size


def test_the_neck_stands_in_for_the_head():
    neck = np.array([[[0.0, 20.0]]])
    centres = np.concatenate([stand(3), np.repeat(neck, 45, axis=0)], axis=1)
    centres[15:, 2] = np.nan
    origins, _ = frames_of(centres, (*BODY_PARTS, "neck"))
    np.testing.assert_allclose(origins[-1], 0, atol=2)
