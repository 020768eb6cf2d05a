"""The phase model's posteriors do not depend on the frame rate: its constants are per 1/15 s."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import Example, Header, Onset, with_defaults
from observer.model.body_trace import resampled
from observer.model.phase import STEP_SHARES, Phase, chain_dynamics, step_probabilities
from observer.motion.archive import MotionArchive, Recording, resample
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS

NAMES = Vocabulary(("raise", "wave"))


@given(st.floats(0.05, 4.0))
def test_the_mean_number_of_phases_is_proportional_to_time(share):
    steps = step_probabilities(share)
    assert steps.sum() == pytest.approx(1) and (steps >= 0).all()
    assert steps @ np.arange(len(steps)) == pytest.approx(share * np.dot(STEP_SHARES, range(len(STEP_SHARES))))


def test_probabilities_per_fifteenth_of_a_second_become_those_per_frame():
    parameters = {"begin": 0.05, "forget": 0.01, "abandon": 0.02, "settled": 15.0}
    for frames, share in ((2, 0.5), (4, 0.25)):
        dynamics = chain_dynamics(parameters, share, onset_known=False)
        for name in ("begin", "forget", "abandon"):
            assert (1 - getattr(dynamics, name)) ** frames == pytest.approx(1 - parameters[name])
        assert dynamics.settled == 15.0 * frames
    assert chain_dynamics(parameters, 0.5, onset_known=True).settled == np.inf


def header(rate_hz):
    own = Header("phase", NAMES, "door", DOOR.matrix, rate_hz, BODY_PARTS, {"outlier": 500.0})
    return with_defaults(own, Phase.PARAMETERS)


def log_likelihoods(rate_hz, features):
    """(Φ, 2) up to a constant, of two chains of 8 postures."""
    chains = np.random.default_rng(0).normal(0, 1, (2, 8, 17)).astype(np.float32)
    model = Phase(header(rate_hz), chains, np.arange(2), np.zeros(2, np.int64))
    likelihood, _ = model.evidence().see(features).chains(None, 8)
    return np.log(likelihood)


def test_the_evidence_of_a_frame_is_spread_over_the_frames_of_a_fifteenth_of_a_second():
    features = np.random.default_rng(1).normal(0, 1, 17)
    np.testing.assert_allclose(2 * log_likelihoods(30.0, features), log_likelihoods(15.0, features), rtol=1e-3)


def test_a_phase_lasts_a_fifteenth_of_a_second_at_any_frame_rate():
    rows = np.random.default_rng(0).normal(0, 1, (60, 17))
    examples = [Example((), movement, features=rows[:frames]) for movement in (0, 1) for frames in (24, 40, 60)]
    for rate_hz, phases in ((15.0, 40), (30.0, 20), (7.5, 80)):
        assert Phase.learn(header(rate_hz), examples).arrays()["chains"].shape[1] == phases


@given(frames=st.integers(2, 30), phases=st.integers(2, 30))
def test_phases_lie_evenly_between_the_first_and_the_last_frame(frames, phases):
    rows = np.random.default_rng(frames).normal(0, 1, (frames, 2))
    at = np.linspace(0, frames - 1, phases)
    expected = np.stack([np.interp(at, np.arange(frames), column) for column in rows.T], axis=1)
    np.testing.assert_allclose(resampled(rows, phases), expected, atol=1e-9)


def performed(label, size):
    t = np.linspace(0, 1, 31)
    up = np.sin(np.pi * t)
    aside = 0.3 * np.sin(6 * np.pi * t) * up if label == "wave" else 0 * t
    positions = np.zeros((len(t), 3, 3))
    positions[:, 0] = (-0.25, -0.6, 0)
    positions[:, 1] = np.stack([0.25 + aside, -0.6 + up, 0 * t], axis=1)
    return Recording((positions * size).astype(np.float32), 15.0, label, str(size), "1")


def surety(rate_hz, label):
    people = [resample(performed(name, size), rate_hz) for name in NAMES.labels for size in (0.9, 1.0, 1.1)]
    model = learn_view(MotionArchive(BODY_PARTS, tuple(people)), DOOR, NAMES, calibrate=False)
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, Onset(known=True))
    shown = list(frames_of(resample(performed(label, 1.05), rate_hz)))
    return [observer.step(frame).p[NAMES.index(label)] for frame in shown][round(0.3 * len(shown))]


@pytest.mark.parametrize("label", NAMES.labels)
def test_twice_the_frame_rate_gives_the_same_posterior(label):
    odds = [np.log(p / (1 - p)) for p in (surety(15.0, label), surety(30.0, label))]
    assert odds[1] == pytest.approx(odds[0], abs=max(0.5, 0.4 * abs(odds[0])))
