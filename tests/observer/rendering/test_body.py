"""A body inferred from hands and head holds them there, with limbs of a person's length, feet on the floor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.rendering.body import FOREARM, HALF_SHOULDERS, HEAD_CENTRE, NECK, TRUNK, UPPER_ARM, Stature, pose, stature

TALL = 1.72
STANDING = Stature(np.array([0.3, HEAD_CENTRE * TALL, 2.0]), TALL)
UPRIGHT = STANDING.head + np.array([[-0.3, -0.8, -0.05], [0.3, -0.8, -0.05], [0.0, 0.0, 0.0]])
near = st.floats(-0.45, 0.45)


def length(a, b):
    return float(np.linalg.norm(a - b))


def test_an_upright_person_has_hips_below_the_head_and_feet_on_the_floor():
    body = pose(UPRIGHT, STANDING)
    np.testing.assert_allclose(body.hips.mean(axis=0), [0.3, 0.53 * TALL, 2.0], atol=1e-9)
    np.testing.assert_allclose(body.spine, [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(body.ankles[:, 1], 0.045 * TALL)
    assert body.shoulders[0, 0] < 0.3 < body.shoulders[1, 0]
    assert length(*body.shoulders) == pytest.approx(2 * HALF_SHOULDERS * TALL)


@given(st.lists(near, min_size=6, max_size=6), st.tuples(near, st.floats(-0.8, 0.05), near))
def test_hands_and_head_keep_their_positions_in_every_posture(hands, head):
    positions = UPRIGHT + np.array([hands[:3], hands[3:], head])
    body = pose(positions, STANDING)
    np.testing.assert_array_equal(body.head, positions[2])
    for arm, position in zip(body.arms, positions[:2], strict=True):
        np.testing.assert_array_equal(arm.hand, position)
        reach = length(arm.shoulder, arm.hand)
        if UPPER_ARM * TALL - FOREARM * TALL < reach < (UPPER_ARM + FOREARM) * TALL and reach > 0.03:
            assert length(arm.shoulder, arm.elbow) == pytest.approx(UPPER_ARM * TALL)
            assert length(arm.elbow, arm.hand) == pytest.approx(FOREARM * TALL)
    for places in (body.shoulders, body.hips, body.knees, body.ankles, body.chest):
        assert np.isfinite(places).all()
    assert body.hips[:, 1].min() > STANDING.floor + 0.2
    assert length(body.head, body.hips.mean(axis=0)) < 1.7 * (TRUNK + NECK) * TALL


def test_a_person_who_bends_forward_has_the_hips_behind_the_head():
    bent = UPRIGHT + np.array([[0.0, -0.1, -0.5], [0.0, -0.1, -0.5], [0.0, -0.4, -0.5]])
    body = pose(bent, STANDING)
    assert body.hips[:, 2].min() > bent[2, 2] + 0.3
    assert body.spine[2] < -0.5


def test_unseen_parts_are_none():
    body = pose(np.where([[True], [False], [True]], UPRIGHT, np.nan), STANDING)
    assert body.arms[0] is not None and body.arms[1] is None
    body = pose(np.where([[True], [True], [False]], UPRIGHT, np.nan), STANDING)
    assert body.head is None and np.isfinite(body.shoulders).all()
    assert pose(np.full((3, 3), np.nan), STANDING) is None


def test_the_stature_follows_from_upright_head_and_hanging_hands():
    frames = np.stack([UPRIGHT] * 8 + [UPRIGHT - [0.0, 0.5, 0.2]] * 2)
    frames[0, 2] = np.nan
    standing = stature(frames)
    np.testing.assert_allclose(standing.head, STANDING.head, atol=0.01)
    assert standing.height == pytest.approx(1.6, abs=0.01)
    np.testing.assert_allclose(standing.middle[[0, 2]], [0.3, 2.0])
    assert standing.floor == pytest.approx(STANDING.head[1] - HEAD_CENTRE * 1.6)


def test_the_default_height_without_hanging_hands_or_head():
    raised = UPRIGHT + np.array([[0.0, 0.6, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.0]])
    assert stature(raised[None]).height == 1.72
    headless = raised.copy()
    headless[2] = np.nan
    assert stature(headless[None]).head[1] > raised[0, 1]
    assert np.isfinite(stature(np.full((2, 3, 3), np.nan)).middle).all()
