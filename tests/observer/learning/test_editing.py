"""A person's own movements: few recordings, cautious calibration; movements added and removed, others unchanged."""

from dataclasses import replace

import numpy as np
import pytest

import labanmesh
from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.commands import describe_evaluation
from observer.learning.cross_validation import evaluate_example, folds_by_person, folds_by_recording
from observer.learning.editing import add_movements, remove_movements
from observer.learning.learn import ExampleView, learn_view
from observer.model.base import Onset
from observer.model.frame_table import learn_table
from observer.model.model_file import read_model, write_model
from observer.model.posterior_calibration import CAUTIOUS, PosteriorCalibration, at_least_cautious
from observer.model.registry import MODELS
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS
from studies.performer import perform

DOOR = parse_view("door")
OLD, NEW = ("ok", "shake"), ("lunging", "byebye")


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), (*OLD, *NEW), trials=3, seed=1)


def some(archive, subjects, labels, trials=3):
    """What the first of these people's recordings hold."""
    chosen, counts = [], {}
    for r in archive.recordings:
        counts[r.subject, r.label] = counts.get((r.subject, r.label), 0) + 1
        if r.subject in subjects and r.label in labels and counts[r.subject, r.label] <= trials:
            chosen.append(r)
    return MotionArchive(archive.body_parts, tuple(chosen))


@pytest.fixture(scope="module", params=list(MODELS))
def model(request, people):
    return learn_view(some(people, ("1", "2"), OLD), DOOR, Vocabulary(OLD), kind=request.param)


@pytest.fixture(scope="module")
def turning(people):
    """Learned at several facings, and what it foresaw of its movements is known."""
    learned = learn_view(
        some(people, ("1", "2"), OLD), DOOR, Vocabulary(OLD), parameters={"facings": 4.0}, calibrate=False
    )
    learned.header = _sure(learned.header)
    return learned


def _sure(header):
    certainty = PosteriorCalibration(1.5, 0.03, ((-2.0, 0.5), (-3.0, 0.7)), 2.0, 1.0)
    return replace(header, calibration=certainty)


def recognised(model, recording):
    watch = model.watch(Onset(True, len(recording.positions)))
    for tracks in view_tracks(DOOR, recording, BODY_PARTS, model.header.body_parts):
        watch.update(tracks)
    return model.header.vocabulary.labels[watch.p.argmax()]


def test_three_recordings_of_one_person_are_a_usable_model(people):
    own = learn_view(some(people, ("1",), (*OLD, NEW[0])), DOOR, Vocabulary((*OLD, NEW[0])))
    others = some(people, ("2", "3"), (*OLD, NEW[0]), trials=1).recordings
    right = [recognised(own, recording) == recording.label for recording in others]
    assert np.mean(right) >= 5 / 6
    assert own.header.calibration == CAUTIOUS
    assert own.header.provenance["tried"] == "9"
    text = describe_evaluation(own.header)
    assert "tried on 9 left-out examples: right" in text and "other people" in text


def test_one_person_alone_is_never_believed_more_than_a_model_that_could_not_be_tried():
    assert at_least_cautious(PosteriorCalibration(0.5, 0.002, ((-1.0, 0.1),), 2.0, 1.0)) == CAUTIOUS
    unsure = at_least_cautious(PosteriorCalibration(4.0, 0.2))
    assert (unsure.temperature, unsure.doubt) == (4.0, 0.2)


def test_many_recordings_of_one_person_are_still_one_person(people):
    many = some(perform(("1",), OLD, trials=10, seed=2), ("1",), OLD, trials=10)
    certainty = learn_view(many, DOOR, Vocabulary(OLD), kind="frame-table").header.calibration
    assert (
        certainty.temperature >= CAUTIOUS.temperature and certainty.doubt >= CAUTIOUS.doubt and not certainty.foreseen
    )


def test_who_is_left_out(people):
    vocabulary, parts = Vocabulary(OLD), people.body_parts

    def of(archive):
        return ExampleView(DOOR, vocabulary, parts).examples(archive.recordings, parts)

    two = of(some(people, ("1", "2"), OLD))
    assert [{two[n].subject for n in out} for out in folds_by_person(two)] == [{"1"}, {"2"}]
    one = of(some(people, ("1",), OLD))
    assert folds_by_person(one) is None
    assert sorted(n for out in folds_by_recording(one) for n in out) == list(range(6))
    assert all(sorted(one[n].movement for n in out) == [0, 1] for out in folds_by_recording(one))


