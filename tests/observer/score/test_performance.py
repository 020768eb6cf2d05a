"""A movement is scored once, when its rest begins; models carry references in their files and when they are edited."""

from dataclasses import replace

import numpy as np
import pytest

import labanmesh
from common import SECOND_NS
from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.editing import add_movements, remove_movements
from observer.learning.examples import with_references
from observer.learning.learn import learn_view
from observer.model.model_file import read_model, write_model
from observer.motion.archive_file import write_archive
from observer.motion.projected import view_tracks
from observer.runtime.pipeline import Observer
from observer.score.performance import PerformanceScorer
from observer.score.references import ReferenceTakes
from observer.tracks import Frame
from studies.performer import perform, perform_continuously

LABELS = ("byebye", "lunging", "stretch")
VIEW = parse_view("door")
RATE_HZ = 15.0


@pytest.fixture(scope="module")
def shown():
    return perform(people=("1", "2", "3"), movements=LABELS, trials=2)


@pytest.fixture(scope="module")
def plain(shown):
    return learn_view(shown, VIEW, Vocabulary(LABELS), parameters={"kernels": 336.0})


@pytest.fixture(scope="module")
def model(plain, shown):
    return with_references(plain, shown, VIEW, ["byebye"])


class Played:
    """A tracker that has the tracks already."""

    complaint = ""

    def __init__(self, tracks, body_parts):
        self.tracks, self.body_parts = tracks, body_parts

    def update(self, frame):
        return self.tracks[frame.content]


def posteriors(model, archive, movements=("byebye", "lunging"), person="4"):
    """What an observer says of each frame, and when it was captured."""
    recording = perform_continuously(person, movements)
    tracks = view_tracks(VIEW, recording, archive.body_parts, archive.body_parts)
    observer = Observer(Played(tracks, archive.body_parts), model)
    for n in range(len(tracks)):
        at_ns = 100 * SECOND_NS + round(n / RATE_HZ * SECOND_NS)
        yield n, recording, observer.step(Frame(at_ns, n))
    yield len(tracks), recording, observer.end()


def test_a_performance_is_scored_once_when_its_rest_begins(model, shown, monkeypatch):
    judged, judge = [], ReferenceTakes.judge
    monkeypatch.setattr(ReferenceTakes, "judge", lambda *args: judged.append(1) or judge(*args))
    said = [(n, recording, each) for n, recording, each in posteriors(model, shown)]
    first, second = said[0][1].spans
    scores = {n: each.score for n, _, each in said if each is not None}
    assert all(scores[n] is None for n in range(first.end - 1)), "no score before the movement has ended"
    after = [scores[n] for n in range(first.end, second.start) if scores[n] is not None]
    assert after and after[-1].label == "byebye" and 0 <= after[-1].score <= 10 and after[-1].certainty == 1
    assert 0 <= after[-1].ended_ns / SECOND_NS - 100 - first.end / RATE_HZ < 1
    # The next movement has no references: its end is the end of the score of the one before.
    assert all(scores[n] == after[-1] for n in range(second.start, second.end - 1))
    assert said[-2][2].score.reason == "it has no reference takes" and said[-2][2].score.label == "lunging"
    assert len(judged) <= 2


def test_a_performance_that_the_source_ends_is_scored(model, shown):
    recording = perform(people=("4",), movements=("byebye",), trials=1).recordings[0]
    tracks = view_tracks(VIEW, recording, shown.body_parts, shown.body_parts)
    observer = Observer(Played(tracks, shown.body_parts), model)
    for n in range(len(tracks)):
        now = observer.step(Frame(round(n / RATE_HZ * SECOND_NS), n))
    last = observer.end()
    assert now.score is None and last.score.label == "byebye"
    assert last.score.ended_ns == round((len(tracks) - 1) / RATE_HZ * SECOND_NS)


def test_without_references_nothing_changes(plain, model, shown, tmp_path):
    write_model(tmp_path / "plain.model", plain)
    write_model(tmp_path / "own.model", model)
    with np.load(tmp_path / "plain.model") as arrays, np.load(tmp_path / "own.model") as more:
        assert not [name for name in arrays if name.startswith("reference")]
        # The header says which takes they are.
        assert all((arrays[name] == more[name]).all() for name in arrays if name != "header")
    pairs = zip(posteriors(read_model(tmp_path / "plain.model"), shown), posteriors(model, shown), strict=True)
    for (*_, one), (*_, other) in pairs:
        assert (one is None) is (other is None)
        if one is not None:
            assert (one.p == other.p).all() and one.rest == other.rest and one.score is None


def test_a_file_keeps_references_and_their_spread(model, tmp_path):
    write_model(tmp_path / "own.model", model)
    own, again = (each.header.references["byebye"] for each in (model, read_model(tmp_path / "own.model")))
    trace = own.takes[0].trace
    assert again.judge(trace).score == pytest.approx(own.judge(trace).score)
    assert [take.person for take in again.takes] == [take.person for take in own.takes]


def test_a_damaged_file_is_one_line(model, tmp_path):
    write_model(tmp_path / "own.model", model)
    with np.load(tmp_path / "own.model") as stored:
        arrays = dict(stored)
    for name, value in (("reference_usual", np.zeros((1, 3))), ("reference_labels", np.array(["jump"]))):
        with (tmp_path / "bad.model").open("wb") as file:
            np.savez(file, **{**arrays, name: value})
        with pytest.raises(BadInput, match=r"bad\.model: damaged model file") as caught:
            read_model(tmp_path / "bad.model")
        assert "\n" not in str(caught.value)


