"""Something else: what a model with a background believes, what it keeps, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import labanmesh
from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.features.posture import PostureReader, at_rest
from observer.filtering.phase_filter import Dynamics, PhaseFilter
from observer.geometry.views import parse_view
from observer.learning.background import blends_alone, gathered
from observer.learning.cross_validation import certainty_of
from observer.learning.editing import with_movements, without_movements
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.chains import pairs_to_blend
from observer.model.model_file import read_model, write_model
from observer.model.phase import ENTRY, Phase, steps_in
from observer.model.posterior_calibration import PosteriorCalibration, Tried, answers_of, fit, given_learned
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.motion.projected import ProjectedTracker, frames_of, view_tracks
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS
from studies.performer import perform

DOOR = parse_view("door")
WORDS = Vocabulary(("ok", "shake"))
ELSE = ("byebye", "lunging")


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2", "3"), (*WORDS.labels, *ELSE), trials=1, seed=1)


def of(archive, subjects, labels):
    chosen = tuple(r for r in archive.recordings if r.subject in subjects and r.label in labels)
    return MotionArchive(archive.body_parts, chosen)


@pytest.fixture(scope="module")
def background(people):
    return of(people, "12", ELSE)


@pytest.fixture(scope="module")
def model(people, background):
    return learn_view(of(people, "12", WORDS.labels), DOOR, WORDS, tried=False, background=background)


def watched(model, recording):
    watch = model.watch(Onset(known=True))
    for tracks in view_tracks(DOOR, recording, BODY_PARTS, BODY_PARTS):
        watch.update(tracks)
        yield watch


def test_it_believes_what_the_phase_filter_of_one_movement_more_believes(model, people):
    """Oracle: the plain filter, its evidence written down here, one more movement of the background and the blends."""
    arrays, shares = model.arrays(), steps_in(15.0 / model.header.rate_hz)
    own, of_own = arrays["chains"].astype(float), arrays["movement_of"]
    one, other = pairs_to_blend(of_own, arrays["facing_of"])
    chains = np.concatenate([own, (own[one] + own[other]) / 2])
    answer_of = np.concatenate([np.where(of_own < 0, 2, of_own), np.full(len(one), 2)])
    share, given = 15.0 / model.header.rate_hz, model.header.parameters
    begin, forget = (1 - (1 - given[name]) ** share for name in ("begin", "forget"))
    dynamics = Dynamics(shares[None], np.ones(1), np.ones((1, 1)), np.array(ENTRY), begin, forget)
    oracle = PhaseFilter(answer_of, chains.shape[1], np.full(3, 1 / 3), dynamics, onset_known=True)
    reader = PostureReader(BODY_PARTS, model.header.rate_hz, given["fast"], given["apart"])
    (shown,) = of(people, "3", ("byebye",)).recordings
    seen = iter(view_tracks(DOOR, shown, BODY_PARTS, BODY_PARTS))
    for n, watch in enumerate(watched(model, shown)):
        if n == 12:
            break
        features = reader.update(next(seen))
        said = np.exp(-share * given["sharpness"] * squared(features, chains))
        log = np.log(said + np.exp(-share * given["outlier"]) * said[:, : 4 + 4 * n].max())
        first, last = (np.exp(-share * given["sharpness"] * squared(features, at_rest(chains[:, k]))) for k in (0, -1))
        rest = (first.mean() + last.mean()) / 2
        after = [max(last[answer_of == a].mean(), rest) for a in range(3)]
        oracle.step(log, float(np.log(rest)), np.log(after))
        answers = answers_of(watch)
        assert answers.shape == (3, 1) and answers[:, 0] == pytest.approx(oracle.p, abs=1e-3)
        assert watch.p == pytest.approx(oracle.p[:2] / oracle.p[:2].sum(), abs=2e-3)


def squared(features, postures):
    return (np.where(np.isfinite(features), features - postures, 0.0) ** 2).sum(axis=-1)


def test_what_is_something_else_is_told_to_be(model, people):
    tracker = ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS)
    ends = {}
    for recording in of(people, "3", (*WORDS.labels, "byebye")).recordings:
        observer = Observer(tracker, model, Onset(known=True))
        ends[recording.label] = [observer.step(frame) for frame in frames_of(recording)][-1]
    assert ends["byebye"].unlearned > 0.9
    assert max(ends[label].unlearned for label in WORDS.labels) < 0.5
    assert all(end.p.sum() == pytest.approx(1) and end.facing is None for end in ends.values())


def test_with_no_background_nothing_is_different(people, tmp_path):
    """Bit for bit: chains, file and belief; learned with a background, what it has of its movements is the same too."""
    learned = of(people, "12", WORDS.labels)
    plain = learn_view(learned, DOOR, WORDS, tried=False)
    assert plain.header.background is None and plain.answers == 2
    write_model(tmp_path / "plain.model", plain)
    assert "background" not in str(np.load(tmp_path / "plain.model")["header"])
    other = learn_view(learned, DOOR, WORDS, tried=False, background=of(people, "12", ELSE))
    chosen = other.arrays()["movement_of"] >= 0
    for name, array in plain.arrays().items():
        np.testing.assert_array_equal(other.arrays()[name][chosen], array)
    (shown,) = of(people, "3", ("ok",)).recordings
    for watch in watched(plain, shown):
        assert watch.unlearned is None
    np.testing.assert_array_equal(answers_of(watch)[:, 0], watch.p)


def test_blends_alone_are_something_else_too_at_every_facing(people):
    learned, given = of(people, "12", WORDS.labels), {"facings": 3.0}
    model = learn_view(learned, DOOR, WORDS, parameters=given, tried=False, background=blends_alone(learned.body_parts))
    assert model.header.background == () and model.answers == 3
    (shown,) = of(people, "3", ("lunging",)).recordings
    for watch in watched(model, shown):
        assert watch.joint.shape == (2, 3) and watch.joint.sum() == pytest.approx(1)
        assert watch.unlearned.shape == (3,) and 0 <= watch.unlearned.sum() <= 1
    assert watch.unlearned.sum() > 0.5


def test_a_blend_is_of_two_movements_at_one_facing():
    movement_of, facing_of = np.array([0, 0, 1, 1, -1, 0, 0, 1, 1, -1, 0]), np.repeat([0, 1, 2], [5, 5, 1])
    one, other = pairs_to_blend(movement_of, facing_of)
    assert one.tolist() == [0, 2, 4, 6, 8], "every second, but who has no other movement at his facing"
    assert pairs_to_blend(movement_of[:5], facing_of[:5])[0].tolist() == [0, 1, 2, 3, 4]
    assert (movement_of[one] != movement_of[other]).all() and (facing_of[one] == facing_of[other]).all()


def test_what_cannot_be_a_movement_says_nothing_of_them():
    assert given_learned(np.array([[0.0], [0.0], [1.0]])) == pytest.approx(np.array([[0.5], [0.5]]))


def test_the_file_keeps_the_background(model, tmp_path):
    write_model(tmp_path / "a.model", model)
    again = read_model(tmp_path / "a.model")
    assert again.header.background == ELSE and again.answers == 3
    for name, array in model.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


def test_adding_and_forgetting_keep_the_background_but_what_became_a_movement(model, people):
    grown = with_movements(model, of(people, "12", (*WORDS.labels, "lunging")), DOOR)
    assert grown.promoted == ("lunging",) and grown.model.header.background == ("byebye",)
    assert sorted(set(grown.model.arrays()["movement_of"].tolist())) == [-1, 0, 1, 2]
    back = without_movements(grown.model, ("lunging",))
    assert back.header.background == ("byebye",) and back.answers == 3
    np.testing.assert_array_equal(back.arrays()["chains"], model.without_background(1).arrays()["chains"])
    kept = without_movements(grown.model, ("ok",))
    assert kept.arrays()["movement_of"].min() == -1 and kept.header.vocabulary.labels == ("shake", "lunging")


def test_an_example_of_the_background_is_judged_by_who_has_not_learned_its_movement(monkeypatch, model, people):
    learned, shown = [], []

    class Spy(Phase):
        def watch(self, onset):
            learned.append(set(self.arrays()["movement_of"].tolist()))
            return super().watch(onset)

    def looking(model, example):
        shown.append(example.movement)
        return judged(model, example)

    from observer.learning.cross_validation import judged
    from observer.learning.learn import examples_of

    monkeypatch.setattr("observer.learning.cross_validation.judged", looking)
    recordings = of(people, "12", WORDS.labels).recordings
    examples = examples_of(recordings, DOOR, WORDS, BODY_PARTS, BODY_PARTS, 1)
    others = of(people, "12", ELSE).recordings
    examples += examples_of(others, DOOR, WORDS, BODY_PARTS, BODY_PARTS, 1, ELSE)
    certainty = certainty_of(Spy, model.header, examples)
    assert sorted(shown) == [-2, -2, -1, -1, 0, 0, 1, 1]
    for movement, chains in zip(shown, learned, strict=True):
        assert chains == ({-1, 0, 1} if movement < 0 else {-2, -1, 0, 1})
    assert certainty.foreseen == () and certainty.slope == 0


def test_however_many_examples_of_something_else_there_are_they_weigh_as_one_movement():
    """Its own movements are judged well, others named with certainty: what is fitted must not hang on their number."""

    def tried(truth, p, count):
        return [Tried(truth, np.array([p]), None) for _ in range(count)]

    own = [*tried(0, [0.98, 0.01, 0.01], 30), *tried(1, [0.01, 0.98, 0.01], 30)]
    few, many = (fit([*own, *tried(2, [0.9, 0.05, 0.05], count)], 2) for count in (30, 300))
    assert few == many and many.temperature > fit(own, 2).temperature
    assert many == PosteriorCalibration(many.temperature, many.doubt)


def test_recordings_of_several_archives_are_brought_to_the_models_parts_and_rate(people):
    turned = MotionArchive(
        BODY_PARTS[::-1], tuple(replace(r, positions=r.positions[:, ::-1]) for r in of(people, "3", ELSE).recordings)
    )
    found = gathered([of(people, "1", ELSE), turned], ("lunging",), BODY_PARTS, 10.0)
    assert [(r.subject, r.label, r.rate_hz) for r in found.recordings] == [
        ("1", "lunging", 10.0),
        ("3", "lunging", 10.0),
    ]
    (as_it_was,) = of(people, "3", ("lunging",)).recordings
    np.testing.assert_array_equal(found.recordings[1].positions[0], as_it_was.positions[0])
    with pytest.raises(BadInput, match="no 'nose' in its recordings, which the model needs"):
        gathered([turned], (), ("nose",), 10.0)


@pytest.fixture
def archives(people, tmp_path):
    write_archive(tmp_path / "own.npz", of(people, "12", WORDS.labels))
    write_archive(tmp_path / "all.npz", people)
    return tmp_path


def run(capsys, *words):
    status = labanmesh.main([str(word) for word in words])
    said = capsys.readouterr()
    return status, said.out, said.err


def test_as_a_person_types_it(capsys, archives):
    words = ["learn", archives / "own.npz", "--view", "door", "-o", archives / "a.model"]
    status, out, _ = run(capsys, *words, "--background", archives / "all.npz", "--background-labels", "byebye")
    assert status == 0 and "something else is known by blends of the movements and by byebye" in out
    more = ["learn", archives / "all.npz", "--view", "door", "-o", archives / "a.model", "--add-to"]
    status, out, _ = run(capsys, *more, archives / "a.model", "--labels", "byebye")
    assert status == 0 and "something else until now, and no more: byebye" in out
    assert read_model(archives / "a.model").header.background == ()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--background", "all.npz"], "background: 'ok' is among the movements that are learned; name others"),
        (["--background", "all.npz", "--background-labels", "jump"], "'jump' is in no recording; known: ok, shake"),
        (["--background", "blends", "--background-labels", "byebye"], "of which archive? name it with --background"),
        (["--background-labels", "byebye"], "of which archive? name it with --background"),
        (["--background", "none.npz"], "none.npz"),
        (["--background", "blends", "--model", "frame-table"], "frame-table: learns no background"),
        (["--background", "blends", "--add-to", "a.model"], "--background: goes with a new model alone"),
    ],
)
def test_what_cannot_be_a_background_is_one_line_and_exit_2(capsys, archives, monkeypatch, words, said):
    monkeypatch.chdir(archives)
    status, _, err = run(capsys, "learn", "own.npz", "--view", "door", "-o", "new.model", *words)
    assert status == 2 and said in err and err.count("\n") == 1
    assert not (archives / "new.model").exists()