def same(one, other):
    return all((np.asarray(other.arrays()[name]) == values).all() for name, values in one.arrays().items())


def test_adding_and_taking_out_again_leaves_everything_as_it_was(model, people):
    grown = add_movements(model, some(people, ("3",), NEW), DOOR)
    assert grown.labels == NEW and grown.examples == 6 and len(grown.results) == 6
    assert grown.model.header.vocabulary.labels == (*OLD, *NEW)
    assert remove_movements(grown.model, ()).header.vocabulary.labels == (*OLD, *NEW)
    back = remove_movements(grown.model, NEW)
    assert same(model, back) and back.header.calibration == model.header.calibration
    assert back.header.vocabulary == model.header.vocabulary


def test_an_added_movement_is_recognised_and_so_are_the_old_ones(people):
    model = learn_view(some(people, ("1", "2"), OLD), DOOR, Vocabulary(OLD))
    grown = add_movements(model, some(people, ("1", "2"), (NEW[0],)), DOOR).model
    shown = some(people, ("3",), (*OLD, NEW[0]), trials=1).recordings
    assert [recognised(grown, r) for r in shown] == [r.label for r in shown]
    # One between two others taken out moves the last one down.
    kept = remove_movements(grown, ("shake",))
    assert kept.header.vocabulary.labels == ("ok", "lunging")
    assert [recognised(kept, r) for r in shown if r.label != "shake"] == ["ok", "lunging"]


@pytest.mark.parametrize("kind", ["phase-symbols", "frame-table"])
def test_a_table_grows_to_what_it_would_be_had_all_been_learned_at_once(people, kind):
    both = some(people, ("1", "2"), (*OLD, NEW[0]))
    whole = learn_view(both, DOOR, Vocabulary((*OLD, NEW[0])), kind=kind, calibrate=False)
    old = learn_view(some(people, ("1", "2"), OLD), DOOR, Vocabulary(OLD), kind=kind, calibrate=False)
    grown = add_movements(old, both, DOOR).model
    assert (grown.arrays()["log_table"] == whole.arrays()["log_table"]).all()
    kept = remove_movements(grown, ("ok",))
    assert (kept.arrays()["log_table"] == whole.arrays()["log_table"][1:]).all()


def test_the_file_of_a_grown_model_says_what_was_added(model, people, tmp_path):
    grown = add_movements(model, some(people, ("3",), NEW), DOOR, labels=("byebye",), source="own.npz").model
    write_model(tmp_path / "grown.model", grown)
    again = read_model(tmp_path / "grown.model")
    assert same(grown, again) and again.header.provenance["added"] == "byebye: 3 examples of own.npz"
    assert again.header.vocabulary.labels == (*OLD, "byebye")


def test_all_facings_are_learned_of_an_added_movement_and_how_it_is_foreseen(turning, people):
    grown = add_movements(turning, some(people, ("1", "2"), (NEW[0],), trials=2), DOOR).model
    arrays = grown.arrays()
    assert sorted(arrays["facing_of"][arrays["movement_of"] == 2].tolist()) == sorted([0, 1, 2, 3] * 4)
    certainty = grown.header.calibration
    assert (certainty.temperature, certainty.doubt) == (1.5, 0.03)
    assert certainty.foreseen[:2] == turning.header.calibration.foreseen and len(certainty.foreseen) == 3
    assert certainty.foreseen[2][1] >= 0.6, "no narrower than is usual among the others"
    assert remove_movements(grown, ("ok",)).header.calibration.foreseen == certainty.foreseen[1:]


def test_who_judges_an_added_movements_example_has_not_learned_it(turning, people, monkeypatch):
    chains = []

    def looking(model, example):
        chains.append(int((model.arrays()["movement_of"] == 2).sum()))
        return evaluate_example(model, example)

    monkeypatch.setattr("observer.learning.editing.evaluate_example", looking)
    add_movements(turning, some(people, ("1", "2"), (NEW[0],), trials=2), DOOR)
    # The other person's two recordings, from four facings.
    assert chains == [8] * 4
    chains.clear()
    add_movements(turning, some(people, ("3",), (NEW[0],)), DOOR)
    assert chains == [8] * 3


