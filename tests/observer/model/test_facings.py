"""A model that was learned at several facings: whoever faces wherever is recognised, and it is known where."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view, turned
from observer.learning.learn import learn_view
from observer.model.base import MOST_FACINGS, Onset, facings_in
from observer.model.model_file import read_model, write_model
from observer.model.posterior_calibration import PosteriorCalibration
from observer.motion.projected import ProjectedTracker, frames_of
from observer.motion.transforms import select
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS
from studies.performer import perform

LABELS = ("ok", "shake", "lunging")
DOOR = parse_view("door")


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), LABELS, trials=2, seed=3)


@pytest.fixture(scope="module")
def model_of(people):
    """Learned from two people at so many facings, one model for each number."""

    @cache
    def model(facings):
        two, given = select(people, ("1", "2")), {"facings": float(facings)}
        return learn_view(two, DOOR, Vocabulary(LABELS), parameters=given, calibrate=False)

    return model


@pytest.fixture(scope="module")
def tried():
    """Learned at two facings from people who showed each movement often enough to try it on them."""
    archive = perform(("1", "2"), LABELS, trials=4, seed=3)
    return learn_view(archive, DOOR, Vocabulary(LABELS), parameters={"facings": 2.0})


def watched(model, recording, turn_deg=0.0):
    """What is believed of a person who has turned to his left."""
    away = replace(recording, positions=turned(recording.positions, math.radians(turn_deg)))
    onset = Onset(True, len(recording.positions))
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, onset)
    return [observer.step(frame) for frame in frames_of(away)]


def third(people):
    return [recording for recording in people.recordings if recording.subject == "3"]


def named(opinion):
    return LABELS[opinion.p.argmax()]


@pytest.mark.parametrize("facings", [8, 12])
@pytest.mark.parametrize("turn_deg", [0, 90, 180])
def test_who_has_turned_is_recognised_and_his_facing_found(model_of, people, facings, turn_deg):
    for recording in third(people):
        last = watched(model_of(facings), recording, turn_deg)[-1]
        assert named(last) == recording.label
        faced = last.p @ last.facing
        assert faced.argmax() * 360 / facings == turn_deg and faced.max() > 2 / facings


def test_learned_at_one_facing_he_is_taken_for_another(model_of, people):
    model = model_of(1)
    assert all(named(watched(model, recording)[-1]) == recording.label for recording in third(people))
    lunges = [recording for recording in third(people) if recording.label == "lunging"]
    assert lunges and all(named(watched(model, recording, 90)[-1]) != "lunging" for recording in lunges)


def test_movement_and_facing_are_one_belief(model_of, people):
    watch, tracker = model_of(8).watch(Onset()), ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS)
    assert watch.joint == pytest.approx(np.full((3, 8), 1 / 24))
    for frame in frames_of(third(people)[0]):
        watch.update(tracker.update(frame))
        assert watch.joint.shape == (3, 8) and watch.joint.sum() == pytest.approx(1)
        assert watch.joint.sum(axis=1) == pytest.approx(watch.p)


@pytest.mark.parametrize("certainty", [PosteriorCalibration(), PosteriorCalibration(3.0, 0.1)])
def test_the_facing_is_told_for_each_movement_it_may_be(model_of, people, certainty):
    model = model_of(8)
    believed = type(model).from_arrays(replace(model.header, calibration=certainty), model.arrays())
    for opinion in watched(believed, third(people)[0]):
        assert opinion.p.shape == (3,) and opinion.p.sum() == pytest.approx(1)
        assert opinion.facing.shape == (3, 8) and opinion.facing.sum(axis=1) == pytest.approx(np.ones(3))
        assert (opinion.facing * opinion.p[:, None] >= certainty.doubt / 24 - 1e-12).all()


def test_a_model_of_one_facing_says_none(model_of, people):
    assert model_of(1).watch(Onset()).joint is None
    assert watched(model_of(1), third(people)[0])[-1].facing is None


def test_the_file_keeps_facings_and_certainty(tried, people, tmp_path):
    write_model(tmp_path / "a.model", tried)
    again = read_model(tmp_path / "a.model")
    assert again.header.calibration == tried.header.calibration != PosteriorCalibration()
    assert again.header.parameters["facings"] == 2 and len(again.header.calibration.foreseen) == 3
    assert np.bincount(again.arrays()["facing_of"]).tolist() == [24, 24]
    recording = third(people)[0]
    for one, other in zip(watched(tried, recording, 180), watched(again, recording, 180), strict=True):
        np.testing.assert_array_equal(one.p, other.p)
        np.testing.assert_array_equal(one.facing, other.facing)
        assert one.unlearned == other.unlearned


def test_a_file_from_before_certainty_is_believed_as_it_is(model_of, tmp_path):
    model = model_of(1)
    write_model(tmp_path / "a.model", model)
    with np.load(tmp_path / "a.model") as stored:
        arrays = dict(stored)
    arrays["header"] = np.array(str(arrays["header"]).replace('"certainty"', '"other"'))
    with (tmp_path / "b.model").open("wb") as file:
        np.savez(file, **arrays)
    assert read_model(tmp_path / "b.model").header.calibration == PosteriorCalibration()


@pytest.mark.parametrize("facings", [1, 12])
def test_who_stands_still_is_at_rest_however_many_ways_he_may_face(model_of, people, facings):
    standing = np.repeat(third(people)[0].positions[:1], 60, axis=0)
    trembling = standing + np.random.default_rng(0).normal(0, 0.01, standing.shape)
    still = replace(third(people)[0], positions=trembling.astype(np.float32))
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model_of(facings))
    assert all(observer.step(frame).rest > 0.5 for frame in frames_of(still))


def told(opinions):
    """What was said of the unlearned last, before the person came to rest."""
    return [opinion.unlearned for opinion in opinions if opinion.unlearned is not None][-1]


def test_what_was_never_learned_is_likelier_to_be_something_else(tried, people):
    strange = perform(("3",), ("byebye",), trials=2, seed=3).recordings
    own, other = ([told(watched(tried, r)) for r in shown] for shown in (third(people), strange))
    assert np.mean(own) < 1 / 4 < np.mean(other)


def test_nothing_is_said_of_the_unlearned_before_anybody_moves(tried, people):
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), tried)
    still = replace(third(people)[0], positions=np.repeat(third(people)[0].positions[:1], 30, axis=0))
    opinions = [observer.step(frame) for frame in frames_of(still)]
    assert all(opinion.unlearned is None for opinion in opinions)


@pytest.mark.parametrize("facings", [0, 0.5, 1.5, MOST_FACINGS + 1, -8, math.nan, math.inf])
def test_what_is_no_number_of_facings_is_one_clear_line(facings):
    with pytest.raises(BadInput, match=r"facings = .*: a whole number from 1 to 72 is expected"):
        facings_in({"facings": facings})


def test_facings_are_one_unless_asked_for():
    assert (facings_in({}), facings_in({"facings": 12.0}), facings_in({"facings": 72.0})) == (1, 12, 72)
