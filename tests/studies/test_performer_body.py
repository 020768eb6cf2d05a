"""The synthetic body keeps to anatomy in any posture; strokes arrive, swings leave nothing, trials end at rest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from studies.performer.body import Build, Posture, assume, rest_vector
from studies.performer.perform import TimedStroke, TimedSwing, compose, standing
from studies.performer.repertoire import KNOWN_PEOPLE, SCORES

ONES = np.ones(12)

BUILD = Build.of(1.80)
REST = rest_vector((0.1, -0.9, 0.0))

postures = arrays(np.float64, (3, 12), elements=st.floats(-1.5, 1.5))


def one(posture):
    return assume(BUILD, posture.vector(REST)[None])


def test_upright_with_hands_out_and_at_rest():
    body = one(Posture(right=(0.5, 0.0, 0.0), left=(0.0, 0.0, 0.5)))
    half, shoulder_y, arm = 0.129 * 1.8, 0.818 * 1.8, 0.386 * 1.8
    np.testing.assert_allclose(body.hips, [[0, 0.53 * 1.8, 0]], atol=1e-12)
    np.testing.assert_allclose(body.head, [[0, 0.936 * 1.8, 0]], atol=1e-12)
    np.testing.assert_allclose(body.shoulders[0], [[-half, shoulder_y, 0], [half, shoulder_y, 0]], atol=1e-12)
    np.testing.assert_allclose(
        body.hands[0], [[-half, shoulder_y, -arm / 2], [half + arm / 2, shoulder_y, 0]], atol=1e-12
    )
    np.testing.assert_array_equal(body.positions, np.stack([*body.hands.swapaxes(0, 1), body.head], axis=1))
    np.testing.assert_array_equal(Posture(right=(0.0, 0.0, 0.5)).vector(REST)[3:6], REST[3:6])


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


@given(postures, st.floats(1.5, 2.0))
def test_arms_and_trunk_keep_their_lengths(vectors, height):
    build = Build.of(height)
    vectors[:, [9, 11]] *= 0.5
    body = assume(build, vectors)
    chest = body.shoulders.mean(axis=1)

    def length(end, start):
        return np.linalg.norm(end - start, axis=-1)

    assert (length(body.hands, body.shoulders) <= build.arm).all()
    # A hand that is asked to be in its shoulder has no direction to go in, and stays there.
    away = length(vectors[:, :6].reshape(3, 2, 3), 0)[:, ::-1] > 1e-6
    np.testing.assert_allclose(length(body.hands, body.elbows)[away], build.forearm, rtol=1e-6)
    np.testing.assert_allclose(length(body.elbows, body.shoulders)[away], build.upper_arm, rtol=1e-6)
    np.testing.assert_allclose(length(chest, body.hips), build.trunk)
    np.testing.assert_allclose(length(body.head, chest), build.neck)
    assert (body.head[:, 1] > body.hips[:, 1]).all()


@given(st.floats(0.8, 1.3), st.floats(-0.4, 0.4))
def test_a_stroke_starts_and_ends_on_time(attack, curl):
    stroke = TimedStroke(1.0, 0.5, 2 * ONES, attack, curl)
    before, there = stroke.displacement(np.array([1.0])), stroke.displacement(np.array([1.5]))
    np.testing.assert_allclose(np.vstack([before, there]), np.vstack([0 * ONES, 2 * ONES]), atol=1e-9)
    assert (np.diff(stroke.displacement(np.linspace(0.8, 1.7, 50)), axis=0) >= -1e-12).all()


def test_a_swing_oscillates_as_often_as_it_says_and_leaves_nothing():
    swing = TimedSwing(1.0, 2.0, 2.0, 0.0, ONES, 0 * ONES, 0 * ONES)
    np.testing.assert_array_equal(swing.displacement(np.array([0.0, 1.0, 3.0, 4.0])), 0)
    middle = swing.displacement(np.linspace(1.25, 2.75, 301)[:-1])[:, 0]
    spectrum = np.abs(np.fft.rfft(middle))
    assert np.argmax(spectrum) / 1.5 == pytest.approx(2.0)
    assert np.abs(middle).max() == pytest.approx(1.0, abs=0.01)


@given(st.sampled_from(sorted(SCORES)), st.sampled_from(sorted(KNOWN_PEOPLE)), st.integers(0, 2**32))
def test_a_trial_goes_from_rest_to_rest(label, person, seed):
    who, rng = KNOWN_PEOPLE[person], np.random.default_rng(seed)
    plan = compose(SCORES[label], who, standing(who, rng), rng)
    start, end, later = plan.displacement(np.array([0.0, plan.duration, plan.duration + 5.0]))
    np.testing.assert_allclose(start, 0, atol=1e-9)
    np.testing.assert_allclose(plan.begin + end, plan.end, atol=1e-9)
    np.testing.assert_allclose(later, end, atol=1e-9)
    assert np.abs(plan.end - who.rest_posture).max() < 0.05
