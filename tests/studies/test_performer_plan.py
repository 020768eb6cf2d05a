"""From score to trial: strokes arrive, swings leave nothing behind, every trial ends at rest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.performer.body import assume
from studies.performer.perform import TimedStroke, TimedSwing, compose, minimum_jerk, standing
from studies.performer.repertoire import KNOWN_PEOPLE, REST, SCORES, Stroke

seeds = st.integers(0, 2**32)
persons = st.sampled_from(sorted(KNOWN_PEOPLE))
labels = st.sampled_from(sorted(SCORES))
ONES = np.ones(12)


def plan_of(label, person, seed):
    rng = np.random.default_rng(seed)
    who = KNOWN_PEOPLE[person]
    return who, compose(SCORES[label], who, standing(who, rng), rng)


def test_minimum_jerk_at_its_landmarks():
    np.testing.assert_allclose(minimum_jerk(np.array([-1.0, 0.0, 0.5, 1.0, 7.0])), [0, 0, 0.5, 1, 1])
    np.testing.assert_allclose(minimum_jerk(np.array([0.25])), 10 / 64 - 15 / 256 + 6 / 1024)


@given(st.floats(0.8, 1.3), st.floats(-0.4, 0.4))
def test_a_stroke_starts_and_ends_on_time(attack, curl):
    stroke = TimedStroke(1.0, 0.5, 2 * ONES, attack, curl)
    before, there = stroke.displacement(np.array([1.0])), stroke.displacement(np.array([1.5]))
    np.testing.assert_allclose(np.vstack([before, there]), np.vstack([0 * ONES, 2 * ONES]), atol=1e-9)
    assert (np.diff(stroke.displacement(np.linspace(0.8, 1.7, 50)), axis=0) >= -1e-12).all()


@pytest.mark.parametrize(("curl", "ahead"), [(0.3, 1), (-0.3, -1)])
def test_curl_sends_the_height_ahead_or_lets_it_wait(curl, ahead):
    out, up, forward = TimedStroke(0.0, 1.0, ONES, 1.0, curl).displacement(np.array([0.5]))[0, :3]
    assert ahead * (up - out) > 0.1
    assert out == forward


def test_a_swing_oscillates_as_often_as_it_says_and_leaves_nothing():
    swing = TimedSwing(1.0, 2.0, 2.0, 0.0, ONES, 0 * ONES, 0 * ONES)
    np.testing.assert_array_equal(swing.displacement(np.array([0.0, 1.0, 3.0, 4.0])), 0)
    middle = swing.displacement(np.linspace(1.25, 2.75, 301)[:-1])[:, 0]
    spectrum = np.abs(np.fft.rfft(middle))
    assert np.argmax(spectrum) / 1.5 == pytest.approx(2.0)
    assert np.abs(middle).max() == pytest.approx(1.0, abs=0.01)


@given(labels, persons, seeds)
def test_a_trial_goes_from_rest_to_rest(label, person, seed):
    who, plan = plan_of(label, person, seed)
    start, end, later = plan.displacement(np.array([0.0, plan.duration, plan.duration + 5.0]))
    np.testing.assert_allclose(start, 0, atol=1e-9)
    np.testing.assert_allclose(plan.begin + end, plan.end, atol=1e-9)
    np.testing.assert_allclose(later, end, atol=1e-9)
    assert np.abs(plan.end - who.rest_posture).max() < 0.05


@given(labels, persons, seeds)
def test_trials_are_as_long_and_as_fast_as_people_are(label, person, seed):
    who, plan = plan_of(label, person, seed)
    assert 1.5 <= plan.duration <= 3.75
    time = np.linspace(0, plan.duration, int(200 * plan.duration))
    positions = assume(who.build, plan.begin + plan.displacement(time)).positions
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=2) / (time[1] - time[0])
    assert speed.max() < 8.0


def test_every_score_ends_at_rest():
    for label, score in SCORES.items():
        assert isinstance(score[-1], Stroke) and score[-1].posture == REST, label