def test_a_movement_that_is_forgotten_leaves_no_reference(model):
    assert not remove_movements(model, ["byebye"]).header.references
    assert set(remove_movements(model, ["stretch"]).header.references) == {"byebye"}


def test_a_movement_that_is_added_changes_no_reference(model):
    more = perform(people=("1", "2"), movements=("maestro",), trials=2)
    edited = add_movements(model, more, VIEW).model
    assert edited.header.references == model.header.references and "maestro" in edited.header.vocabulary.labels


@pytest.mark.parametrize(
    ("chosen", "known"),
    [
        (["all"], {"byebye": 6, "lunging": 6, "stretch": 6}),
        (["1"], {"byebye": 3, "lunging": 3, "stretch": 3}),
        (["byebye", "stretch:2"], {"byebye": 6, "stretch": 3}),
    ],
)
def test_references_are_chosen_by_trial_and_movement(plain, shown, chosen, known):
    references = with_references(plain, shown, VIEW, chosen).header.references
    assert {label: sum(not take.mirrored for take in own.takes) for label, own in references.items()} == known


def test_too_few_and_unknown_takes_are_one_line(plain, shown):
    two = replace(shown, recordings=tuple(each for each in shown.recordings if each.subject != "3"))
    with pytest.raises(BadInput, match="--reference: byebye: 2 reference takes: a score needs at least 3"):
        with_references(plain, two, VIEW, ["byebye:1"])
    with pytest.raises(BadInput, match="--reference byby: no take"):
        with_references(plain, shown, VIEW, ["byby"])


def test_learn_says_which_movements_it_scores(shown, tmp_path, capsys):
    write_archive(tmp_path / "shown.npz", shown)
    words = ["learn", str(tmp_path / "shown.npz"), "--view", "door", "--parameter", "kernels=84"]
    output = str(tmp_path / "own.model")
    assert labanmesh.main([*words, "--reference", "lunging", "-o", output]) == 0
    assert "scores lunging by 6 reference takes" in capsys.readouterr().out
    assert labanmesh.main([*words, "--reference", "1", "--effort", "-o", output]) == 2


class RestingWatch:
    """Says how many frames of a movement are over."""

    performed, rest = 0, 1.0

    def __init__(self, trace):
        self.trace, self.seen = trace, np.ones((trace.shape[1] - 3) // 2)

    def performance(self):
        return self.trace, self.seen


def test_a_flicker_of_rest_costs_nothing_and_each_movement_is_scored_once(model, monkeypatch):
    judged, judge = [], ReferenceTakes.judge
    monkeypatch.setattr(ReferenceTakes, "judge", lambda *args: judged.append(1) or judge(*args))
    scorer, watch = PerformanceScorer(model.header), RestingWatch(model.header.references["byebye"].takes[0].trace)
    sure, other = np.array([0.9, 0.05, 0.05]), np.array([0.05, 0.9, 0.05])
    for n in range(20):
        watch.performed = 0 if n % 2 else 30 + n // 10
        score = scorer.update(watch, sure, n * SECOND_NS // 15)
    assert score.label == "byebye" and len(judged) == 1
    watch.performed = 30
    assert scorer.update(watch, other, 2 * SECOND_NS) == score and len(judged) == 1
    watch.performed = 60
    assert scorer.update(watch, sure, 4 * SECOND_NS).ended_ns == 4 * SECOND_NS and len(judged) == 2
    watch.performed = 30
    assert scorer.update(watch, other, 5 * SECOND_NS).reason == "it has no reference takes"
    watch.performed, watch.trace = 60, watch.trace[:6]
    assert scorer.update(watch, sure, 6 * SECOND_NS).reason == "its begin was not seen", "a part of the movement"


def test_what_is_half_unseen_another_movement_or_without_a_begin_has_a_reason(model):
    scorer, watch = PerformanceScorer(model.header), RestingWatch(model.header.references["byebye"].takes[0].trace)
    sure = np.array([0.9, 0.05, 0.05])
    watch.performed, watch.seen = 30, np.zeros_like(watch.seen)
    said = scorer.update(watch, sure, SECOND_NS)
    assert said.label == "byebye" and said.ended_ns == SECOND_NS and said.reason.startswith("too little is seen: not")
    watch.performed, watch.seen, watch.trace = 60, np.ones_like(watch.seen), 9 * watch.trace
    assert scorer.update(watch, sure, 2 * SECOND_NS).reason.startswith("this is another movement: ")
    # Motion for longer than stillness is late, and then a rest after nothing whose begin is known.
    watch.performed, watch.rest, score = 0, 0.1, None
    for n in range(15):
        moving = scorer.update(watch, sure, 3 * SECOND_NS + n * SECOND_NS // 15)
    watch.rest = 0.9
    score = scorer.update(watch, sure, 4 * SECOND_NS)
    assert score.reason == "its begin was not seen" and score.ended_ns == 4 * SECOND_NS != moving.ended_ns
    assert scorer.update(watch, sure, 5 * SECOND_NS) == score, "once"
