"""Models with a background: "something else" in posteriors, files and edits, and what is rejected."""

from dataclasses import replace

import numpy as np
import pytest
from performances import DOOR, recordings_of, watching

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.features import PostureReader, without_motion
from observer.filtering.phase_filter import Dynamics, PhaseFilter
from observer.learning.editing import add_movements, remove_movements
from observer.learning.examples import ExampleView, gather_background
from observer.learning.learn import evaluate_example, learn_view, with_calibration
from observer.model.base import Onset
from observer.model.chain_dynamics import ENTRY, step_probabilities
from observer.model.chains import blend_pairs
from observer.model.model_file import read_model, write_model
from observer.model.phase import Phase
from observer.model.posterior_calibration import (
    HeldOutResult,
    PosteriorCalibration,
    answer_posterior,
    fit_calibration,
    given_learned,
)
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.motion.projected import ProjectedTracker, frames_of, view_tracks
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS
from studies.performer import perform

WORDS = Vocabulary(("ok", "shake"))
ELSE = ("byebye", "lunging")
KNOWN = Onset(known=True)


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), (*WORDS.labels, *ELSE), trials=1, seed=1)


@pytest.fixture(scope="module")
def background(people):
    return recordings_of(people, "12", ELSE)


@pytest.fixture(scope="module")
def model(people, background):
    return learn_view(
        recordings_of(people, "12", WORDS.labels), DOOR, WORDS, kind="phase", calibrate=False, background=background
    )


def test_the_posterior_is_that_of_the_phase_filter_with_one_more_movement(model, people):
    """Oracle: the plain filter, its evidence written down here, one more movement of the background and the blends."""
    arrays, shares = model.arrays(), step_probabilities(15.0 / model.header.rate_hz)
    own, of_own = arrays["chains"].astype(float), arrays["movement_of"]
    one, other = blend_pairs(of_own, arrays["facing_of"])
    chains = np.concatenate([own, (own[one] + own[other]) / 2])
    answer_of = np.concatenate([np.where(of_own < 0, 2, of_own), np.full(len(one), 2)])
    share, parameters = 15.0 / model.header.rate_hz, model.header.parameters
    rates = (1 - (1 - parameters[name]) ** share for name in ("begin", "forget", "abandon"))
    dynamics = Dynamics(shares[None], np.ones(1), np.ones((1, 1)), np.array(ENTRY), *rates)
    oracle = PhaseFilter(answer_of, chains.shape[1], np.full(3, 1 / 3), dynamics, onset_known=True)
    reader = PostureReader(BODY_PARTS, model.header.rate_hz, parameters["fast"], parameters["apart"])
    (shown,) = recordings_of(people, "3", ("byebye",)).recordings
    frames = iter(view_tracks(DOOR, shown, BODY_PARTS, BODY_PARTS))
    for n, watch in enumerate(watching(model, shown, KNOWN)):
        if n == 12:
            break
        features = reader.update(next(frames))
        likelihood = np.exp(-share * parameters["sharpness"] * squared(features, chains))
        log = np.log(likelihood + np.exp(-share * parameters["outlier"]) * likelihood[:, : 4 + 4 * n].max())
        first, last = (
            np.exp(-share * parameters["sharpness"] * squared(features, without_motion(chains[:, k]))) for k in (0, -1)
        )
        rest = (first.mean() + last.mean()) / 2
        after = [max(last[answer_of == a].mean(), rest) for a in range(3)]
        oracle.step(log, float(np.log(rest)), np.log(after), reader.still)
        answers = answer_posterior(watch)
        assert answers.shape == (3, 1) and answers[:, 0] == pytest.approx(oracle.p, abs=1e-3)
        assert watch.p == pytest.approx(oracle.p[:2] / oracle.p[:2].sum(), abs=2e-3)


def squared(features, postures):
    return (np.where(np.isfinite(features), features - postures, 0.0) ** 2).sum(axis=-1)


