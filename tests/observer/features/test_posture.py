"""Posture: by hand, against an oracle that reads whole recordings, and properties."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.body import BodyFrame
from observer.features import (
    FEATURES_PER_PART,
    HANDS_FEATURES,
    SLOW_DIRECTION,
    PostureReader,
    groups_of,
    soft_direction,
    without_motion,
)
from observer.tracks import BODY_PARTS, Tracks

RATE = 15.0
FAST = 1.5
WEIGHT = 0.25
GONE = [np.nan, np.nan]
CENTRES = arrays(np.float64, (10, 3, 2), elements=st.integers(-300, 300).map(float))


def read(centres, rate_hz=RATE, body_parts=BODY_PARTS):
    reader = PostureReader(body_parts, rate_hz, FAST, WEIGHT)
    return np.stack([reader.update(Tracks(np.array(frame, dtype=float))) for frame in centres])


def of_parts(features):
    """(F, D) -> (F, P, 5), without what is between the hands."""
    return features[:, :-HANDS_FEATURES].reshape(len(features), -1, FEATURES_PER_PART)


def oracle(centres, rate_hz=RATE):
    """The same by plain loops, from the origins and sizes of the body frame."""
    frame, rows = BodyFrame(BODY_PARTS, rate_hz), []
    for n, (left, right, _) in enumerate(centres):
        (au, av), size = frame.update(Tracks(np.array(centres[n], dtype=float)))
        row = []
        for part in range(3):
            u, v = centres[n][part]
            du, dv = (u - centres[n - 1][part][0], centres[n - 1][part][1] - v) if n else GONE
            du, dv = (d / size * rate_hz / 15 for d in (du, dv))
            speed = math.hypot(du, dv)
            cut = max(speed, SLOW_DIRECTION)
            row += [(u - au) / size, (av - v) / size, du / cut * FAST, dv / cut * FAST, min(speed, FAST)]
        row += [(left[0] - right[0]) / size * WEIGHT**0.5, (right[1] - left[1]) / size * WEIGHT**0.5]
        rows.append(row)
    return np.array(rows)


def test_the_parts_that_are_read_are_relative_to_the_whole_body():
    parts, rng = (*BODY_PARTS, "neck", "left_foot"), np.random.default_rng(0)
    tracks = [Tracks(rng.normal(0, 100, (5, 2))) for _ in range(8)]
    whole = PostureReader(parts, RATE, FAST, WEIGHT)
    some = PostureReader(parts, RATE, FAST, WEIGHT, ("left_hand", "right_hand", "head", "left_foot"))
    of_all, of_some = (np.array([reader.update(frame) for frame in tracks]) for reader in (whole, some))
    assert of_parts(of_some) == pytest.approx(of_parts(of_all)[:, [0, 1, 2, 4]], nan_ok=True)
    assert of_some[:, -HANDS_FEATURES:] == pytest.approx(of_all[:, -HANDS_FEATURES:], nan_ok=True)


@given(CENTRES, arrays(np.bool_, (10, 3)), st.sampled_from([10.0, 15.0, 30.0]))
def test_against_the_oracle(centres, missing, rate_hz):
    centres[missing] = np.nan
    np.testing.assert_allclose(read(centres, rate_hz), oracle(centres.tolist(), rate_hz), atol=1e-12)


def test_a_tracker_may_reuse_its_array():
    reader, centres = PostureReader(BODY_PARTS, RATE, FAST), np.array([[0.0, 100], [45, 0], [0, 0]])
    reader.update(Tracks(centres))
    centres[0] -= (0, 18)
    assert reader.update(Tracks(centres))[4] == pytest.approx(18 / (0.45 * 82))
    assert centres[0].tolist() == [0, 82]


def test_parts_are_found_by_name():
    order = ("head", "right_hand", "left_hand")
    centres = np.array([[[0, 100], [45, 0], [0, 0]], [[0, 82], [45, 0], [0, 0]]], dtype=float)
    mixed, plain = read(centres[:, [2, 1, 0]], body_parts=order), read(centres)
    np.testing.assert_array_equal(of_parts(mixed), of_parts(plain)[:, [2, 1, 0]])
    np.testing.assert_array_equal(mixed[:, -HANDS_FEATURES:], plain[:, -HANDS_FEATURES:])


def test_the_distance_of_the_hands_needs_two_hands():
    features = read(np.array([[[100, 0], [0, 0]]] * 2, dtype=float), body_parts=("right_hand", "head"))
    assert np.isnan(features[:, -HANDS_FEATURES:]).all() and np.isfinite(of_parts(features)[1]).all()


def test_groups_are_seen_as_a_whole():
    groups = groups_of(3)
    rng = np.random.default_rng(0)
    centres = rng.normal(size=(40, 3, 2))
    centres[rng.random((40, 3)) < 0.4] = np.nan
    visible = np.isfinite(read(centres))
    assert len(groups) == visible.shape[1] and groups.max() == 6
    for group in range(7):
        assert (visible[:, groups == group].all(axis=1) == visible[:, groups == group].any(axis=1)).all()


@given(arrays(np.float64, (3, 2), elements=st.floats(-5, 5)), st.floats(0, 2 * math.pi))
def test_a_soft_direction_turns_with_the_motion_and_is_bounded(velocity, angle):
    soft = soft_direction(velocity, FAST)
    assert (np.hypot(soft[:, 0], soft[:, 1]) <= FAST + 1e-12).all() and (soft[:, 2] <= FAST).all()
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    turned = soft_direction(velocity @ turn, FAST)
    np.testing.assert_allclose(turned[:, :2], soft[:, :2] @ turn, atol=1e-9)
    np.testing.assert_allclose(turned[:, 2], soft[:, 2], atol=1e-9)


def test_without_motion_keeps_the_places():
    features = read(np.random.default_rng(0).normal(size=(6, 3, 2)))
    resting = without_motion(features)
    assert resting.shape == features.shape
    parts, before = of_parts(resting), of_parts(features)
    np.testing.assert_array_equal(resting[:, -HANDS_FEATURES:], features[:, -HANDS_FEATURES:])
    np.testing.assert_array_equal(parts[..., :2], before[..., :2])
    assert (parts[..., 2:] == 0).all() and np.isnan(before[0, 0, 2])
    np.testing.assert_array_equal(without_motion(features.astype(np.float32)[3]), resting[3].astype(np.float32))
