"""The phase model's posteriors do not depend on the frame rate: its constants are per 1/15 s."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.chain_dynamics import STEPS, step_probabilities
from observer.motion.archive import MotionArchive, Recording, resample
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS

NAMES = Vocabulary(("raise", "wave"))


@given(st.floats(0.05, 4.0))
def test_the_mean_number_of_phases_is_proportional_to_time(share):
    steps = step_probabilities(share)
    assert steps.sum() == pytest.approx(1) and (steps >= 0).all()
    assert steps @ np.arange(len(steps)) == pytest.approx(share * np.dot(STEPS, range(len(STEPS))))


def test_one_fifteenth_of_a_second_is_a_step():
    np.testing.assert_allclose(step_probabilities(1.0), STEPS)


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
