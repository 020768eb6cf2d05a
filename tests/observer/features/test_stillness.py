"""Stillness: frozen pictures and standing people are still at any posture, movements and falls are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.body import Stillness
from observer.geometry.views import parse_view
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Tracks

RATE = 15.0
STANDING = np.array([[-30.0, 90.0], [30.0, 90.0], [0.0, 0.0]])
SIZE = 0.45 * np.hypot(30, 90)
POSTURES = arrays(np.float64, (3, 2), elements=st.integers(-300, 300).map(float), unique=True)
CENTRES = arrays(np.float64, (20, 3, 2), elements=st.integers(-300, 300).map(float))
RATES = st.sampled_from([10.0, 15.0, 30.0])


def still(centres, rate_hz=RATE, body_parts=BODY_PARTS):
    stillness = Stillness(body_parts, rate_hz)
    return np.array([stillness.update(Tracks(np.array(c, dtype=float))) for c in centres])


def moving(part, velocity, seconds=1.0, rate_hz=RATE):
    """A standing body of which one part, or slice of parts, moves by so many body sizes a second."""
    frames = np.repeat(STANDING[None], round(seconds * rate_hz), axis=0)
    way = np.arange(len(frames))[:, None] / rate_hz * np.array(velocity) * SIZE
    frames[:, part] += way[:, None] if isinstance(part, slice) else way
    return frames


@given(POSTURES, RATES)
def test_a_frozen_picture_is_still_at_any_posture(posture, rate_hz):
    p = still(np.repeat(posture[None], round(rate_hz), axis=0), rate_hz)
    assert p[round(0.5 * rate_hz) :].min() > 0.99 and (p >= 0.5).all()


@given(RATES, st.integers(0, 99), st.sampled_from([0.0, 0.01, 0.03, 0.05]))
def test_trembling_is_still(rate_hz, seed, noise):
    frames = np.repeat(STANDING[None], round(8 * rate_hz), axis=0)
    frames += np.random.default_rng(seed).normal(0, noise * SIZE, frames.shape)
    assert still(frames, rate_hz)[-round(3 * rate_hz) :].mean() > 0.65


@given(RATES, st.integers(0, 2), st.floats(0, 2 * np.pi))
def test_one_part_that_moves_is_no_stillness(rate_hz, part, angle):
    fast, slow = (moving(part, v * np.array([np.cos(angle), np.sin(angle)]), rate_hz=rate_hz) for v in (1.5, 0.1))
    assert still(fast, rate_hz)[round(0.5 * rate_hz) :].max() < 0.1
    assert still(slow, rate_hz)[round(0.5 * rate_hz) :].min() > 0.9


def test_a_shift_of_weight_is_still_and_a_bow_is_not():
    assert still(moving(slice(0, 3), (1.5, 0.0)))[8:].min() > 0.9
    assert still(moving(slice(0, 3), (0.0, 1.5)))[8:].max() < 0.1


@given(
    CENTRES,
    arrays(np.bool_, (20, 3)),
    st.integers(-1000, 1000),
    st.sampled_from([0.25, 8.0]),
    st.permutations(range(3)),
)
def test_place_size_and_order_do_not_matter(centres, missing, shift, scale, order):
    centres[missing] = np.nan
    mixed = still((centres[:, order] + shift) * scale, body_parts=[BODY_PARTS[k] for k in order])
    np.testing.assert_allclose(mixed, still(centres), atol=1e-6)


def test_a_part_that_is_not_seen_says_nothing():
    frames = np.repeat(STANDING[None], 30, axis=0)
    frames[10:, 0] = np.nan
    assert still(frames)[10:].min() > 0.9
    frames[:] = np.nan
    assert (still(frames) == 0.5).all()


def still_by_formula(frames, size, rate_hz):
    """Oracle for the newest of fully seen frames (F, 3, 2): docs/design/model.md, written down."""
    half, every = round(0.2 * rate_hz), round(0.3 * rate_hz)
    ways = frames[-half:].mean(axis=0) - frames[-2 * half : -half].mean(axis=0)
    ways[:, 0] -= np.median(ways[:, 0])
    speeds = np.linalg.norm(ways, axis=1) / (half / rate_hz)
    # The noise is measured anew every 0.3 s, from the second differences of the last 5 s.
    measured = frames[: (len(frames) - 1) // every * every + 1]
    jerks = np.linalg.norm(np.diff(measured, 2, axis=0), axis=-1)[-round(5 * rate_hz) :]
    count = len(jerks)
    # A fifth of the lengths of 2-D normal vectors with standard deviation s is below s sqrt(-2 ln .8); s = sqrt(6) sd.
    noise = np.sort(jerks, axis=0)[int(0.2 * count)] / (np.sqrt(6) * np.sqrt(-2 * np.log(0.8)))
    weight = count / (count + 10)
    noise = np.minimum(weight * noise + (1 - weight) * 0.03 * size, 0.08 * size)
    # The difference of two means of `half` frames has the standard deviation noise sqrt(2 / half).
    limits = np.hypot(0.35 * size, 2.5 * noise * np.sqrt(2 / half) / (half / rate_hz))
    return 1 / (1 + (speeds / limits).max() ** 4)


@pytest.mark.parametrize("rate_hz", [10.0, 30.0])
@pytest.mark.parametrize("count", [25, 60, 200])
def test_stillness_is_the_formula(rate_hz, count):
    rng = np.random.default_rng(count)
    frames = STANDING + rng.normal(0, 0.03 * SIZE, (count, 3, 2)) + np.cumsum(rng.normal(0, 0.4, (count, 3, 2)), axis=0)
    stillness = Stillness(BODY_PARTS, rate_hz)
    for centres in frames:
        stillness.update(Tracks(centres), SIZE)
    assert stillness.probability == pytest.approx(still_by_formula(frames, SIZE, rate_hz), rel=1e-6)


@pytest.fixture(scope="module")
def people(msr):
    """Stillness of training people of MSR Action3D in two views, and their tracks."""
    chosen = [r for r in msr.recordings if r.subject in "13579"][::4]
    views = [parse_view("door"), parse_view("wheel")]
    tracks = [view_tracks(view, r, BODY_PARTS, BODY_PARTS) for view in views for r in chosen]
    return [np.array([t.centres for t in recording]) for recording in tracks]


def test_recorded_people_are_not_still_while_they_move_and_are_when_they_freeze(people):
    middle = np.concatenate([still(centres)[len(centres) // 4 : len(centres) * 3 // 4] for centres in people])
    assert middle.mean() < 0.15
    frozen = [np.concatenate([c[: len(c) // 2], np.repeat(c[len(c) // 2][None], 12, axis=0)]) for c in people]
    seen = [f for f in frozen if np.isfinite(f[-1]).all()]
    assert np.mean([still(f)[-1] for f in seen]) > 0.98
