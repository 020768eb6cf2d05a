"""Models with a background: "something else" in posteriors, files and edits, and what is rejected."""

from dataclasses import replace

import numpy as np
import pytest
from performances import DOOR, recordings_of, watching

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.learning.editing import add_movements, remove_movements
from observer.learning.examples import gather_background
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.model_file import read_model
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS
from studies.performer import perform

WORDS = Vocabulary(("ok", "shake"))
ELSE = ("byebye", "lunging")
KNOWN = Onset(known=True)
SMALL = {"kernels": 84.0}


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), (*WORDS.labels, *ELSE), trials=1, seed=1)


@pytest.fixture(scope="module")
def background(people):
    return recordings_of(people, "12", ELSE)


@pytest.fixture(scope="module")
def model(people, background):
    learned = recordings_of(people, "12", WORDS.labels)
    return learn_view(learned, DOOR, WORDS, parameters=SMALL, calibrate=False, background=background)


def test_a_movement_outside_the_vocabulary_is_unlearned(model, people):
    tracker = ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS)
    ends = {}
    for recording in recordings_of(people, "3", (*WORDS.labels, "byebye")).recordings:
        observer = Observer(tracker, model, KNOWN)
        ends[recording.label] = [observer.step(frame) for frame in frames_of(recording)][-1]
    assert ends["byebye"].unlearned > 0.5
    assert max(ends[label].unlearned for label in WORDS.labels) < 0.5
    assert all(end.p.sum() == pytest.approx(1) and end.facing is None for end in ends.values())


def test_without_recordings_blends_are_something_else(people):
    learned = recordings_of(people, "12", WORDS.labels)
    blends = MotionArchive(learned.body_parts, ())
    model = learn_view(learned, DOOR, WORDS, parameters=SMALL, calibrate=False, background=blends)
    assert model.header.background == ()
    (shown,) = recordings_of(people, "3", ("lunging",)).recordings
    *_, watch = watching(model, shown, KNOWN)
    assert watch.unlearned.shape == (1,) and watch.unlearned.sum() > 0.5


def test_editing_keeps_the_background_except_for_promoted_movements(model, people):
    grown = add_movements(model, recordings_of(people, "12", (*WORDS.labels, "lunging")), DOOR)
    assert grown.promoted == ("lunging",) and grown.model.header.background == ("byebye",)
    assert sorted(set(grown.model.arrays()["example_movements"].tolist())) == [-1, 0, 1, 2]
    back = remove_movements(grown.model, ("lunging",))
    assert back.header.background == ("byebye",) and back.header.vocabulary.labels == WORDS.labels
    smaller = remove_movements(grown.model, ("ok",))
    assert smaller.arrays()["example_movements"].min() == -1
    assert smaller.header.vocabulary.labels == ("shake", "lunging")


def test_background_recordings_get_the_models_parts_and_rate(people):
    turned = MotionArchive(
        BODY_PARTS[::-1],
        tuple(replace(r, positions=r.positions[:, ::-1]) for r in recordings_of(people, "3", ELSE).recordings),
    )
    gathered = gather_background([recordings_of(people, "1", ELSE), turned], ("lunging",), BODY_PARTS, 10.0)
    assert [(r.subject, r.label, r.rate_hz) for r in gathered.recordings] == [
        ("1", "lunging", 10.0),
        ("3", "lunging", 10.0),
    ]
    (as_it_was,) = recordings_of(people, "3", ("lunging",)).recordings
    np.testing.assert_array_equal(gathered.recordings[1].positions[0], as_it_was.positions[0])
    with pytest.raises(BadInput, match="no 'nose' in its recordings, which the model needs"):
        gather_background([turned], (), ("nose",), 10.0)


@pytest.fixture
def archives(people, tmp_path):
    write_archive(tmp_path / "own.npz", recordings_of(people, "12", WORDS.labels))
    write_archive(tmp_path / "all.npz", people)
    return tmp_path


def test_learn_and_add_on_the_command_line(run, archives):
    words = ["learn", archives / "own.npz", "--view", "door", "-o", archives / "a.model"]
    _, out, _ = run(*words)
    assert "something else is known by blends of the movements; --background adds recordings" in out
    status, out, _ = run(*words, "--background", archives / "all.npz", "--background-labels", "byebye")
    assert status == 0 and "something else is known by blends of the movements and by byebye" in out
    more = ["learn", archives / "all.npz", "--view", "door", "-o", archives / "a.model", "--add-to"]
    status, out, _ = run(*more, archives / "a.model", "--labels", "byebye")
    assert status == 0 and "no longer something else: byebye" in out
    assert read_model(archives / "a.model").header.background == ()


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--background", "all.npz"], "background: 'ok' is among the movements that are learned; name others"),
        (["--background", "all.npz", "--background-labels", "AS2"], "high_arm_wave: no recording shows this movement"),
        (["--background", "blends"], "every model learns blends by itself; leave it out, or name an archive"),
        (["--background-labels", "byebye"], "of which archive? name it with --background"),
        (["--background", "none.npz"], "none.npz"),
        (["--background", "all.npz", "--model", "frame-table"], "frame-table: learns no background; leave it out"),
        (["--background", "all.npz", "--add-to", "a.model"], "--background: only for a new model"),
    ],
)
def test_an_invalid_background_is_one_line_and_exit_2(run, archives, monkeypatch, words, error):
    monkeypatch.chdir(archives)
    status, _, err = run("learn", "own.npz", "--view", "door", "-o", "new.model", *words)
    assert status == 2 and error in err and err.count("\n") == 1
    assert not (archives / "new.model").exists()
