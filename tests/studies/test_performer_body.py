"""The synthetic body keeps to anatomy whatever posture it is asked for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from studies.performer.body import ELBOW_POLE, Build, Posture, assume, rest_vector

BUILD = Build.of(1.80)
REST = rest_vector((0.1, -0.9, 0.0))

postures = arrays(np.float64, (3, 12), elements=st.floats(-1.5, 1.5))
heights = st.floats(1.5, 2.0)


def one(posture):
    return assume(BUILD, posture.vector(REST)[None])


def test_upright_with_hands_out():
    body = one(Posture(right=(0.5, 0.0, 0.0), left=(0.0, 0.0, 0.5)))
    half, shoulder_y, arm = 0.129 * 1.8, 0.818 * 1.8, 0.386 * 1.8
    np.testing.assert_allclose(body.hips, [[0, 0.53 * 1.8, 0]], atol=1e-12)
    np.testing.assert_allclose(body.head, [[0, 0.936 * 1.8, 0]], atol=1e-12)
    np.testing.assert_allclose(body.shoulders[0], [[-half, shoulder_y, 0], [half, shoulder_y, 0]], atol=1e-12)
    np.testing.assert_allclose(
        body.hands[0], [[-half, shoulder_y, -arm / 2], [half + arm / 2, shoulder_y, 0]], atol=1e-12
    )


def test_positions_are_left_hand_right_hand_head():
    body = one(Posture(right=(0.3, 0.2, 0.1)))
    np.testing.assert_array_equal(body.positions, np.stack([body.hands[:, 0], body.hands[:, 1], body.head], axis=1))


@pytest.mark.parametrize(
    ("posture", "axis", "sign"),
    [
        (Posture(step=0.3), 2, -1),
        (Posture(lean=0.3), 2, -1),
        (Posture(nod=0.3), 2, -1),
        (Posture(side=0.3), 0, 1),
        (Posture(drop=0.3), 1, -1),
    ],
)
def test_trunk_channels_move_the_head_their_way(posture, axis, sign):
    moved = one(posture).head - one(Posture()).head
    assert sign * moved[0, axis] > 0.02


def test_twist_brings_the_right_shoulder_forward():
    shoulders = one(Posture(twist=0.4)).shoulders[0]
    assert shoulders[1, 2] < -0.05 < 0.05 < shoulders[0, 2]


def test_a_hand_that_is_none_rests():
    np.testing.assert_array_equal(Posture(right=(0.0, 0.0, 0.5)).vector(REST)[3:6], REST[3:6])


@given(postures, heights)
def test_arms_keep_their_lengths(vectors, height):
    build = Build.of(height)
    body = assume(build, vectors)
    upper = np.linalg.norm(body.elbows - body.shoulders, axis=2)
    lower = np.linalg.norm(body.hands - body.elbows, axis=2)
    reach = np.linalg.norm(body.hands - body.shoulders, axis=2)
    asked = np.linalg.norm(vectors[:, :6].reshape(3, 2, 3), axis=2)
    assert (reach <= build.arm).all()
    # A hand that is asked to be in its shoulder has no direction to go in, and stays there.
    away = asked[:, ::-1] > 1e-6
    np.testing.assert_allclose(lower[away], build.forearm, rtol=1e-6)
    np.testing.assert_allclose(upper[away], build.upper_arm, rtol=1e-6)


def test_an_arm_along_the_elbows_own_direction_keeps_its_elbow():
    out, up, back = 0.5 * np.array(ELBOW_POLE)
    body = one(Posture(right=(out, up, -back), left=(out, up, -back)))
    np.testing.assert_allclose(np.linalg.norm(body.elbows - body.shoulders, axis=2), BUILD.upper_arm)


@given(postures, heights)
def test_the_head_stays_above_the_hips_and_the_body_in_one_piece(vectors, height):
    build = Build.of(height)
    vectors[:, [9, 11]] *= 0.5
    body = assume(build, vectors)
    assert (body.head[:, 1] > body.hips[:, 1]).all()
    chest = body.shoulders.mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(chest - body.hips, axis=1), build.trunk)
    np.testing.assert_allclose(np.linalg.norm(body.head - chest, axis=1), build.neck)


@given(postures)
def test_everything_scales_with_height(vectors):
    small, tall = assume(Build.of(1.5), vectors), assume(Build.of(1.8), vectors)
    np.testing.assert_allclose(tall.positions, small.positions * 1.2, atol=1e-9)
