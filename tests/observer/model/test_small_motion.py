"""Motion too small for any learned movement is something else: standing, trembling, shifting one's weight."""

import numpy as np
import pytest
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.body_trace import extent
from observer.motion.projected import view_tracks
from observer.tracks import Tracks
from studies.performer import perform

LABELS = ("ok", "shake")


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2"), LABELS, trials=2, seed=2)


@pytest.fixture(scope="module")
def model(people):
    return learn_view(people, DOOR, Vocabulary(LABELS), kind="stacked")


def centres_of(people, number=0):
    recording = people.recordings[number]
    return np.array([t.centres for t in view_tracks(DOOR, recording, people.body_parts, people.body_parts)])


def something_else(model, centres):
    """P(something else) in each frame."""
    watch, result = model.watch(Onset()), []
    for frame in centres:
        watch.update(Tracks(frame))
        result.append(float(watch.unlearned[0]))
    return np.array(result)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_a_person_who_holds_any_posture_does_something_else(people, model, share):
    centres, rate = centres_of(people), round(model.header.rate_hz)
    held = np.repeat(centres[round(share * (len(centres) - 1))][None], 3 * rate, axis=0)
    standing = something_else(model, held)
    assert standing.min() > 0.8 and standing[rate // 3 :].min() > 0.9
    stopped = np.concatenate([centres[: round(share * len(centres))], held])
    assert something_else(model, stopped)[-rate:].min() > 0.6
    watch = model.watch(Onset())
    for frame in stopped:
        watch.update(Tracks(frame))
    assert watch.rest > 0.5


def test_a_shift_of_weight_is_something_else(people, model):
    centres, rate = centres_of(people), round(model.header.rate_hz)
    shown = np.repeat(centres[:1], 4 * rate, axis=0)
    size = np.ptp(centres[0], axis=0).max()
    shown[..., 0] += 0.4 * size * np.sin(2 * np.pi * 0.5 * np.arange(len(shown)) / rate)[:, None]
    assert something_else(model, shown).min() > 0.65


def test_movements_are_large_enough(people, model):
    for number in range(len(people.recordings)):
        assert something_else(model, centres_of(people, number)).min() < 0.5


def test_extent_is_that_of_the_part_that_goes_farthest():
    rows = np.zeros((5, 2 * 2 + 3), np.float32)
    rows[:, 2] = [0, 3, 1, 0, 0]
    rows[:, 3] = [0, 0, 4, 0, 0]
    rows[:, -3] = [0, 9, 9, 9, 9]
    assert extent(rows, 15.0) == pytest.approx(5.0)
    assert extent(rows, 1.0) == 0.0
    rows[:, -2] = [0, 0, 0, 0, 12]
    assert extent(rows, 15.0) >= 12.0
