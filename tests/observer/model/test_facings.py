"""Models of several facings recognise a person in any direction, and the direction."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from performances import DOOR

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import turned
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.model_file import read_model, write_model
from observer.model.parameters import facings_in
from observer.motion.archive import select
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS
from studies.performer import perform

LABELS = ("ok", "shake", "lunging")


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), LABELS, trials=2, seed=3)


@pytest.fixture(scope="module")
def model_of(people):
    """Models of two people by number of facings and kind; the stacker learns how far to trust the phase filter."""

    @cache
    def model(facings, kind="phase"):
        two, parameters = select(people, ("1", "2")), {"facings": float(facings)}
        calibrate = kind == "stacked"
        return learn_view(two, DOOR, Vocabulary(LABELS), kind=kind, parameters=parameters, calibrate=calibrate)

    return model


def watched(model, recording, turn_deg=0.0):
    """The posteriors of a person who has turned to their left."""
    facing_away = replace(recording, positions=turned(recording.positions, math.radians(turn_deg)))
    onset = Onset(True, len(recording.positions))
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, onset)
    return [observer.step(frame) for frame in frames_of(facing_away)]


def third(people):
    return [recording for recording in people.recordings if recording.subject == "3"]


def label_of(posterior):
    return LABELS[posterior.p.argmax()]


@pytest.mark.parametrize(("facings", "kind"), [(8, "phase"), (12, "phase"), (12, "stacked")])
@pytest.mark.parametrize("turn_deg", [0, 90, 180])
def test_movement_and_facing_of_a_turned_person_are_recognised(model_of, people, facings, kind, turn_deg):
    for recording in third(people)[::2]:
        last = watched(model_of(facings, kind), recording, turn_deg)[-1]
        assert label_of(last) == recording.label
        faced = last.p @ last.facing
        assert faced.argmax() * 360 / facings == turn_deg and faced.max() > 2 / facings


def test_facings_are_distributions_for_each_movement(model_of, people):
    for posterior in watched(model_of(8), third(people)[0]):
        assert posterior.p.shape == (3,) and posterior.p.sum() == pytest.approx(1)
        assert posterior.facing.shape == (3, 8) and posterior.facing.sum(axis=1) == pytest.approx(np.ones(3))


def test_the_file_contains_facings(model_of, people, tmp_path):
    write_model(tmp_path / "a.model", model_of(8))
    again = read_model(tmp_path / "a.model")
    assert again.header.parameters["facings"] == 8
    assert np.bincount(again.arrays()["facing_of"]).tolist() == [12] * 8
    recording = third(people)[0]
    for one, other in zip(watched(model_of(8), recording, 180), watched(again, recording, 180), strict=True):
        np.testing.assert_array_equal(one.p, other.p)
        np.testing.assert_array_equal(one.facing, other.facing)
        assert one.unlearned == other.unlearned


@pytest.mark.parametrize("facings", [1, 12])
def test_a_still_person_is_at_rest_with_any_number_of_facings(model_of, people, facings):
    standing = np.repeat(third(people)[0].positions[:1], 60, axis=0)
    trembling = standing + np.random.default_rng(0).normal(0, 0.01, standing.shape)
    still = replace(third(people)[0], positions=trembling.astype(np.float32))
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model_of(facings))
    assert all(observer.step(frame).rest > 0.5 for frame in frames_of(still))


@pytest.mark.parametrize("facings", [0, 0.5, 1.5, 73, -8, math.nan, math.inf])
def test_an_invalid_number_of_facings_is_rejected(facings):
    with pytest.raises(BadInput, match=r"facings = .*: a whole number from 1 to 72 is expected"):
        facings_in({"facings": facings})
