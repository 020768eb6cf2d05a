"""A person's own movements: few recordings; movements added and removed, others unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from performances import DOOR, recordings_of, watching

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.descriptions import describe_evaluation
from observer.learning.editing import add_movements, remove_movements
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.model_file import read_model, write_model
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform

OLD, NEW = ("ok", "shake"), ("lunging", "byebye")
SMALL = {"kernels": 84.0}


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), (*OLD, *NEW), trials=3, seed=1)


@pytest.fixture(scope="module")
def model(people):
    old = recordings_of(people, ("1", "2"), OLD, trials=2)
    return learn_view(old, DOOR, Vocabulary(OLD), parameters=SMALL)


@pytest.fixture(scope="module")
def with_facings(people):
    """A model of several facings."""
    parameters = {"facings": 4.0, **SMALL}
    old = recordings_of(people, ("1", "2"), OLD, trials=1)
    return learn_view(old, DOOR, Vocabulary(OLD), parameters=parameters, calibrate=False)


def recognised(model, recording):
    *_, watch = watching(model, recording, Onset(True, len(recording.positions)))
    return model.header.vocabulary.labels[watch.p.argmax()]


@pytest.mark.parametrize("kind", ["phase", "stacked"])
def test_three_recordings_of_one_person_are_a_usable_model(people, kind):
    own = learn_view(recordings_of(people, ("1",), (*OLD, NEW[0])), DOOR, Vocabulary((*OLD, NEW[0])), kind=kind)
    others = recordings_of(people, ("2", "3"), (*OLD, NEW[0]), trials=1).recordings
    right = [recognised(own, recording) == recording.label for recording in others]
    assert np.mean(right) >= 5 / 6
    assert own.header.provenance["tried"] == "9"
    text = describe_evaluation(own.header)
    assert "tried on 9 left-out examples: right" in text and ("weighed by that" in text) == (kind == "stacked")


def same(one, other):
    """The stacker and the chains are learned again, from examples that have passed through a file's precision."""
    pairs = {name: (values, np.asarray(other.arrays()[name])) for name, values in one.arrays().items()}
    learned_again = [name for name in pairs if name.startswith("stacker") or name == "chains"]
    alike = [np.allclose(*pairs.pop(name), atol=1e-3) for name in learned_again]
    return all(alike) and all((one == two).all() for one, two in pairs.values())


def test_adding_and_removing_movements_restores_the_model(model, people):
    grown = add_movements(model, recordings_of(people, ("3",), NEW), DOOR)
    assert grown.labels == NEW and grown.examples == grown.tried == 6
    assert grown.model.header.vocabulary.labels == (*OLD, *NEW)
    assert remove_movements(grown.model, ()).header.vocabulary.labels == (*OLD, *NEW)
    back = remove_movements(grown.model, NEW)
    assert same(model, back)
    assert back.header.vocabulary == model.header.vocabulary


@pytest.mark.parametrize(
    ("before", "newcomers", "trials"),
    [("1", "2", 2), ("12", "12", 2), ("1", "1", 1)],
    ids=["a second person", "the same people", "one take each"],
)
def test_a_movement_added_is_as_one_learned_at_once(people, before, newcomers, trials):
    old, new = recordings_of(people, before, OLD, trials), recordings_of(people, newcomers, (NEW[0],), trials)
    both, parameters = MotionArchive(people.body_parts, (*old.recordings, *new.recordings)), SMALL
    grown = add_movements(learn_view(old, DOOR, Vocabulary(OLD), parameters=parameters), new, DOOR).model
    whole = learn_view(both, DOOR, Vocabulary((*OLD, NEW[0])), parameters=parameters)
    assert grown.header.parameters == whole.header.parameters
    assert grown.header.provenance.get("held_out") == whole.header.provenance.get("held_out")
    for name, values in whole.arrays().items():
        added = grown.arrays()[name]
        assert np.array_equal(values, added) or np.allclose(values, added, atol=1e-4), name
    for recording in recordings_of(people, "3", (*OLD, NEW[0]), trials=1).recordings:
        for one, other in zip(*(watching(m, recording, Onset(True)) for m in (grown, whole)), strict=True):
            assert np.abs(one.p - other.p).max() < 0.03
            assert abs(one.unlearned - other.unlearned).max() < 0.03


@pytest.mark.parametrize(("kind", "facings"), [("phase", 1), ("frame-table", 1), ("stacked", 12)])
def test_a_model_without_all_its_takes_is_not_edited(people, kind, facings):
    parameters = {"facings": float(facings), **SMALL} if kind == "stacked" else {}
    old = recordings_of(people, ("1",), OLD, trials=1)
    learned = learn_view(old, DOOR, Vocabulary(OLD), kind=kind, parameters=parameters, calibrate=False)
    for edit in (
        lambda: add_movements(learned, recordings_of(people, ("1",), NEW), DOOR),
        lambda: remove_movements(replaced_labels(learned), ("ok",)),
    ):
        with pytest.raises(BadInput, match=rf"model {kind}: does not keep all its takes; learn it again"):
            edit()