def test_a_movement_outside_the_vocabulary_is_unlearned(model, people):
    tracker = ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS)
    ends = {}
    for recording in recordings_of(people, "3", (*WORDS.labels, "byebye")).recordings:
        observer = Observer(tracker, model, KNOWN)
        ends[recording.label] = [observer.step(frame) for frame in frames_of(recording)][-1]
    assert ends["byebye"].unlearned > 0.9
    assert max(ends[label].unlearned for label in WORDS.labels) < 0.5
    assert all(end.p.sum() == pytest.approx(1) and end.facing is None for end in ends.values())


def test_without_a_background_nothing_changes(people, tmp_path):
    """Bit for bit: chains, file and posterior; with a background, the chains of its own movements are the same too."""
    learned = recordings_of(people, "12", WORDS.labels)
    plain = learn_view(learned, DOOR, WORDS, kind="phase", calibrate=False)
    assert plain.header.background is None and plain.answers == 2
    write_model(tmp_path / "plain.model", plain)
    assert "background" not in str(np.load(tmp_path / "plain.model")["header"])
    other = learn_view(
        learned, DOOR, WORDS, kind="phase", calibrate=False, background=recordings_of(people, "12", ELSE)
    )
    chosen = other.arrays()["movement_of"] >= 0
    for name, array in plain.arrays().items():
        np.testing.assert_array_equal(other.arrays()[name][chosen], array)
    (shown,) = recordings_of(people, "3", ("ok",)).recordings
    for watch in watching(plain, shown, KNOWN):
        assert watch.unlearned is None
    np.testing.assert_array_equal(answer_posterior(watch)[:, 0], watch.p)


def test_blends_are_something_else_at_every_facing(people):
    learned, parameters = recordings_of(people, "12", WORDS.labels), {"facings": 3.0}
    model = learn_view(
        learned,
        DOOR,
        WORDS,
        kind="phase",
        parameters=parameters,
        calibrate=False,
        background=MotionArchive(learned.body_parts, ()),
    )
    assert model.header.background == () and model.answers == 3
    (shown,) = recordings_of(people, "3", ("lunging",)).recordings
    for watch in watching(model, shown, KNOWN):
        assert watch.joint.shape == (2, 3) and watch.joint.sum() == pytest.approx(1)
        assert watch.unlearned.shape == (3,) and 0 <= watch.unlearned.sum() <= 1
    assert watch.unlearned.sum() > 0.5


def test_a_blend_is_of_two_movements_at_one_facing():
    movement_of, facing_of = np.array([0, 0, 1, 1, -1, 0, 0, 1, 1, -1, 0]), np.repeat([0, 1, 2], [5, 5, 1])
    one, other = blend_pairs(movement_of, facing_of)
    assert one.tolist() == [0, 2, 4, 6, 8], "every second chain, except where no other movement has the facing"
    assert blend_pairs(movement_of[:5], facing_of[:5])[0].tolist() == [0, 1, 2, 3, 4]
    assert (movement_of[one] != movement_of[other]).all() and (facing_of[one] == facing_of[other]).all()


def test_a_movement_certainly_outside_leaves_the_others_equally_likely():
    assert given_learned(np.array([[0.0], [0.0], [1.0]])) == pytest.approx(np.array([[0.5], [0.5]]))


def test_the_file_contains_the_background(model, tmp_path):
    write_model(tmp_path / "a.model", model)
    again = read_model(tmp_path / "a.model")
    assert again.header.background == ELSE and again.answers == 3
    for name, array in model.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


def test_editing_keeps_the_background_except_for_promoted_movements(model, people):
    grown = add_movements(model, recordings_of(people, "12", (*WORDS.labels, "lunging")), DOOR)
    assert grown.promoted == ("lunging",) and grown.model.header.background == ("byebye",)
    assert sorted(set(grown.model.arrays()["movement_of"].tolist())) == [-1, 0, 1, 2]
    back = remove_movements(grown.model, ("lunging",))
    assert back.header.background == ("byebye",) and back.answers == 3
    np.testing.assert_array_equal(back.arrays()["chains"], model.without_background(1).arrays()["chains"])
    smaller = remove_movements(grown.model, ("ok",))
    assert smaller.arrays()["movement_of"].min() == -1 and smaller.header.vocabulary.labels == ("shake", "lunging")