def test_of_one_person_alone_an_added_movement_is_not_expected_to_be_foreseen_better_than_the_others(turning, people):
    once = add_movements(turning, some(people, ("3",), (NEW[0],), trials=1), DOOR)
    assert once.results == () and once.model.header.calibration.foreseen[2] == pytest.approx((-2.5, 0.6))
    thrice = add_movements(turning, some(people, ("3",), (NEW[0],)), DOOR)
    assert len(thrice.results) == 3 and thrice.model.header.calibration.foreseen[2][0] <= -2.5


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"view": parse_view("wheel")}, "--view wheel: the model is for door"),
        ({"kind": "frame-table"}, "--model frame-table: the model is of the kind phase"),
        ({"parameters": {"fast": 2.0}}, "--parameter fast=2: the model has 1.5"),
        ({"parameters": {"fats": 2.0}}, "'fats': not of the model phase"),
        ({"labels": ("ok",)}, "'ok': the model has it"),
        ({"labels": ("jump",)}, "--labels jump: no recording shows this movement"),
    ],
)
def test_what_does_not_fit_the_model_is_refused(turning, people, given, said):
    with pytest.raises(BadInput, match=r"\A[^\n]*\Z") as refused:
        add_movements(turning, some(people, ("3",), (*OLD, *NEW)), **{"view": DOOR, **given})
    assert said in str(refused.value)


def test_other_recordings_than_the_models_are_refused(turning, people):
    fast = MotionArchive(people.body_parts, tuple(replace(r, rate_hz=60.0) for r in people.recordings))
    with pytest.raises(BadInput, match=r"recordings at 60 Hz: the model is for .* add --rate"):
        add_movements(turning, fast, DOOR)
    handless = MotionArchive(
        people.body_parts[:2], tuple(replace(r, positions=r.positions[:, :2]) for r in people.recordings)
    )
    with pytest.raises(BadInput, match="'head': the model needs it"):
        add_movements(turning, handless, DOOR)
    with pytest.raises(BadInput, match="there is nothing to add"):
        add_movements(turning, some(people, ("3",), OLD), DOOR)


def test_two_movements_stay_at_least(turning):
    with pytest.raises(BadInput, match="ok would stay, and at least two are needed"):
        remove_movements(turning, ("shake",))
    with pytest.raises(BadInput, match="'shaek': not in the vocabulary"):
        remove_movements(turning, ("shaek",))


def test_bins_borrow_from_their_neighbours_what_they_lack():
    symbols = np.array([[0], [0], [1], [1], [2], [2]])
    paper = np.exp(learn_table([(symbols, 0)], 1, 3, 0.1))
    borrowed = np.exp(learn_table([(symbols, 0)], 1, 3, 0.1, neighbours=2.0))
    assert np.allclose(borrowed.sum(axis=-1), 1)
    # By hand: the middle bin counts 2 of symbol 1 and .1 of each; beside it are 2 of symbols 0 and 2 each.
    assert borrowed[0, 1, 0, 1] == pytest.approx((2.1 + 2 * 0.1 / 4.9) / (2.9 + 2))
    assert borrowed[0, 1, 0, 0] == pytest.approx((0.1 + 2 * 2.1 / 4.9) / (2.9 + 2))
    assert (np.exp(learn_table([(symbols, 0)], 1, 3, 0.1, neighbours=0.0)) == paper).all()


def run(capsys, *words):
    status = labanmesh.main([str(word) for word in words])
    said = capsys.readouterr()
    return status, said.out, said.err


def test_as_a_person_types_it(capsys, people, tmp_path):
    for name, labels, trials in (("own", OLD, 3), ("more", NEW, 2)):
        write_archive(tmp_path / f"{name}.npz", some(people, ("1",), labels, trials))
    file = tmp_path / "door.model"
    status, out, err = run(capsys, "learn", tmp_path / "own.npz", "--view", "door", "-o", file)
    assert (status, err) == (0, "") and "tried on 6 left-out examples: right" in out and "temperature 1.3" in out
    before = read_model(file)
    words = ["learn", tmp_path / "more.npz", "--view", "door", "--labels", "byebye"]
    status, out, err = run(capsys, *words, "--add-to", file, "-o", file)
    assert (
        status == 0
        and "byebye added from 2 examples of 1 person; 3 movements now" in out
        and "all observers of the scene" in out
    )
    assert "tried on 2 left-out examples of byebye: right" in out
    assert err == "warning: byebye: 2 recordings; record it at least 3 times\n"
    status, _, err = run(capsys, *words, "--add-to", file, "--effort", "-o", file)
    assert status == 2 and err.count("\n") == 1
    status, out, _ = run(capsys, "forget", file, "--labels", "byebye", "-o", file)
    assert status == 0 and "byebye taken out; 2 movements now" in out
    assert same(before, read_model(file))