def replaced_labels(model):
    """The model with a third label, so that one may go."""
    model.header = replace(model.header, vocabulary=Vocabulary((*OLD, "point")))
    return model


def test_the_file_of_an_edited_model_names_what_was_added(model, people, tmp_path):
    grown = add_movements(model, recordings_of(people, ("3",), NEW), DOOR, labels=("byebye",), source="own.npz").model
    write_model(tmp_path / "grown.model", grown)
    again = read_model(tmp_path / "grown.model")
    assert same(grown, again) and again.header.provenance["added"] == "byebye: 3 examples of own.npz"
    assert again.header.vocabulary.labels == (*OLD, "byebye")


def test_an_added_movement_has_all_facings(with_facings, people):
    grown = add_movements(with_facings, recordings_of(people, ("1", "2"), (NEW[0],), trials=1), DOOR).model
    arrays = grown.arrays()
    assert sorted(arrays["facing_of"][arrays["movement_of"] == 2].tolist()) == sorted([0, 1, 2, 3] * 2)
    assert recognised(grown, recordings_of(people, ("3",), (NEW[0],), trials=1).recordings[0]) == NEW[0]


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"view": parse_view("wheel")}, "--view wheel: the model is for door"),
        ({"kind": "frame-table"}, "--model frame-table: the model is of the kind stacked"),
        ({"parameters": {"fast": 2.0}}, "--parameter fast=2: the model has 1.5"),
        ({"parameters": {"fats": 2.0}}, "'fats': not of the model stacked"),
        ({"labels": ("ok",)}, "'ok': the model has it"),
        ({"labels": ("jump",)}, "--labels jump: no recording shows this movement"),
    ],
)
def test_what_does_not_fit_the_model_is_rejected(with_facings, people, options, error):
    with pytest.raises(BadInput, match=r"\A[^\n]*\Z") as rejected:
        add_movements(with_facings, recordings_of(people, ("3",), (*OLD, *NEW)), **{"view": DOOR, **options})
    assert error in str(rejected.value)


def test_recordings_of_another_rate_or_without_parts_are_rejected(with_facings, people):
    fast = MotionArchive(people.body_parts, tuple(replace(r, rate_hz=60.0) for r in people.recordings))
    with pytest.raises(BadInput, match=r"recordings at 60 Hz: the model is for .* add --rate"):
        add_movements(with_facings, fast, DOOR)
    handless = MotionArchive(
        people.body_parts[:2], tuple(replace(r, positions=r.positions[:, :2]) for r in people.recordings)
    )
    with pytest.raises(BadInput, match="'head': the model needs it"):
        add_movements(with_facings, handless, DOOR)
    with pytest.raises(BadInput, match="there is nothing to add"):
        add_movements(with_facings, recordings_of(people, ("3",), OLD), DOOR)


def test_at_least_two_movements_remain(with_facings):
    with pytest.raises(BadInput, match="ok would stay, and at least two are needed"):
        remove_movements(with_facings, ("shake",))
    with pytest.raises(BadInput, match="'shaek': not in the vocabulary"):
        remove_movements(with_facings, ("shaek",))


def test_add_and_forget_on_the_command_line(run, people, tmp_path):
    for name, labels, trials in (("own", OLD, 3), ("more", NEW, 2)):
        write_archive(tmp_path / f"{name}.npz", recordings_of(people, ("1",), labels, trials))
    file = tmp_path / "door.model"
    status, out, err = run("learn", tmp_path / "own.npz", "--model", "phase", "--view", "door", "-o", file)
    assert (status, err) == (0, "") and "tried on 6 left-out examples: right" in out
    status, out, err = run("learn", tmp_path / "own.npz", "--view", "door", "-o", file)
    assert (status, err) == (0, "") and "tried on 6 left-out examples: right" in out
    before = read_model(file)
    words = ["learn", tmp_path / "more.npz", "--view", "door", "--labels", "byebye"]
    status, out, err = run(*words, "--add-to", file, "-o", file)
    assert status == 0 and "byebye added from 2 examples of 1 person; 3 movements now" in out
    assert "all observers of the scene" in out
    assert "tried on 2 left-out examples of byebye: right" in out
    assert err == "warning: byebye: 2 recordings; record it at least 3 times\n"
    status, _, err = run(*words, "--add-to", file, "--effort", "-o", file)
    assert status == 2 and err.count("\n") == 1
    status, _, err = run("forget", file, "--labels", "AS1", "-o", file)
    assert status == 2 and "horizontal_arm_wave" in err
    status, out, _ = run("forget", file, "--labels", "byebye", "-o", file)
    assert status == 0 and "byebye taken out; 2 movements now" in out
    assert same(before, read_model(file))