def test_a_background_example_is_evaluated_by_a_model_without_its_movement(monkeypatch, model, people):
    learned, shown = [], []

    class Spy(Phase):
        def watch(self, onset):
            learned.append(set(self.arrays()["movement_of"].tolist()))
            return super().watch(onset)

    def spy(model, example):
        shown.append(example.movement)
        return evaluate_example(model, example)

    monkeypatch.setattr("observer.learning.learn.evaluate_example", spy)
    recordings = recordings_of(people, "12", WORDS.labels).recordings
    seen_from = ExampleView(DOOR, WORDS, BODY_PARTS)
    examples = seen_from.examples(recordings, BODY_PARTS)
    examples += seen_from.examples(recordings_of(people, "12", ELSE).recordings, BODY_PARTS, ELSE)
    calibration = with_calibration(Spy, model, examples).header.calibration
    assert sorted(shown) == [-2, -2, -1, -1, 0, 0, 1, 1]
    for movement, chains in zip(shown, learned, strict=True):
        assert chains == ({-1, 0, 1} if movement < 0 else {-2, -1, 0, 1})
    assert calibration.likelihood_statistics == () and calibration.slope == 0


def test_all_background_examples_together_weigh_as_one_movement():
    """Own movements are recognised, others confused with certainty: the fit must not depend on their number."""

    def results(truth, p, count):
        return [HeldOutResult(truth, np.array([p]), None) for _ in range(count)]

    own = [*results(0, [0.98, 0.01, 0.01], 30), *results(1, [0.01, 0.98, 0.01], 30)]
    few, many = (fit_calibration([*own, *results(2, [0.9, 0.05, 0.05], count)], 2) for count in (30, 300))
    assert few == many and many.temperature > fit_calibration(own, 2).temperature
    assert many == PosteriorCalibration(many.temperature, many.doubt)


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
    words = ["learn", archives / "own.npz", "--model", "phase", "--view", "door", "-o", archives / "a.model"]
    status, out, _ = run(*words, "--background", archives / "all.npz", "--background-labels", "byebye")
    assert status == 0 and "something else is known by blends of the movements and by byebye" in out
    _, out, _ = run(
        "learn",
        archives / "own.npz",
        "--model",
        "phase",
        "--view",
        "door",
        "-o",
        archives / "b.model",
        "--background",
        "blends",
    )
    assert "something else is known by blends of the movements; --background adds recordings" in out
    more = ["learn", archives / "all.npz", "--view", "door", "-o", archives / "a.model", "--add-to"]
    status, out, _ = run(*more, archives / "a.model", "--labels", "byebye")
    assert status == 0 and "no longer something else: byebye" in out
    assert read_model(archives / "a.model").header.background == ()


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--background", "all.npz"], "background: 'ok' is among the movements that are learned; name others"),
        (["--background", "all.npz", "--background-labels", "jump"], "jump: no recording shows this movement"),
        (["--background", "blends", "--background-labels", "byebye"], "of which archive? name it with --background"),
        (["--background-labels", "byebye"], "of which archive? name it with --background"),
        (["--background", "none.npz"], "none.npz"),
        (["--background", "blends", "--model", "frame-table"], "frame-table: learns no background"),
        (["--background", "blends", "--add-to", "a.model"], "--background: only for a new model"),
    ],
)
def test_an_invalid_background_is_one_line_and_exit_2(run, archives, monkeypatch, words, error):
    monkeypatch.chdir(archives)
    status, _, err = run("learn", "own.npz", "--view", "door", "-o", "new.model", *words)
    assert status == 2 and error in err and err.count("\n") == 1
    assert not (archives / "new.model").exists()
