"""Rooms: what a person does before a trial leaves the trial itself as it is."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import Recording
from studies.evaluate import EvaluationSettings, evaluate
from studies.performer import perform
from studies.room import NOISE_M, STAND_S, RoomEvent, before_trial, parse_event
from studies.trials import make_trials

RATE = 15.0
FIRST = np.array([[-0.3, 0.8, 0.0], [0.3, 0.8, 0.0], [0.0, 1.6, 0.1]], dtype=np.float32)
STAND = round(STAND_S * RATE)
NEAR = 6 * NOISE_M


def before(*events, seed=0, first=FIRST):
    return before_trial([parse_event(e) for e in events], first, RATE, np.random.default_rng(seed))


@given(st.sampled_from(["walk=0", "walk=2.5", "nearer=0.5", "stranger=1.5", "blunder=2"]), st.integers(0, 99))
def test_the_person_stands_still_for_a_second_and_the_trial_follows_unchanged(event, seed):
    recording = Recording(np.cumsum(np.repeat(FIRST[None], 20, 0), 0).astype(np.float32), RATE, "bow", "1", "1")
    rng = np.random.default_rng(seed)
    (trial,) = make_trials([recording], onset_known=True, turn=0.0, rng=rng, room=[parse_event(event)])
    whole = trial.recording.positions
    np.testing.assert_array_equal(whole[trial.begin : trial.end], recording.positions)
    assert trial.end == len(whole) and whole.dtype == np.float32
    standing = np.abs(whole[trial.begin - STAND : trial.begin] - FIRST).max(axis=(1, 2))
    assert (standing < NEAR).sum() == STAND - (event == "blunder=2")


def test_a_walk_comes_from_as_far_as_it_says_at_a_persons_pace():
    places = np.array([before("walk=2", seed=seed) for seed in range(20)])[:, :, 2]
    np.testing.assert_allclose(np.linalg.norm(places[:, 0] - FIRST[2], axis=1), 2, atol=NEAR)
    np.testing.assert_allclose(places[:, :, 1], FIRST[2, 1], atol=NEAR)
    assert np.ptp(np.arctan2(*(places[:, 0] - FIRST[2])[:, [0, 2]].T)) > np.pi  # from any side
    assert np.abs(np.diff(places[:, :, [0, 2]], axis=1)).max() * RATE < 3


def test_sizes_by_hand():
    def height(frames):
        return np.ptp(frames[..., 1], axis=-1) / np.ptp(FIRST[:, 1])

    assert height(before("nearer=2"))[0] == pytest.approx(0.5, abs=0.1)
    stranger = before("stranger=1.5")
    assert height(stranger[:30]) == pytest.approx(1.5, abs=0.1) and np.isnan(stranger[30:60]).all()
    assert len(stranger) == 60 + STAND
    tall = height(before("blunder=2")) > 1.5
    assert tall.sum() == 1 and tall[STAND // 2]
    assert len(before("walk=1", "nearer=2")) == 15 + 45 + STAND


def test_a_part_that_is_not_seen_at_first_stays_unseen():
    first = FIRST.copy()
    first[0] = np.nan
    for event in ("walk=1", "nearer=2", "stranger=2", "blunder=2"):
        assert np.isnan(before(event, first=first)[:, 0]).all()
        assert np.isfinite(before(event, first=first)[-STAND:, 1:]).all()


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("dance=1", "--room 'dance=1': EVENT=NUMBER is expected, EVENT one of walk, nearer, stranger, blunder"),
        ("walk", "--room 'walk': EVENT=NUMBER is expected"),
        ("walk=far", "--room 'walk=far': walk takes a number from 0 to 100"),
        ("nearer=0", "--room 'nearer=0': nearer takes a number from 0.1 to 10"),
    ],
)
def test_bad_events_are_one_line(text, error):
    with pytest.raises(BadInput, match=re.escape(error)):
        parse_event(text)


def test_observers_do_not_know_the_onset_in_a_room():
    people = perform(("1", "2"), ("ok", "lunging"), trials=1, seed=3)
    settings = EvaluationSettings(
        (parse_view("door"),), ("ok", "lunging"), train_subjects=("1",), calibrated=False, room=(RoomEvent("walk", 0),)
    )
    for trial in evaluate(people, settings).trials:
        assert trial.trial.begin == round(STAND_S * people.recordings[0].rate_hz)
        np.testing.assert_allclose(trial.views[0, 0], 0.5, atol=0.2)
